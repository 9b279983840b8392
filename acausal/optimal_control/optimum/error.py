"""Discretization error of collocation: each interval is integrated by IDAS with the same start and inputs."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.optimal_control.optimum.trajectory import PhaseTrajectory, Trajectory
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import Dynamics

_TOLERANCE = 1e-10


def interval_errors(
    problem: StatedProblem, laws: Sequence[Dynamics], trajectory: Trajectory
) -> tuple[list[Vector], float]:
    """(Local errors of the intervals of each phase, shape (intervals,); largest accumulated error).

    Both are errors of states at the ends of intervals, relative to their largest magnitudes. For the accumulated error,
    each interval starts where IDAS ended the one before, so that unstable motions amplify it. An error is infinite if
    IDAS does not reach the end of an interval.
    """
    q = problem.quantities
    size = np.max([np.abs(phase.x).max(axis=1, initial=0.0) for phase in trajectory.phases], axis=0)
    size = np.where(size > 0.0, size, np.array(q.x.nominal))
    found, worst, state = [], 0.0, trajectory.phases[0].x[:, 0]
    for law, phase in zip(laws, trajectory.phases, strict=True):
        errors, drift, state = _phase(law, phase, trajectory.p, size, state)
        found.append(errors)
        worst = max(worst, drift)
        if law.jump is not None:
            _, z, u = phase.interval(len(phase.mesh) - 1, np.array([1.0]))
            state = np.array(law.jump(phase.begin + phase.duration, state, z, u, trajectory.p)).ravel()
    return found, worst


def _phase(
    law: Dynamics, phase: PhaseTrajectory, p: Vector, size: Vector, state: Vector
) -> tuple[Vector, float, Vector]:
    """(Local errors, shape (intervals,); largest accumulated error; final state of the accumulated integration).

    `p`: parameters, shape (np,).
    `size`: magnitudes of the states, shape (nx,).
    `state`: initial state of the accumulated integration, shape (nx,).
    """
    count = len(phase.mesh)
    if not len(size):
        return np.zeros(count), 0.0, state
    run = _integrator(law, phase.basis, p, size)
    borders = phase.borders * phase.duration
    found, drift = np.zeros(count), np.zeros(count)
    for k in range(count):
        x, z, _ = phase.interval(k, np.array([0.0, 1.0]))
        width = phase.basis.control + 1
        coefficients = phase.u[:, k * width : (k + 1) * width]
        given = ca.vertcat(phase.begin + borders[k], borders[k + 1] - borders[k], ca.vec(ca.DM(coefficients)))

        def end(begin: Vector, z: Vector = z[:, 0], given: Any = given) -> Vector:
            try:
                return np.array(run(x0=begin / size, z0=z, p=given)["xf"]).ravel() * size
            except RuntimeError:
                return np.full(len(size), np.nan)

        found[k] = np.max(np.abs(end(x[:, 0]) - x[:, 1]) / size)
        state = end(state) if np.isfinite(state).all() else state
        drift[k] = np.max(np.abs(state - x[:, 1]) / size)
    found, drift = (np.where(np.isnan(v), np.inf, v) for v in (found, drift))
    return found, float(drift.max()), state


def _integrator(law: Dynamics, basis: Basis, p: Vector, size: Vector) -> Any:
    """Integrator of one interval, scaled to [0, 1]; its parameters are start time, length and input coefficients."""
    dae = law.dae
    nx, nz, nu = (dae.numel_in(k) for k in (1, 2, 3))
    s, x, z = ca.SX.sym("s"), ca.SX.sym("x", nx), ca.SX.sym("z", nz)
    begin, length, u = ca.SX.sym("begin"), ca.SX.sym("length"), ca.SX.sym("u", nu, basis.control + 1)
    q = basis.control
    weights = ca.vertcat(*(comb(q, i) * s**i * (1 - s) ** (q - i) for i in range(q + 1)))
    scale = ca.DM(size)
    ode, alg, _ = dae(begin + length * s, x * scale, z, u @ weights, p)
    system = {"x": x, "z": z, "t": s, "p": ca.vertcat(begin, length, ca.vec(u)), "ode": length * ode / scale}
    options = {"reltol": _TOLERANCE, "abstol": _TOLERANCE / 100, "max_num_steps": 20000, "first_time": 1e-6}
    if nz:
        system["alg"] = alg
        options["suppress_algebraic"] = True
    return ca.integrator("interval", "idas", system, 0.0, 1.0, {**options, "show_eval_warnings": False})
