"""Errors of an optimum: of the collocation, from each interval integrated by IDAS, and of a run with its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, OptimizationError
from acausal.optimal_control.optimum.integrals import Integrals, integrals_of
from acausal.optimal_control.optimum.optimum import Optimum
from acausal.optimal_control.optimum.trajectory import PhaseTrajectory, Trajectory
from acausal.optimal_control.program.nlp import Solution
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import Dynamics, Program
from acausal.result.result import Result
from acausal.simulate.record.meeting.branches import on_meeting

_TOLERANCE = 1e-10


def interval_errors(
    program: Program, laws: Sequence[Dynamics], solution: Solution, trajectory: Trajectory
) -> tuple[list[Vector], float]:
    """(Local errors of the intervals of each phase, shape (intervals,); largest accumulated error).

    Both are errors of states at the ends of intervals, relative to their largest magnitudes. For the accumulated error,
    each interval starts where IDAS ended the one before, so that unstable motions amplify it. An error is infinite if
    IDAS does not reach the end of an interval.

    Local errors include those of integrals, because an integrand may need more points than the states.
    """
    q = program.problem.quantities
    size = np.max([np.abs(phase.x).max(axis=1, initial=0.0) for phase in trajectory.phases], axis=0)
    size = np.where(size > 0.0, size, np.array(q.x.nominal))
    found, worst, state = [], 0.0, trajectory.phases[0].x[:, 0]
    integrals = integrals_of(program, solution, [law.dae for law in laws])
    for law, phase, own in zip(laws, trajectory.phases, integrals, strict=True):
        errors, drift, state, exact = _phase(law, phase, trajectory.p, size, state, own)
        off = own.errors(phase, trajectory.p, exact, program.steps is not None)
        found.append(np.maximum(errors, np.where(np.isnan(off), np.inf, off)))
        worst = max(worst, drift)
        if law.jump is not None:
            _, z, u = phase.interval(len(phase.mesh) - 1, np.array([1.0]))
            state = np.array(law.jump(phase.begin + phase.duration, state, z, u, trajectory.p)).ravel()
    return found, worst


def _phase(
    law: Dynamics, phase: PhaseTrajectory, p: Vector, size: Vector, state: Vector, integrals: Integrals
) -> tuple[Vector, float, Vector, Vector]:
    """(Local errors, largest accumulated error, final state of the accumulated integration, integrals of intervals).

    The errors have shape (intervals,), the integrals (intervals, integrals).

    `p`: parameters, shape (np,).
    `size`: magnitudes of the states, shape (nx,).
    `state`: initial state of the accumulated integration, shape (nx,).
    """
    count = len(phase.mesh)
    if not len(size):
        return np.zeros(count), 0.0, state, np.zeros((count, 0))
    run, uncontrolled = (_integrator(law, phase.basis, p, size, integrals, by_quads) for by_quads in (True, False))
    scale = integrals.sizes
    borders = phase.borders * phase.duration
    found, drift, exact = np.zeros(count), np.zeros(count), np.zeros((count, len(integrals.values)))
    for k in range(count):
        x, z, _ = phase.interval(k, np.array([0.0, 1.0]))
        width = phase.basis.control + 1
        coefficients = phase.u[:, k * width : (k + 1) * width]
        given = ca.vertcat(phase.begin + borders[k], borders[k + 1] - borders[k], ca.vec(ca.DM(coefficients)))

        def end(begin: Vector, z: Vector = z[:, 0], given: Any = given) -> tuple[Vector, Vector]:
            for integrator in (run, uncontrolled):
                try:
                    reached = integrator(x0=begin / size, z0=z, p=given)
                    return np.array(reached["xf"]).ravel() * size, np.array(reached["qf"]).ravel() * scale
                except RuntimeError:  # an integrand with kinks may need too many steps for its digits
                    continue
            return np.full(len(size), np.nan), np.full(exact.shape[1], np.nan)

        after, exact[k] = end(x[:, 0])
        found[k] = np.max(np.abs(after - x[:, 1]) / size)
        state = end(state)[0] if np.isfinite(state).all() else state
        drift[k] = np.max(np.abs(state - x[:, 1]) / size)
    found, drift = (np.where(np.isnan(v), np.inf, v) for v in (found, drift))
    return found, float(drift.max()), state, exact


def _integrator(law: Dynamics, basis: Basis, p: Vector, size: Vector, integrals: Integrals, by_quads: bool) -> Any:
    """Integrator of one interval, scaled to [0, 1]; its parameters are start time, length and input coefficients."""
    dae = law.dae
    nx, nz, nu = (dae.numel_in(k) for k in (1, 2, 3))
    s, x, z = ca.SX.sym("s"), ca.SX.sym("x", nx), ca.SX.sym("z", nz)
    begin, length, u = ca.SX.sym("begin"), ca.SX.sym("length"), ca.SX.sym("u", nu, basis.control + 1)
    q = basis.control
    weights = ca.vertcat(*(comb(q, i) * s**i * (1 - s) ** (q - i) for i in range(q + 1)))
    scale = ca.DM(size)
    point = (begin + length * s, x * scale, z, u @ weights, p)
    ode, alg, _ = dae(*point)
    system = {"x": x, "z": z, "t": s, "p": ca.vertcat(begin, length, ca.vec(u)), "ode": length * ode / scale}
    options = {"reltol": _TOLERANCE, "abstol": _TOLERANCE / 100, "max_num_steps": 20000, "first_time": 1e-6}
    if len(integrals.values):
        system["quad"] = length * integrals.rates(*point) / ca.DM(integrals.sizes)
        options["quad_err_con"] = by_quads
    if nz:
        system["alg"] = alg
        options["suppress_algebraic"] = True
    return ca.integrator("interval", "idas", system, 0.0, 1.0, {**options, "show_eval_warnings": False})


# Ends that differ by less than this fraction of the duration of all phases are equal: a model may terminate with the
# last phase.
_SAME_END = 1e-3
# Discrete values that differ by less than this fraction of the largest (or of `_SMALL`) are equal.
_SAME_VALUE, _SMALL = 1e-6, 0.1


def replay_error(best: Optimum, intervals: Sequence[int]) -> tuple[float, list[Vector], tuple[str, ...]]:
    """(Largest deviation of the replay, its increase over each interval for each phase, notes on other solutions).

    Deviations are relative to the largest magnitudes of the states. All are infinite if the simulation fails.
    `intervals` are the numbers of intervals of the phases: the increases have shape (intervals,) each.

    Raises OptimizationError: AC704 if an event inside a phase changes a discrete variable, or terminates the run.
    Raises UsageError: AC029 if the equations have lost their digits with the decided parameters.
    """
    try:
        run = best.replay()
    except AcausalError as error:
        if error.code == "AC029":
            raise
        return np.inf, [np.full(n, np.inf) for n in intervals], ()
    _refuse_end(best, run)
    _refuse_changes(best, run)
    deviations = best.distances(run)
    worst = float(np.nanmax(np.abs(deviations), initial=0.0))
    # shape (states, intervals, points of an interval with its start)
    each = deviations.reshape(len(deviations), sum(intervals), len(best.time) // sum(intervals))
    ends, reached = np.zeros((sum(intervals) + 1, len(deviations))), np.zeros(len(deviations))
    for k in range(sum(intervals)):
        known = np.flatnonzero(np.isfinite(each[:, k]).all(axis=0))
        reached = each[:, k, known[-1]] if len(known) else reached
        ends[k + 1] = reached
    increases = np.abs(np.diff(ends, axis=0)).max(axis=1, initial=0.0)
    return worst, np.split(increases, np.cumsum(intervals)[:-1]), on_meeting(run)


def _refuse_end(best: Optimum, run: Result) -> None:
    """AC704 if the model terminates the replay before the end of the solution."""
    end = float(run.time[-1])
    if end < best.time[-1] - _SAME_END * np.ptp(best.time):
        raise OptimizationError(
            "AC704",
            f"the model terminates its run inside a phase, at t = {end:.6g} s: {run.stats.get('terminated', '')}",
            help="avoid it (phase.subject_to(...)), or end the last phase there",
        )


def _refuse_changes(best: Optimum, run: Result) -> None:
    """AC704 if a discrete variable changes inside a phase of the replay."""
    assert best.compiled is not None, "made by Problem.solve"
    keep = best.away_from_events(run)
    for name in best.compiled.states[len(best.compiled.states) - best.compiled.discretes :]:
        optimal, replayed = best[name], np.asarray(run.at(best.time, name))
        # in the solution a count that stays zero is zero only within the tolerance of the solver
        size = max(float(np.abs(optimal).max()), float(np.abs(replayed).max()), _SMALL)
        different = np.flatnonzero(keep & ~(np.abs(optimal - replayed) <= _SAME_VALUE * size))
        if not len(different):
            continue
        t = float(best.time[different[0]])
        causes = [e for e in run.events if name in e.changed and e.time <= t]
        raise OptimizationError(
            "AC704",
            f"an event changes {name} inside a phase, before t = {t:.6g} s",
            evidence=[f"{e.condition}, at t = {e.time:.6g} s" for e in causes[:1]],
            where=tuple(e.where for e in causes[:1] if e.where is not None),
            help="end a phase with it, avoid it (phase.subject_to(...)), or leave it out",
        )
