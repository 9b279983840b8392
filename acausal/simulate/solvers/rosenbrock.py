"""CasADi's Rosenbrock-Wanner integrator: order 5(4), L-stable, for stiff ODEs and semi-explicit DAEs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.pivots import may_lose_pivots
from acausal.simulate.solvers.attainable import units
from acausal.simulate.solvers.base import MOST_STEPS, CasadiSolver, stepping
from acausal.simulate.solvers.segment import Segment


class Rosenbrock(CasadiSolver):
    """One Jacobian and one sparse factorisation a step; no Newton iterations."""

    name = "rosenbrock"
    plugin = "rosenbrock"
    # Measured on mechanisms: 4 to 15 times faster than a rootfinder inside the right-hand side.
    algebraic = True
    native = "integrator"
    interpolates = True

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        is_loop = problem.compiled.solution.structure.invariants and may_lose_pivots(problem.compiled)
        most = max(400, 8_000 // len(segment.times)) if is_loop else MOST_STEPS
        return {
            "reltol": segment.tolerances.relative,
            "abstol": segment.tolerances.absolute,
            # a Newton step below the tolerance is enough: a thousandth of it, CasADi's own, is below rounding at 1e-10
            "init_tol": 0.3,
            # a loop of joints that crawls where a pivot vanishes begins again with others: that is to be noticed in
            # seconds, not in an hour; where none vanishes the run goes on with as many as it needs
            **stepping(segment, most),
        }

    def units(self, problem: Problem, segment: Segment) -> NDArray[np.float64] | None:
        """Coarser ones for algebraic variables that rounding keeps from their tolerance."""
        return units(problem, segment) if len(segment.z) else None
