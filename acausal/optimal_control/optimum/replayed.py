"""What acts between the points of a mesh: the run of the model with the answer, which looks there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, OptimizationError
from acausal.optimal_control.optimum.optimum import Optimum
from acausal.result.result import Result

# Ends this near to each other are one, by the length of all phases: a model may end its run where the last phase does.
_SAME_END = 1e-3


def elsewhere(best: Optimum, intervals: Sequence[int]) -> tuple[float, list[Vector]]:
    """How far a run with the answer goes elsewhere, by the largest magnitude of a state.

    Then how much farther it goes in each interval, an array for each phase of so many `intervals`. All are infinite
    where the run does not get to the end.

    Raises OptimizationError: AC704 where an event within a phase changes a discrete variable, or ends the run.
    """
    try:
        run = best.replay()
    except AcausalError:
        return np.inf, [np.full(n, np.inf) for n in intervals]
    _refuse_end(best, run)
    _refuse_changes(best, run)
    off = best.distances(run)
    worst = float(np.nanmax(np.abs(off), initial=0.0))
    # the start and the points of each interval stand one behind the other
    each = off.reshape(len(off), sum(intervals), -1)
    ends, reached = np.zeros((sum(intervals) + 1, len(off))), np.zeros(len(off))
    for k in range(sum(intervals)):
        known = np.flatnonzero(np.isfinite(each[:, k]).all(axis=0))
        reached = each[:, k, known[-1]] if len(known) else reached
        ends[k + 1] = reached
    farther = np.abs(np.diff(ends, axis=0)).max(axis=1, initial=0.0)
    return worst, np.split(farther, np.cumsum(intervals)[:-1])


def _refuse_end(best: Optimum, run: Result) -> None:
    """AC704 for a run that the model ends before the answer does."""
    end = float(run.time[-1])
    if end < best.time[-1] - _SAME_END * np.ptp(best.time):
        raise OptimizationError(
            "AC704",
            f"the model ends its run inside of a phase, at t = {end:.6g} s: {run.stats.get('terminated', '')}",
            help="keep away from it (phase.subject_to(...)), or end the last phase there",
        )


def _refuse_changes(best: Optimum, run: Result) -> None:
    """AC704 for what stays within the phases of the answer, and changes in a run."""
    assert best.compiled is not None, "made by Problem.solve"
    keep = best.away_from_events(run)
    for name in best.compiled.states[len(best.compiled.states) - best.compiled.discretes :]:
        own, other = best[name], np.asarray(run.at(best.time, name))
        apart = np.flatnonzero(keep & ~(np.abs(own - other) <= 1e-9 * np.maximum(np.abs(own), np.abs(other))))
        if not len(apart):
            continue
        t = float(best.time[apart[0]])
        causes = [e for e in run.events if name in e.changed and e.time <= t]
        raise OptimizationError(
            "AC704",
            f"an event changes {name} inside of a phase, before t = {t:.6g} s",
            evidence=[f"{e.condition}, at t = {e.time:.6g} s" for e in causes[:1]],
            where=tuple(e.where for e in causes[:1] if e.where is not None),
            help="end a phase with it, keep away from it (phase.subject_to(...)), or leave it out",
        )
