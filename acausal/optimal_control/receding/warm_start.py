"""Warm-started solver of a nonlinear program, for one solution per sample."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.optimal_control.program.nlp import Nlp

_OPTIONS = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 100,
    "warm_start_init_point": "yes",
    # the last solution is close to the next, so ipopt need not move it away from the limits
    "warm_start_bound_push": 1e-6,
    "warm_start_slack_bound_push": 1e-6,
    "warm_start_mult_bound_push": 1e-6,
    "mu_init": 1e-4,
}


class WarmStartedSolver:
    """Solver of a program that starts from its last solution.

    Attributes
    ----------
    iterations, status
        Number of iterations and return status of the last call.
    """

    def __init__(self, name: str, nlp: Nlp, tolerance: float, options: Mapping[str, Any]) -> None:
        ipopt = {**_OPTIONS, "tol": tolerance, **options}
        inner: dict[str, Any] = {"ipopt": ipopt, "print_time": False, "expand": True, "error_on_fail": False}
        self._solver = ca.nlpsol(name, "ipopt", nlp.casadi_program(ca.MX.sym("weight")), inner)
        self._nlp, self._weight = nlp, 0.0
        low, high = nlp.limits
        self._limits = {"lbg": low, "ubg": high}
        self._guess: Any = np.concatenate(nlp.begin)
        self._duals: Any = np.zeros(len(low))
        self.iterations, self.status = 0, ""

    def solve(self, p: Vector) -> Any | None:
        """Solution for the parameters p of the program, shape (np,), as a column; None if there is none.

        The next call starts from this solution, or, if there is none, from the one before.
        """
        if not self._weight:  # the weight depends on the parameters, which are known from the first call on
            self._weight = self._nlp.objective_weight(p)
        found = self._solver(x0=self._guess, lam_g0=self._duals, p=np.append(p, self._weight), **self._limits)
        stats = self._solver.stats()
        self.iterations = int(stats.get("iter_count", 0))
        self.status = str(stats.get("return_status", "")).replace("_", " ")
        if not stats.get("success", True):
            return None
        self._guess, self._duals = found["x"], found["lam_g"]
        return found["x"]
