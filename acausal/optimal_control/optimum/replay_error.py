"""Replay error of an optimum: a simulation with its inputs, which also meets events between the points of the mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, OptimizationError
from acausal.optimal_control.optimum.optimum import Optimum
from acausal.result.result import Result
from acausal.simulate.record.meeting.branches import on_meeting

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
    each = deviations.reshape(len(deviations), sum(intervals), -1)
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
