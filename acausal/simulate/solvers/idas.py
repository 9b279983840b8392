"""IDAS: BDF of order 1-5 for semi-explicit index-1 DAEs; the reference solver."""

from __future__ import annotations

from typing import Any

import numpy as np

from acausal.simulate.problem import Problem
from acausal.simulate.solvers.base import CasadiSolver, Segment


class Idas(CasadiSolver):
    """SUNDIALS IDAS as CasADi ships it, started from a consistent point with consistent derivatives."""

    name = "idas"
    plugin = "idas"
    algebraic = True
    native = "equations"

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        x = segment.x[: problem.n_dynamic] / problem.scale_x
        rate = np.array(
            problem.dae(0.0, x, segment.z / problem.scale_z, np.concatenate([segment.p, [segment.start]]), [])[0]
        ).ravel()
        return {
            "reltol": segment.tolerance,
            "abstol": segment.absolute,
            # the start is consistent already, and IDACalcIC fails where our own start system does not
            "calc_ic": False,
            "init_xdot": rate.tolist(),
            "suppress_algebraic": True,
            "max_num_steps": 10**6,
            "linear_solver": "qr" if problem.n_dynamic < 400 else "csparse",
        }
