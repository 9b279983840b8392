"""Integrators with fixed steps: CasADi's `rk` (order 4) and `collocation` (Radau), and Heun's second order method."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import UsageError
from acausal.simulate.problem import Problem
from acausal.simulate.solvers.base import CasadiSolver, Piece, Segment


def step_of(segment: Segment, solver: str) -> float:
    """The step, or UsageError AC031 when none was given."""
    if segment.step is None:
        raise UsageError("AC031", f"solver '{solver}' has fixed steps and needs one", help="step=1e-3, or --step 1ms")
    return segment.step


def elements(segment: Segment, solver: str) -> int:
    """CasADi's number of finite elements over the segment for the wanted step."""
    return max(1, math.ceil((segment.times[-1] - segment.start) / step_of(segment, solver) - 1e-9))


class Rk(CasadiSolver):
    """Classical Runge-Kutta method of order 4."""

    name = "rk"
    plugin = "rk"
    fixed_step = True

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        return {"number_of_finite_elements": elements(segment, self.name)}


class Collocation(CasadiSolver):
    """Radau IIA of order 5: implicit, L-stable, the transcription that optimal control uses."""

    name = "collocation"
    plugin = "collocation"
    algebraic = True
    fixed_step = True

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        return {
            "number_of_finite_elements": elements(segment, self.name),
            "collocation_scheme": "radau",
            "interpolation_order": 3,
            "rootfinder": "newton",
        }


class Rk2:
    """Heun's method, the paper's Rkfix2; all steps run inside CasADi (`mapaccum`), not in a Python loop."""

    name = "rk2"
    algebraic = False
    fixed_step = True

    def integrate(self, problem: Problem, segment: Segment) -> Piece:
        """Equal steps within each output interval, none longer than the wanted one."""
        step = step_of(segment, self.name)
        ends = np.concatenate([[segment.start], segment.times])
        counts = np.maximum(1, np.ceil(np.diff(ends) / step - 1e-9)).astype(int)
        sizes = np.repeat(np.diff(ends) / counts, counts)
        starts = np.concatenate([[0.0], np.cumsum(sizes)[:-1]])
        n = problem.n_dynamic
        p = np.concatenate([segment.p, [segment.start]])
        if problem.compiled.algebraic:
            p = np.concatenate([p, segment.z / problem.scale_z])
        # quadratures are carried as states here: the method has no other way to integrate them
        x0 = np.concatenate([segment.x[:n] / problem.scale_x, segment.x[n:]])
        run = heun(problem).mapaccum("run", len(sizes))
        found = np.array(run(x0, starts[None, :], sizes[None, :], np.tile(p[:, None], (1, 1))))
        at = np.cumsum(counts) - 1
        x = found[:, at]
        x[:n] *= problem.scale_x[:, None]
        if not np.isfinite(x).all():
            raise RuntimeError("the solution is not finite: the fixed step is too large for this model")
        z = problem.solve_algebraic(segment.times, x, segment.z, segment.p)
        return Piece(x, z, {"steps": float(len(sizes)), "rhs_evaluations": 2.0 * len(sizes)})


def heun(problem: Problem) -> Any:
    """`(x, t, h, p) -> x` after one step; `x` holds scaled dynamic states and quadratures."""
    ode = problem.ode
    n, nq = problem.n_dynamic, problem.compiled.quadratures
    kind = ca.MX if problem.compiled.algebraic else ca.SX
    x, t, h, p = kind.sym("x", n + nq), kind.sym("t"), kind.sym("h"), kind.sym("p", ode.numel_in("p"))
    none = kind(0, 1)

    def rate(time: Any, state: Any) -> Any:
        found = ode(time, state[:n], none, p, none)
        return ca.vertcat(found[0], found[2])

    k1 = rate(t, x)
    k2 = rate(t + h, x + h * k1)
    return ca.Function("heun", [x, t, h, p], [x + h / 2 * (k1 + k2)])
