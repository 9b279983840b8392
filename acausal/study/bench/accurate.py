"""`simulate(accuracy=...)`: solver and tolerance are looked for, then used."""

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
    solver: str | None,
    tolerance: float | None,
    step: float | None,
    options: Mapping[str, Any],
    output_interval: float | None,
    progress: Callable[[float, float], None] | None,
) -> Result:
    """The result of the cheapest run whose error is at most `accuracy`; how it was found is in its `stats`.

    Parameters
    ----------
    solver
        Given, only its tolerances are tried.
    options
        Those of `simulate` that do not change from try to try.

    Raises
    ------
    UsageError
        AC041 for an accuracy that is none, AC043 when a tolerance or a step is given too.
    IntegrationError
        AC410, AC411 when there is no reference, or nothing reaches the accuracy.
    """
    if not 0 < accuracy < 1:
        raise UsageError("AC041", f"accuracy {accuracy:g} is not between 0 and 1")
    if tolerance is not None or step is not None:
        other = "tolerance" if tolerance is not None else "step"
        raise UsageError("AC043", f"accuracy and {other} exclude each other", help="the bench finds the tolerance")
    advice = for_accuracy(compiled, accuracy, solver, options)
    result = simulate(compiled, **{**options, **advice.options}, output_interval=output_interval, progress=progress)
    stats = {**result.stats, "reason": f"{advice.text}, for an accuracy of {accuracy:g}", "accuracy": advice.record()}
    return replace(result, stats=stats)


def tolerances_for(accuracy: float) -> tuple[float, ...]:
    """Tolerances at which an accuracy is looked for: end errors lie within some decades of the tolerance."""
    return tuple(t for t in (accuracy * f for f in (30.0, 3.0, 0.3, 0.03, 0.003)) if 1e-13 <= t < 0.5) or (1e-12,)


def for_accuracy(
    compiled: CompiledModel, accuracy: float, solver: str | None, options: Mapping[str, Any]
) -> Recommendation:
    """What `simulate(accuracy=...)` uses: a small bench of the compiled model with its run's own options."""
    # inside a right-hand side, algebraic variables cost a rootfinder: rarely worth a try
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
