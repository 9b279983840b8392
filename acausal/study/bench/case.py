"""What is compared: a solver at a tolerance, or with a step, on one form of the equations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

FORMULATIONS = ("torn", "dae", "projected")
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
ADAPTIVE = ("idas", "rosenbrock", "cvodes", "erk")
FIXED = ("rk2", "erk", "rosenbrock")
ONLY_FIXED = ("rk2", "rk", "collocation")
"""Solvers that have no tolerance."""
IMPLICIT = ("idas", "rosenbrock")
"""Solvers that take algebraic variables as they are."""
FIXED_STEPS = (100, 1_000, 10_000)
"""Numbers of steps over the run that are tried when no step is given."""


@dataclass(frozen=True)
class Case:
    """One run to be measured; `step` in seconds for a fixed step, else None, and then `tolerance` counts."""

    solver: str
    formulation: str
    tolerance: float | None = None
    step: float | None = None

    @property
    def series(self) -> str:
        """The line of the chart it belongs to."""
        fixed = " fixed" if self.step is not None and self.solver not in ONLY_FIXED else ""
        return self.solver + fixed + ("" if self.formulation == "torn" else f", {self.formulation}")

    @property
    def knob(self) -> str:
        """What is turned within a series."""
        return f"tolerance {self.tolerance:.3g}" if self.step is None else f"step {self.step:.3g} s"


def cases(
    formulations: Sequence[str], solvers: Sequence[str], tolerances: Sequence[float], steps: Sequence[float]
) -> Iterator[Case]:
    """All of them, the loosest of each series first."""
    for formulation in formulations:
        for solver in solvers:
            if solver not in ONLY_FIXED:
                for tolerance in sorted(tolerances, reverse=True):
                    yield Case(solver, formulation, tolerance=tolerance)
            if solver in FIXED or solver in ONLY_FIXED:
                for step in sorted(steps, reverse=True):
                    yield Case(solver, formulation, step=step)
