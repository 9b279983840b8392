"""Whether rounding errors rule the steps of a run, and down to which tolerance they do not.

A method of order p takes 10^(1/(p+1)) times the steps for a tenth of the tolerance, 1.5 to 2 times as a rule. Where the
error that it controls is noise of the right-hand side (a stiff spring between positions far from zero), steps shrink in
proportion to the tolerance or faster, and nothing is gained. Bounds of that noise from the Jacobian are too wide to
tell the two apart: for the transistor amplifier they are a hundred times what its runs attain. So short stretches of
the run are integrated again with coarser tolerances, and their steps compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from acausal.simulate.solvers.segment import Piece, Segment, Tolerances

MANY = 100_000
"""Steps of a run from which on it is worth to ask."""

STRETCHES = 6
"""Short stretches that are integrated again."""

STRETCH = 1000.0
"""Steps of the run in each of them, if all are as long."""

_FACTOR = 10.0
_DECADES = 6
# Times the steps for a tenth of the tolerance: low orders at kinks take 3.2, rounding 10 or more.
_RULED = 5.0
# Steps of a stretch below which their number says nothing.
_FEW = 200


def attainable(integrate: Callable[[Segment], Piece], stretches: Sequence[Segment]) -> float | None:
    """How many times the tolerance of a run must be so that rounding does not rule its steps; None where it does not.

    The stretches are those of the run, with its tolerances. One that fails says nothing.
    """
    before = _steps(integrate, stretches, 1.0)
    if before is None or before < _FEW:
        return None
    found = None
    for decade in range(1, _DECADES + 1):
        factor = _FACTOR**decade
        steps = _steps(integrate, stretches, factor)
        if steps is None:
            break
        if before > _RULED * steps:
            found = factor
        elif found is not None:
            break
        before = steps
    return found


def remark(factor: float | None, steps: float, solver: str, asked: Tolerances) -> tuple[str, ...]:
    """What is said of a run of so many steps; nothing without a factor."""
    if factor is None:
        return ()
    return (
        f"rounding errors of the equations ruled the {steps:.0f} steps of {solver}, not the tolerance "
        f"{asked.relative:g}: about {asked.scaled(factor).relative:.0e} can be attained; a smaller tolerance costs "
        "steps and gains no digits",
    )


def _steps(integrate: Callable[[Segment], Piece], stretches: Sequence[Segment], factor: float) -> float | None:
    total = 0.0
    for stretch in stretches:
        asked = replace(stretch, tolerances=stretch.tolerances.scaled(factor))
        try:
            total += integrate(asked).counters.get("steps", 0.0)
        except RuntimeError:
            return None
    return total
