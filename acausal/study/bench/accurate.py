"""`simulate(accuracy=...)`: solver and tolerance are looked for, then used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from acausal.errors import UsageError
from acausal.lower.compiled import CompiledModel
from acausal.result import Result
from acausal.study.bench.recommend import for_accuracy


def simulated(
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
    from acausal.simulate.run import simulate

    if not 0 < accuracy < 1:
        raise UsageError("AC041", f"accuracy {accuracy:g} is not between 0 and 1")
    if tolerance is not None or step is not None:
        other = "tolerance" if tolerance is not None else "step"
        raise UsageError("AC043", f"accuracy and {other} exclude each other", help="the bench finds the tolerance")
    advice = for_accuracy(compiled, accuracy, solver, options)
    result = simulate(compiled, **{**options, **advice.options}, output_interval=output_interval, progress=progress)
    stats = {**result.stats, "reason": f"{advice.text}, for an accuracy of {accuracy:g}", "accuracy": advice.record()}
    return replace(result, stats=stats)
