"""What a run did between two rows that do not tell it: the run is asked again there.

Solutions may meet in less time than two rows are apart. What comes and goes there leaves a trace: states change by what
the rates at both ends do not tell, unlike between the rows around, or the algebraic variables jump.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.record import Recorder

Rows = tuple[Vector, ...]  # times, states, algebraic variables, modes; columns are instants
Again = Callable[[int, Vector], Rows]  # the run from one of its rows on, at some times behind it

UNTOLD = (
    "between two rows near t = {:.4g} s more happens than they tell, and the run cannot be asked for all of it: "
    "whether solutions of algebraic equations meet there is not known; compare with a smaller output_interval"
)
_CALLS, _EACH = 16, 8  # times that a run is asked again, but once for so many of its steps
_POINTS = 48  # rows between two others, but all steps of a fixed length, at most `_STEPS`
_STEPS = 5000
_DEPTH = 3  # how often rows are put between rows
_UNLIKE = 8.0  # what a change untold is by those around
_JUMP, _OFF = 1e-2, 1e-5  # changes of algebraic variables and of states, by their sizes, that count
_NEAR = 1e-9  # distance of rows [of the time] between which there is nothing


def rows_between(
    problem: Problem, recorder: Recorder, whole: Rows, again: Again, step: float | None
) -> tuple[list[Rows], float | None]:
    """Rows of the run between some of its rows, and an instant near which too many would have been needed."""
    found: list[Rows] = []
    states, others = whole[1][: problem.n_dynamic], whole[2]
    sizes = np.append(_OFF * _size(states, problem.scale_x), _JUMP * _size(others, problem.scale_z))
    waiting = [(0, whole, k) for k in _untold(problem, whole, sizes, step)]
    asked = {float(whole[0][k]) for _, _, k in waiting}  # starts of what is or was waiting
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
    """Rows behind which something happens before the next one that they do not tell, the largest first.

    `sizes`: Of changes that count: of states, beside what their rates tell, and of algebraic variables.
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
    """What changes are like between the rows around: of one of two neighbours, or of those beside them."""
    wide = np.pad(values, ((0, 0), (2, 2)), mode="reflect")
    one, two = (np.minimum(wide[:, 2 - d : -2 - d], wide[:, 2 + d : wide.shape[1] - 2 + d]) for d in (1, 2))
    return np.asarray(np.maximum(one, two))
