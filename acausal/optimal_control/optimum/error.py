"""Errors of an optimum: of the collocation, from each interval integrated by IDAS, and of a run with its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
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
from acausal.simulate.record.violations import on_limits

_TOLERANCE = 1e-10
# Instants closer to the end of an interval, as a fraction of it, are its end; and what is left out before the others,
# at which functions have the value after the switch.
_NEAR_BORDER, _BEFORE = 1e-6, 1e-10


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
    instants = np.unique(np.array(q.compiled.instants(trajectory.p)).ravel())
    size = np.max([np.abs(phase.x).max(axis=1, initial=0.0) for phase in trajectory.phases], axis=0)
    size = np.where(size > 0.0, size, np.array(q.x.nominal))
    found, worst, state = [], 0.0, trajectory.phases[0].x[:, 0]
    integrals = integrals_of(program, solution, [law.dae for law in laws])
    for law, phase, own in zip(laws, trajectory.phases, integrals, strict=True):
        errors, drift, state, exact = _phase(law, phase, trajectory.p, size, state, own, instants)
        off = own.errors(phase, trajectory.p, exact, program.steps is not None)
        found.append(np.maximum(errors, np.where(np.isnan(off), np.inf, off)))
        worst = max(worst, drift)
        if law.jump is not None:
            _, z, u = phase.interval(len(phase.mesh) - 1, np.array([1.0]))
            state = np.array(law.jump(phase.begin + phase.duration, state, z, u, trajectory.p)).ravel()
    return found, worst


def _phase(
    law: Dynamics,
    phase: PhaseTrajectory,
    p: Vector,
    size: Vector,
    state: Vector,
    integrals: Integrals,
    instants: Vector,
) -> tuple[Vector, float, Vector, Vector]:
    """(Local errors, largest accumulated error, final state of the accumulated integration, integrals of intervals).

    The errors have shape (intervals,), the integrals (intervals, integrals).

    `p`: parameters, shape (np,).
    `size`: magnitudes of the states, shape (nx,).
    `state`: initial state of the accumulated integration, shape (nx,).
    `instants`: times [s] at which sources switch, where integrators stop: they would step over a pulse.
    """
    count = len(phase.mesh)
    if not len(size) and not len(integrals.values):
        return np.zeros(count), 0.0, state, np.zeros((count, 0))
    run, scale = _integrator(law, phase.basis, p, size, integrals), np.concatenate([size, integrals.sizes])
    borders = phase.borders * phase.duration
    found, drift, exact = np.zeros(count), np.zeros(count), np.zeros((count, len(integrals.values)))
    for k in range(count):
        x, z, _ = phase.interval(k, np.array([0.0, 1.0]))
        width = phase.basis.control + 1
        coefficients = phase.u[:, k * width : (k + 1) * width]
        given = [phase.begin + borders[k], borders[k + 1] - borders[k], *coefficients.ravel(order="F")]
        cuts = (instants - given[0]) / given[1]
        cuts = np.array([0.0, *cuts[(cuts > _NEAR_BORDER) & (cuts < 1 - _NEAR_BORDER)], 1.0])

        def end(begin: Vector, z: Vector = z[:, 0], given: Any = given, cuts: Vector = cuts) -> tuple[Vector, Vector]:
            both = np.concatenate([begin / size, np.zeros(exact.shape[1])])
            try:
                for first, last in pairwise(cuts):
                    before = last - first - (_BEFORE if last < 1.0 else 0.0)
                    part = run(x0=both, z0=z, p=[*given[:2], first, before, *given[2:]])
                    both, z = np.array(part["xf"]).ravel(), part["zf"]
            except RuntimeError:
                both = np.full(len(scale), np.nan)
            found = both * scale
            return found[: len(size)], found[len(size) :]

        after, exact[k] = end(x[:, 0])
        found[k] = np.max(np.abs(after - x[:, 1]) / size, initial=0.0)
        state = end(state)[0] if len(size) and np.isfinite(state).all() else state
        drift[k] = np.max(np.abs(state - x[:, 1]) / size, initial=0.0)
    found, drift = (np.where(np.isnan(v), np.inf, v) for v in (found, drift))
    return found, float(drift.max()), state, exact


def _integrator(law: Dynamics, basis: Basis, p: Vector, size: Vector, integrals: Integrals) -> Any:
    """Integrator of a part of an interval, scaled to [0, 1], with the states and then the integrals as its states.

    Its parameters are start time and length of the interval, start and length of the part as fractions of it, and the
    coefficients of the inputs. Integrals are no quadratures of IDAS, because those do not count for the order of the
    method: one that fits a state of constant rate needs tens of thousands of steps for the square of that state.
    """
    dae = law.dae
    nx, nz, nu = (dae.numel_in(k) for k in (1, 2, 3))
    s, x, z = ca.SX.sym("s"), ca.SX.sym("x", nx), ca.SX.sym("z", nz)
    begin, length, u = ca.SX.sym("begin"), ca.SX.sym("length"), ca.SX.sym("u", nu, basis.control + 1)
    first, share = ca.SX.sym("first"), ca.SX.sym("share")
    q, at = basis.control, first + share * s
    weights = ca.vertcat(*(comb(q, i) * at**i * (1 - at) ** (q - i) for i in range(q + 1)))
    scale = ca.DM(size)
    point = (begin + length * at, x * scale, z, u @ weights, p)
    ode, alg, _ = dae(*point)
    both = ca.vertcat(x, ca.SX.sym("q", len(integrals.values)))
    rates = ca.vertcat(ode / scale, integrals.rates(*point) / ca.DM(integrals.sizes))
    system = {"x": both, "z": z, "t": s, "p": ca.vertcat(begin, length, first, share, ca.vec(u))}
    system["ode"] = length * share * rates
    options = {"reltol": _TOLERANCE, "abstol": _TOLERANCE / 100, "max_num_steps": 20000, "first_time": 1e-6}
    if nz:
        system["alg"] = alg
        options["suppress_algebraic"] = True
    return ca.integrator("interval", "idas", system, 0.0, 1.0, {**options, "show_eval_warnings": False})


# Ends that differ by less than this fraction of the duration of all phases are equal: a model may terminate with the
# last phase.
_SAME_END = 1e-3
# Discrete values that differ by less than this fraction of the largest (or of `_SMALL`) are equal.
_SAME_VALUE, _SMALL = 1e-6, 0.1


@dataclass(frozen=True, eq=False)
class Replay:
    """A run with the optimal inputs; None if it fails, for the reason `failure`.

    `drift` is its largest deviation from the solution, `increases` what each interval adds to it, shape (intervals,)
    for each phase, relative to the largest magnitudes of the states; infinite if the run fails. `notes` are on other
    solutions, and on limits of variables that the run leaves.
    """

    run: Result | None
    drift: float
    increases: list[Vector]
    notes: tuple[str, ...] = ()
    failure: str = ""


def replayed(best: Optimum, intervals: Sequence[int]) -> Replay:
    """The replay of a solution; `intervals` are the numbers of intervals of the phases.

    Raises OptimizationError: AC704 if an event inside a phase changes a discrete variable, or terminates the run.
    Raises UsageError: AC029 if the equations have lost their digits with the decided parameters.
    """
    try:
        run = best.replay()
    except AcausalError as error:
        if error.code == "AC029":
            raise
        reason = f"{error.code}: {error.fact}"
        return Replay(None, np.inf, [np.full(n, np.inf) for n in intervals], failure=reason)
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
    return Replay(run, worst, np.split(increases, np.cumsum(intervals)[:-1]), (*on_meeting(run), *on_limits(run)))


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
