"""Cases of a bench: a solver at a tolerance, or with a fixed step, on one formulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

FORMULATIONS = ("torn", "dae", "projected")
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
ADAPTIVE = ("idas", "rosenbrock", "cvodes", "erk")
FIXED = ("rk2", "erk", "rosenbrock")
ONLY_FIXED = ("rk2", "rk", "collocation")
"""Solvers without a tolerance."""
IMPLICIT = ("idas", "rosenbrock")
"""Solvers that integrate algebraic variables directly."""
FIXED_STEPS = (100, 1_000, 10_000)
"""Numbers of fixed steps over the run, if no step is given."""


@dataclass(frozen=True)
class Case:
    """One run to be measured, with a fixed `step` [s] or a `tolerance`; the other is None."""

    solver: str
    formulation: str
    tolerance: float | None = None
    step: float | None = None

    @property
    def series(self) -> str:
        """Name of its line in the chart."""
        fixed = " fixed" if self.step is not None and self.solver not in ONLY_FIXED else ""
        return self.solver + fixed + ("" if self.formulation == "torn" else f", {self.formulation}")

    @property
    def knob(self) -> str:
        """Text of the tolerance or step, the setting that varies within a series."""
        return f"tolerance {self.tolerance:.3g}" if self.step is None else f"step {self.step:.3g} s"


def cases(
    formulations: Sequence[str], solvers: Sequence[str], tolerances: Sequence[float], steps: Sequence[float]
) -> Iterator[Case]:
    """All cases, the loosest of each series first."""
    for formulation in formulations:
        for solver in solvers:
            if solver not in ONLY_FIXED:
                for tolerance in sorted(tolerances, reverse=True):
                    yield Case(solver, formulation, tolerance=tolerance)
            if solver in FIXED or solver in ONLY_FIXED:
                for step in sorted(steps, reverse=True):
                    yield Case(solver, formulation, step=step)
