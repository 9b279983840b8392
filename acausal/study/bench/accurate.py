"""`simulate(accuracy=...)`: find solver and tolerance by a small bench, then simulate."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from acausal.errors import UsageError
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.run import simulate
from acausal.study.bench.bench import bench_compiled
from acausal.study.bench.case import ADAPTIVE, IMPLICIT
from acausal.study.bench.run import Recommendation

_log = logging.getLogger(__name__)


def simulated_to_accuracy(
    compiled: CompiledModel,
    accuracy: float,
    asked: Mapping[str, Any],
    more: Mapping[str, object],
    progress: Callable[[float, float], None] | None,
) -> Result:
    """Result of the cheapest run with an error of at most `accuracy`; its `stats` describe the search.

    Parameters
    ----------
    asked
        Times, solver and `native` as passed to `simulate`, None if open. If a solver is given, only its tolerances are
        varied.
    more
        Parameters, inputs and `force` of all runs.

    Raises
    ------
    UsageError
        AC041 for an accuracy outside (0, 1), AC043 if a tolerance, a step or a maximum step is given, too.
    IntegrationError
        AC410 without a reference, AC411 if no run reaches the accuracy.
    """
    if not 0 < accuracy < 1:
        raise UsageError("AC041", f"accuracy {accuracy:g} is not between 0 and 1")
    others = {"tolerance": "the bench finds the tolerance", "step": "the bench finds the tolerance"}
    for other, remedy in {**others, "max_step": "the bench chooses the steps"}.items():
        if asked[other] is not None:
            raise UsageError("AC043", f"accuracy and {other} exclude each other", help=remedy)
    run = {**more, **{name: asked[name] for name in ("start_time", "stop_time", "native")}}
    advice = for_accuracy(compiled, accuracy, asked["solver"], run)
    interval = asked["output_interval"]
    result = simulate(compiled, **{**run, **advice.options}, output_interval=interval, progress=progress)
    stats = {**result.stats, "reason": f"{advice.text}, for an accuracy of {accuracy:g}", "accuracy": advice.record()}
    return replace(result, stats=stats)


def tolerances_for(accuracy: float) -> tuple[float, ...]:
    """Tolerances to try for an accuracy: errors are within a few decades of the tolerance."""
    return tuple(t for t in (accuracy * f for f in (30.0, 3.0, 0.3, 0.03, 0.003)) if 1e-13 <= t < 0.5) or (1e-12,)


def for_accuracy(
    compiled: CompiledModel, accuracy: float, solver: str | None, options: Mapping[str, Any]
) -> Recommendation:
    """Recommendation for an accuracy, by a small bench of the compiled model with the options of its run."""
    # explicit solvers need a rootfinder for algebraic variables, which rarely pays
    likely = IMPLICIT if compiled.algebraic else ADAPTIVE
    made = bench_compiled(
        compiled,
        solvers=likely if solver in (None, "auto") else (str(solver),),
        tolerances=tolerances_for(accuracy),
        steps=(),
        repeat=3,
        time_limit=20.0,
        options=options,
        enough=2.0 - math.log10(accuracy),
        patience=10.0,
        say=_log.debug,
    )
    return made.recommend(accuracy)
