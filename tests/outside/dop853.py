"""A solver from outside: SciPy's DOP853, an explicit method of order 8(5,3) with error control."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.base import quadratures_at, unmoved
from acausal.simulate.solvers.segment import Piece, Segment


class Dop853:
    """E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993, section II.5."""

    name = "dop853"
    algebraic = False
    fixed_step = False
    multistep = False
    explicit = True
    native = "nothing"

    def integrate(self, problem: Problem, segment: Segment) -> Piece:
        """Solve one segment in the scaled states of the problem."""
        numbers = problem.vector(segment.p, segment.x, segment.start)

        def rates(t: float, x: np.ndarray) -> np.ndarray:
            return np.asarray(problem.scaled.buffered(t, x, np.zeros(0), numbers, [])[0])

        end, grid = float(segment.times[-1]) - segment.start, segment.times - segment.start
        start = segment.x[: problem.n_dynamic] / problem.scale_x
        sizes = {"rtol": segment.tolerances.relative, "atol": segment.tolerances.absolute}
        found = solve_ivp(rates, (0.0, end), start, "DOP853", grid, **sizes)
        if not found.success:
            raise RuntimeError(found.message)
        x = np.vstack([found.y * problem.scale_x[:, None], quadratures_at(problem, segment), unmoved(problem, segment)])
        return Piece(x, problem.solve_algebraic(segment, x), {"rhs_evaluations": float(found.nfev)})
