"""Where the rows of a run do not show what happens between them, the run is repeated with more rows.

Solutions may meet within less time than the distance of two rows. Whatever comes and goes there leaves a trace: the
change of a state does not agree with its rates at both ends, although it does in the intervals around, or the algebraic
variables jump.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.divisors.blocks import Rows
from acausal.simulate.record.record import Recorder

Again = Callable[[int, Vector], Rows]  # repeats the run from one of its rows on, with rows at the given later times

UNTOLD = (
    "between two rows near t = {:.4g} s more happens than they show, and it is too much to be run again in detail: "
    "whether solutions of algebraic equations meet there is not known; compare with a smaller output_interval"
)
_CALLS, _EACH = 16, 8  # repetitions allowed in any case, and steps of the run for which one more is allowed
_POINTS = 48  # rows of a repetition; with fixed steps there is one for each step, and at most `_STEPS`
_STEPS = 5000
_DEPTH = 3  # how often an interval is refined again
_UNLIKE = 8.0  # least ratio of an unexplained change to those in the intervals around
_JUMP, _OFF = 1e-2, 1e-5  # least relative changes of algebraic variables and of states that count
_NEAR = 1e-9  # intervals shorter than this fraction of the time are not refined


def rows_between(
    problem: Problem, recorder: Recorder, whole: Rows, again: Again, step: float | None
) -> tuple[list[Rows], float | None]:
    """Return rows of the run in between, and an instant near which too many would be needed (None if there is none)."""
    found: list[Rows] = []
    states, others = whole[1][: problem.n_dynamic], whole[2]
    sizes = np.append(_OFF * _size(states, problem.scale_x), _JUMP * _size(others, problem.scale_z))
    waiting = [(0, whole, k) for k in _untold(problem, whole, sizes, step)]
    asked = {float(whole[0][k]) for _, _, k in waiting}  # begins of the intervals that are or were waiting
    most = max(_CALLS, recorder.counters.get("steps", len(whole[0])) / _EACH)
    while waiting and len(found) < most:
        depth, at, k = waiting.pop(0)
        a, b = at[0][k : k + 2].tolist()
        count = _POINTS if step is None else int(np.ceil((b - a) / step - 1e-9))
        if count > _STEPS:
            return found, a
        try:
            closer = again(recorder.before(a), np.linspace(a, b, count + 1)[1:])
        except RuntimeError:
            return found, a
        around = (at, slice(max(k - 1, 0), k + 1)), (closer, slice(None)), (at, slice(k + 2, k + 4))
        part = tuple(np.concatenate([rows[j][..., some] for rows, some in around], axis=-1) for j in range(4))
        found.append(part)
        if depth < _DEPTH:
            new = [j for j in _untold(problem, part, sizes, step) if part[0][j] not in asked][:2]
            asked.update(part[0][new].tolist())
            waiting += [(depth + 1, part, j) for j in new]
    return found, float(waiting[0][1][0][waiting[0][2]]) if waiting else None


def _untold(problem: Problem, at: Rows, sizes: Vector, step: float | None) -> list[int]:
    """Return indices of rows before intervals whose ends do not show what happens inside, the largest change first.

    `sizes`: Least changes that count: of states, beyond what their rates explain, and of algebraic variables.
    """
    t, x, z, m = at
    n, gap = problem.n_dynamic, np.diff(t)
    if len(t) < 5:
        return []
    rates = functions_of(problem.compiled).rhs.many(t[:, None], x.T, z.T, problem.u, problem.p, m.T)[:, :n].T
    off = np.diff(x[:n]) - gap * (rates[:, 1:] + rates[:, :-1]) / 2
    values = np.abs(np.concatenate([off, np.diff(z)])) / sizes[:, None]
    values = np.where(np.isfinite(values) & (gap > 0.0) & (m[:, 1:] == m[:, :-1]).all(axis=0), values, 0.0)
    slopes = values / np.where(gap > 0.0, gap, np.inf)
    worst = np.where((values > 1.0) & (slopes > _UNLIKE * _around(slopes)), values, 0.0).max(axis=0, initial=0.0)
    worst[gap <= (_NEAR * (np.abs(t[1:]) + t[-1] - t[0]) if step is None else step * (1 + 1e-9))] = 0.0
    return [k for k in np.argsort(-worst).tolist() if worst[k] > 0.0]


def _size(values: Vector, nominal: Vector) -> Vector:
    return np.asarray(nominal + np.abs(values).max(axis=1))


def _around(values: Vector) -> Vector:
    """Return the larger of the changes that both neighbours of an interval, or both second neighbours, reach."""
    wide = np.pad(values, ((0, 0), (2, 2)), mode="reflect")
    one, two = (np.minimum(wide[:, 2 - d : -2 - d], wide[:, 2 + d : wide.shape[1] - 2 + d]) for d in (1, 2))
    return np.asarray(np.maximum(one, two))
