"""CasADi's Rosenbrock-Wanner integrator: order 5(4), L-stable, for stiff ODEs and semi-explicit DAEs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.divisors.pivots import may_lose_pivots
from acausal.simulate.solvers.attainable import units
from acausal.simulate.solvers.base import MOST_STEPS, CasadiSolver, stepping
from acausal.simulate.solvers.segment import Segment


class Rosenbrock(CasadiSolver):
    """One Jacobian and one sparse factorisation per step, without Newton iterations."""

    name = "rosenbrock"
    plugin = "rosenbrock"
    # On mechanisms 4 to 15 times faster than a rootfinder inside the right-hand side (measured).
    algebraic = True
    native = "integrator"
    interpolates = True

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        is_loop = problem.compiled.solution.structure.invariants and may_lose_pivots(problem.compiled)
        most_steps = max(400, 8_000 // len(segment.times)) if is_loop else MOST_STEPS
        return {
            "reltol": segment.tolerances.relative,
            "abstol": segment.tolerances.absolute,
            # A Newton step below the tolerance is enough; CasADi's default, a thousandth of it, is below rounding at
            # tolerances of 1e-10.
            "init_tol": 0.3,
            # Where a pivot of a closed loop vanishes, steps collapse, and the run restarts with other pivots. A small
            # budget reveals that in seconds instead of an hour. If no pivot can vanish, the full budget applies.
            **stepping(segment, most_steps),
        }

    def units(self, problem: Problem, segment: Segment) -> NDArray[np.float64] | None:
        """Divisors that relax the error test of algebraic variables; see `attainable.units`."""
        return units(problem, segment) if len(segment.z) else None
