"""The note on fixed steps that are too long: for what happens within a few of them, or for the whole run.

Eigenvalues at rows (`limit.py`) do not show a contact that lasts one step: a drill that a step carries into a stiff
plate is thrown out of it by the next one. The intervals between rows at which a state bends most are integrated again
with a quarter of the step. Nor do they show errors that add up. Where the rates at rows, or these intervals, show
differences that may add up to more, the run is integrated again with half of the step, which takes twice as long.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.meeting.between import Again
from acausal.simulate.record.record import Recorder

# The most intervals that are integrated again, the most steps in one of them, and the least bend that counts, relative
# to the largest magnitude of a state so far.
_INTERVALS, _STEPS, _BEND = 6, 2000, 1e-2
# The least difference that is noted, on the same scale.
_DIFFERENCE = 0.1
# The number of rows after which states are compared, and the fraction of the run within which rows are one instant.
_ROWS, _SAME_INSTANT = 6, 1e-9
# A state is not judged below this fraction of its nominal value.
_SMALL = 1e-2
# Rows at which rates are compared with changes, the sum of deviations over a run from which it is run again, relative
# like the bend, and the most numbers of a run again.
_SAMPLES, _UNEXPLAINED, _NUMBERS = 64, 0.03, 2 * 10**7


@dataclass(frozen=True, eq=False)
class _Rows:
    """The rows of a run: times, shape (k,), dynamic states and their sizes so far, (n, k).

    `goes_on`: Whether nothing happens between a row and the next, and time passes, shape (k - 1,).
    """

    times: Vector
    x: Vector
    size: Vector
    goes_on: Truth

    def finer(self, first: int, last: int, parts: int, step: float) -> tuple[Vector, int]:
        """Times after `first` up to `last` at which each step is divided, and their number between two rows."""
        gaps = np.diff(self.times[first : last + 1])
        count = parts * int(np.ceil(gaps.max(initial=0.0) / step - 1e-9))
        shares = np.arange(1, count + 1) / max(count, 1)
        return (self.times[first:last, None] + shares * gaps[:, None]).ravel(), count

    def off(self, k: int | slice, found: Vector) -> Vector:
        """How far states are from those found, relative to their size."""
        return np.asarray(np.abs(found - self.x[:, k]) / np.maximum(self.size[:, k], np.abs(found)))


def coarse_steps(problem: Problem, recorder: Recorder, again: Again, step: float) -> tuple[str, ...]:
    """A note if shorter steps than `step` [s] lead to another state some rows later; else nothing.

    Some rows later, because an implicit method forgets what it has made of a fast transient.

    `again`: Integrates from one of the rows on.
    """
    n = problem.n_dynamic
    times, x, z, m = recorder.rows()
    if not n or len(times) < 3:
        return ()
    wide = np.diff(times) > _SAME_INSTANT * (times[-1] - times[0])
    size = np.maximum.accumulate(np.abs(x[:n]), axis=1) + _SMALL * problem.scale_x[:, None]
    rows = _Rows(times, x[:n], size, wide & (m[:, 1:] == m[:, :-1]).all(axis=0))
    states = problem.compiled.states
    unexplained = _unexplained(problem, rows, x, z, m)
    for first, last, found in _by_quarters(rows, again, step):
        worst = int(np.argmax(off := rows.off(last, found)))
        if not off[worst] <= _DIFFERENCE:
            return (_note(f"at t = {times[first]:.6g} s", "a quarter", step, states[worst], rows, worst, last, found),)
        unexplained += off[worst]
    if not unexplained <= _UNEXPLAINED:
        for first, last, all_found in _by_halves(rows, again, step):
            off = rows.off(slice(first + 1, last + 1), all_found)
            far = ~(off <= _DIFFERENCE)
            later = np.minimum(np.arange(last - first) + _ROWS, last - first - 1)
            lasting = (far & far[:, later]).any(axis=0)
            if lasting.any():
                k = int(np.argmax(lasting))
                worst = int(np.argmax(np.where(far[:, k] & far[:, later[k]], off[:, k], 0.0)))
                at, found = first + 1 + k, all_found[:, k]
                return (_note("for the whole run", "half", step, states[worst], rows, worst, at, found),)
    return ()


def _note(where: str, part: str, step: float, name: str, rows: _Rows, worst: int, last: int, found: Vector) -> str:
    return (
        f"steps of {step:.4g} s are too long {where}: with {part} of that {name} is {found[worst]:.4g} "
        f"at t = {rows.times[last]:.6g} s, not {rows.x[worst, last]:.4g}; take shorter ones, or a solver that "
        "chooses them"
    )


def _by_quarters(rows: _Rows, again: Again, step: float) -> Iterator[tuple[int, int, Vector]]:
    """The rows before the intervals that bend most, rows some intervals later, and states there by quarter steps."""
    n = len(rows.x)
    for k in _bends(rows):
        last = k + int(np.argmin([*rows.goes_on[k : k + _ROWS], False]))
        quarters, count = rows.finer(k, last, 4, step)
        if 0 < (last - k) * count <= 4 * _STEPS:
            try:
                yield k, last, again(k, quarters)[1][:n, -1]
            except RuntimeError:
                continue


def _by_halves(rows: _Rows, again: Again, step: float) -> Iterator[tuple[int, int, Vector]]:
    """First and last rows of stretches without events, and states by half steps at all rows after the first."""
    n = len(rows.x)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows.goes_on, [False]]).astype(int)))
    for first, last in edges.reshape(-1, 2).tolist():
        _, count = rows.finer(first, last, 2, step)
        last = min(last, first + max(1, _NUMBERS // (n * count)))
        halves, count = rows.finer(first, last, 2, step)
        try:
            yield first, last, again(first, halves)[1][:n, count - 1 :: count]
        except RuntimeError:
            continue


def _unexplained(problem: Problem, rows: _Rows, x: Vector, z: Vector, m: Vector) -> float:
    """How much states change in the run beyond what rates at the rows explain by Simpson's rule, relative to sizes.

    The rule is as accurate as methods of order 4, so what it does not explain is about the error of methods up to that
    order. Of better ones, and of rows far apart, it is more: a run again decides.
    """
    t, gaps = rows.times, np.diff(rows.times)
    even = rows.goes_on[1:] & rows.goes_on[:-1] & (np.abs(np.diff(gaps)) <= 1e-6 * gaps[1:])
    first = np.flatnonzero(even)
    if not len(first):
        return 0.0
    first = np.unique(first[np.linspace(0, len(first) - 1, _SAMPLES).astype(int)])
    k = (first[:, None] + np.arange(3)).ravel()
    n = problem.n_dynamic
    values = functions_of(problem.compiled).rhs.many(
        t[k][:, None], x[:, k].T, z[:, k].T, problem.u, problem.p, m[:, k].T
    )
    rates = values[:, :n].T.reshape(n, -1, 3)
    off = rows.x[:, first + 2] - rows.x[:, first] - gaps[first] / 3.0 * (rates @ np.array([1.0, 4.0, 1.0]))
    shares = np.abs(off) / rows.size[:, first + 2]
    return float(np.nan_to_num(shares, nan=np.inf).mean(axis=1).max() * len(gaps) / 2)


def _bends(rows: _Rows) -> list[int]:
    """The rows before intervals in which the mean rate of a state differs most from those beside it."""
    goes_on = rows.goes_on
    gaps = np.where(goes_on, np.diff(rows.times), np.inf)
    change = np.abs(np.diff(np.diff(rows.x) / gaps)) * (goes_on[1:] & goes_on[:-1])
    none = np.zeros((len(rows.x), 1))
    bend = np.maximum(np.hstack([none, change]), np.hstack([change, none]))
    worst = (bend * np.where(goes_on, gaps, 0.0) / rows.size[:, 1:]).max(axis=0)
    worst[~np.isfinite(worst)] = 0.0
    return [k for k in np.argsort(-worst, kind="stable")[:_INTERVALS].tolist() if worst[k] > _BEND]
