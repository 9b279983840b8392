"""Detects runs whose steps are determined by rounding errors, and the tolerance down to which they are not.

A method of order p takes 10^(1/(p+1)) times the steps for a tenth of the tolerance, which is usually 1.5 to 2 times. If
the error that it controls is noise of the right-hand side (a stiff spring between positions far from zero), steps
shrink in proportion to the tolerance or faster, and nothing is gained. Bounds of that noise from the Jacobian are too
wide to distinguish the two cases: for the transistor amplifier they are a hundred times what its runs attain. So short
stretches of the run are integrated again with coarser tolerances, and the numbers of steps are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from acausal.simulate.solvers.segment import Piece, Segment, Tolerances

MANY = 100_000
"""Runs with at least this many steps are checked."""

STRETCHES = 6
"""Number of short stretches that are integrated again."""

STRETCH = 1000.0
"""Number of steps that the run took in each of them, if all its steps were equally long."""

_FACTOR = 10.0
_DECADES = 6
# Growth of the number of steps, for a tenth of the tolerance, from which on rounding errors determine them: it is 3.2
# for low orders at kinks, and 10 or more for rounding.
_NOISY_GROWTH = 5.0
# Fewer steps in a stretch are too few to compare.
_FEWEST_STEPS = 200


def attainable(integrate: Callable[[Segment], Piece], stretches: Sequence[Segment]) -> float | None:
    """Return the factor by which the tolerance must grow so that rounding errors no longer determine the steps.

    None if they do not determine them now. `stretches` are parts of the run, with its tolerances; where one fails, the
    search ends.
    """
    before = _steps(integrate, stretches, 1.0)
    if before is None or before < _FEWEST_STEPS:
        return None
    attained = None
    for decade in range(1, _DECADES + 1):
        factor = _FACTOR**decade
        steps = _steps(integrate, stretches, factor)
        if steps is None:
            break
        if before > _NOISY_GROWTH * steps:
            attained = factor
        elif attained is not None:
            break
        before = steps
    return attained


def remark(factor: float | None, steps: float, solver: str, tolerances: Tolerances) -> tuple[str, ...]:
    """The note on a run of this many steps; empty if there is no factor."""
    if factor is None:
        return ()
    return (
        f"rounding errors of the equations determined the {steps:.0f} steps of {solver}, not the tolerance "
        f"{tolerances.relative:g}: about {tolerances.scaled(factor).relative:.0e} can be attained; a smaller tolerance "
        "costs steps without gaining digits",
    )


def _steps(integrate: Callable[[Segment], Piece], stretches: Sequence[Segment], factor: float) -> float | None:
    total = 0.0
    for stretch in stretches:
        coarser = replace(stretch, tolerances=stretch.tolerances.scaled(factor))
        try:
            total += integrate(coarser).counters.get("steps", 0.0)
        except RuntimeError:
            return None
    return total
