"""Warm-started solver of a nonlinear program, for one solution per sample."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.optimal_control.optimum.error import interval_errors
from acausal.optimal_control.optimum.trajectory import trajectory_of
from acausal.optimal_control.program.nlp import STATIONARY, Solution, displaced, is_curved, solver_of, stopped_note
from acausal.optimal_control.program.radau import Dynamics, Program

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
# A larger error of a sample, relative to the magnitude of a state, is noted.
_COARSE = 1e-2
_log = logging.getLogger(__name__)


class WarmStartedSolver:
    """Solver of a program that starts from its last solution.

    Attributes
    ----------
    iterations, status
        Number of iterations and return status of the last call.
    notes
        What has been noted in any call.
    """

    def __init__(self, name: str, program: Program, tolerance: float, options: Mapping[str, Any]) -> None:
        ipopt = {**_OPTIONS, "tol": tolerance, **options}
        inner: dict[str, Any] = {"ipopt": ipopt, "print_time": False, "expand": True, "error_on_fail": False}
        self._nlp, self._weight = program.nlp, 0.0
        self._solver = solver_of("ipopt", self._nlp.casadi_program(ca.MX.sym("weight")), inner)
        low, high = self._nlp.limits
        self._limits = {"lbg": low, "ubg": high}
        self._guess: Any = np.concatenate(self._nlp.begin)
        self._duals: Any = np.zeros(len(low))
        self._name, self._program, self._tolerance = name, program, float(ipopt["tol"])
        self._is_checked = self._has_solved = False
        self.iterations, self.status = 0, ""
        self.notes: tuple[str, ...] = ()

    def solve(self, p: Vector) -> Any | None:
        """Solution for the parameters p of the program, shape (np,), as a column; None if there is none.

        The next call starts from this solution, or, if there is none, from the one before.
        """
        if not self._weight:  # the weight depends on the parameters, which are known from the first call on
            self._weight = self._nlp.objective_weight(p)
        found, stats = self._solved(p, self._guess)
        status = str(stats.get("return_status", ""))
        self.iterations, self.status = int(stats.get("iter_count", 0)), status.replace("_", " ")
        if not stats.get("success", True):
            return None
        if not self._has_solved and not is_curved(stats):  # later calls begin at a minimum
            beside, stats = self._solved(p, displaced(np.array(found["x"]).ravel()))
            if not stats.get("success", True):
                status = STATIONARY
            elif float(beside["f"]) < float(found["f"]):
                found = beside
        self._has_solved = True
        for text in stopped_note(status, self._tolerance):
            self.note(text)
        self._guess, self._duals = found["x"], found["lam_g"]
        return found["x"]

    def _solved(self, p: Vector, guess: Any) -> tuple[Any, Any]:
        """(Results, statistics) of a solution for the parameters p, shape (np,), from a guess."""
        found = self._solver(x0=guess, lam_g0=self._duals, p=np.append(p, self._weight), **self._limits)
        return found, self._solver.stats()

    def check_once(self, laws: Sequence[Dynamics], p: Vector) -> None:
        """Note whether IDAS deviates from the last solution within a sample; only the first call looks.

        `p`: parameters of the program, shape (np,).
        """
        if self._is_checked:
            return
        self._is_checked = True
        x, none = np.array(self._guess).ravel(), np.zeros(0)
        solution = Solution(self._nlp, x, none, none, np.nan, True, "", self.iterations, p)
        (errors,), _ = interval_errors(self._program, laws, solution, trajectory_of(self._program, solution))
        k = int(np.argmax(errors)) if len(errors) else 0
        if len(errors) and errors[k] > _COARSE:
            self.note(
                f"samples are coarse: IDAS deviates by {errors[k]:.2g} of the magnitude of a state or an integral in "
                f"sample {k + 1} of {len(errors)}; use shorter samples, or more points: degree=5"
            )

    def note(self, text: str) -> None:
        """Log a note once."""
        if text not in self.notes:
            self.notes += (text,)
            _log.warning("%s of %s: %s", self._name, self._program.problem.compiled.name, text)
