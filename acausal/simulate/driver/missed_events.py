"""Steps that pass over what a steep function does between their ends: found behind a solver, and solved again.

A solver sees a rate where it evaluates it. `1 + tanh(k*(sin(w*t) - 0.999))` is zero but for a moment in each period;
where no evaluation falls into that moment, nothing tells of it. But the argument of the function is smooth and is known
wherever the solution is: what a solver hands over is searched for the instants at which such an argument turns, or a
step is in its middle (`acausal.analyse.events.steep`), for between them nothing can come and go. There the solution
that was handed over is asked whether it satisfies the equations; where it does not, it is integrated again up to that
instant, which is the end of a step then, and from there on. If this leads back to the next row, nothing was missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.driver.adaptive_sampling import between, dense, merged
from acausal.simulate.equations.arguments import Arguments, arguments
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.location.between import interpolated, steady
from acausal.simulate.events.location.mesh import even
from acausal.simulate.events.location.rows import nearest, roots, slopes, told
from acausal.simulate.solvers.base import on_equations
from acausal.simulate.solvers.segment import Piece, Segment, add_counters

Integrate = Callable[[Problem, Segment], Piece]
# Rows of a piece at least, and at most where arguments are not resolved by fewer. Many functions, as of contacts,
# have fewer: `_VALUES` of their arguments in all. Pieces of more steps are not searched: between its rows such a
# solution is no polynomial, and every place would be integrated again.
_FEWEST, _MOST, _VALUES = 32, 20_000, 400_000
# Steps of a DAE between neighbouring rows that is integrated once more: begun at a row, it may crawl.
_MOST_AGAIN = 5000
_FINER = 8
# Steps for each row up to which few rows and their rates tell how states go between them.
_RESOLVED = 10.0
# An argument is resolved where every other row tells the rows between to this share of its variation there.
_SHARE = 0.2
# Share of rows that may not be resolved: kinks, and what follows a start.
_KINKS = 0.1
# How far the equations may not be satisfied, and two solutions may be apart, in tolerances of the solver.
_DEFECT, _SAME = 1.0, 10.0
# Share of the tolerance at which two solutions that are apart are told from each other.
_STRICTER = 1e-2
# A rate that is another by more than this share was not seen at all.
_LARGE = 0.5
_NODES = 8
# Larger arguments are this, with room for products and slopes.
_LARGEST = 1e100
# How many rows before what was missed is awake may be at most.
_BACK = 64
# A function is told by the rows around where it is what they say to this share; less than nothing is none.
_TOLD, _NOTHING, _FEW = 0.02, 1e-14, 4
# A function that is the same to this share at a turn and at the rows around it rests.
_QUIET = 1e-3
# Parts of what is between two rows, where an argument turns or crosses its middle.
_DENSER = 8
# How often the way to such an instant is halved for what comes to be awake on it.
_GRADES = 40
# Rows are too close for that where they are one to this share of the time.
_CLOSE = 1e-11
_ONE = 1e-13
# How far beside such an instant a function is looked at too, in distances of rows.
_BESIDE = 0.2
# Points are one that are closer than this share of the rows around.
_NEAR = 1e-6
_NOWHERE: tuple[Vector, Truth] = np.zeros(0), np.zeros(0, dtype=bool)
# What is solved at once behind what was missed, by how far that was; and how it grows.
_BEHIND, _GROWTH = 2.0, 4.0


@dataclass(frozen=True, eq=False)
class MissedEvents:
    """Integrates as `solve` does, and again what it has passed over; `skip` is told where a piece is not searched."""

    solve: Integrate
    skip: Callable[[float], None]

    def __call__(self, problem: Problem, segment: Segment) -> Piece:
        """The solution at the times of a segment; RuntimeError when the solver cannot go on."""
        search = self._search(problem, segment)
        return self.solve(problem, segment) if search is None else search.integrated(segment)

    def clears(self, problem: Problem, segment: Segment, piece: Piece) -> bool:
        """Whether a solution that was found at the times of a segment has passed over nothing, as far as its rows tell.

        That of a solver which stops at events by itself: what is not cleared is found again by one that does not.
        """
        search = self._search(problem, segment)
        return search is None or search.is_clear(segment, piece)

    def places(self, problem: Problem, segment: Segment) -> Vector:
        """Instants of a segment at which something steep may come and go, for who integrates it in another way."""
        search = self._search(problem, segment)
        return np.zeros(0) if search is None else search.places(segment)

    def _search(self, problem: Problem, segment: Segment) -> _Search | None:
        """None where nothing steep has an effect."""
        known = arguments(problem.compiled) if problem.n_dynamic and segment.step is None else None
        if known is None:
            return None
        awake = known.awake(segment.p)
        return _Search(self.solve, self.skip, problem, known, awake) if awake.any() else None


@dataclass(frozen=True, eq=False)
class _Rows:
    """Points of one solution: the start of a segment, and what was handed over; shapes (n,), (nx, n) and (nz, n).

    With the arguments and middles there, shape (n, columns). `dense` are these rows and more instants, between which
    cubics tell the arguments (`adaptive_sampling.dense`), and the columns there; `is_dense` says whether these are all,
    `is_steep` which of the columns are steep where they go.
    """

    times: Vector
    x: Vector
    z: Vector
    values: Vector
    dense: tuple[Vector, Vector]
    is_dense: bool
    is_steep: Truth


@dataclass(frozen=True, eq=False)
class _Search:
    solve: Integrate
    skip: Callable[[float], None]
    problem: Problem
    known: Arguments
    awake: Truth

    @property
    def _most(self) -> int:
        """Rows, or steps, at most."""
        return min(_MOST, _VALUES // self.known.levels.count)

    def integrated(self, segment: Segment) -> Piece:
        """The segment, piece by piece once something was missed."""
        parts: list[Piece] = []
        asked, reach, whole = segment, np.inf, segment
        while True:
            piece, done = self._part(asked, reach)
            parts.append(piece)
            if done is None:
                return _joined(parts)
            here, x, z, length = done
            later = whole.times[whole.times > here]
            if not len(later):
                return _joined(parts)
            whole = replace(whole, start=here, times=later, x=x, z=z, shares=None, first=0.0)
            reach = here + length
            asked = whole

    def is_clear(self, segment: Segment, piece: Piece) -> bool:
        """Whether nothing can have been passed over between rows, few of which are taken to tell how states go."""
        steps = piece.counters.get("steps", 0.0)
        rows = self._rows(segment, piece)
        if len(rows.times) < 2:
            return True
        if len(rows.times) < _FEWEST:
            if steps <= _RESOLVED * len(rows.times) and self._rests_by_rates(segment, rows):
                return True
            return self._is_found_again(segment, piece)
        if not rows.is_steep.any():
            return True
        if steps > self._most or not self._are_resolved(segment, rows):
            return self._is_found_again(segment, piece)
        places, doubt = self._places(segment, rows, steps)
        if doubt.any() and len(rows.times) < steps:
            return self._is_found_again(segment, piece)
        return all(
            self._again(segment, rows, *suspect) is None for suspect in self._suspects(segment, rows, places, doubt)
        )

    def places(self, segment: Segment) -> Vector:
        """Instants at which an argument turns or is in the middle of a step, in order."""
        wide = _finer(segment, _FEWEST)
        while True:
            piece = self.integrated(wide)
            rows = self._rows(wide, piece)
            if self._are_resolved(wide, rows) or _FINER * len(wide.times) > self._most:
                break
            wide = _finer(wide, _FINER * len(wide.times))
        places = self._places(wide, rows, piece.counters.get("steps", 1.0))[0]
        return np.concatenate([places, *(self._around(wide, rows, places, sign) for sign in (-1.0, 1.0))])

    def _around(self, segment: Segment, rows: _Rows, places: Vector, sign: float) -> Vector:
        """Instants before or behind places, ever closer to them, between which a function there goes another way."""
        if not len(places):
            return np.zeros(0)
        low, high = rows.times[0], rows.times[-1]
        room = np.where(sign < 0.0, np.diff(places, prepend=low), np.diff(places, append=high))
        shares = np.append(0.5 ** np.arange(_GRADES), 0.0)
        at = np.clip(places[:, None] + sign * room[:, None] * shares, low, high)
        values = self._between(segment, rows, at.ravel())
        found = self.known.levels.heights(values).reshape(*at.shape, -1)
        apart = np.abs(np.diff(found, axis=1)) > _NOTHING * np.abs(found).max(axis=1, keepdims=True)
        changes = apart.any(axis=2)
        return np.asarray(at[:, :-1][changes & (at[:, :-1] > low) & (at[:, :-1] < high)])

    def _is_found_again(self, segment: Segment, piece: Piece) -> bool:
        """Whether a solution with more rows leads to the same end, and has passed over nothing.

        Where it leads elsewhere it may be worse than the one that was found, which begins at a kink: a finer one tells.
        """
        # as many as would tell most functions between them: fewer would only be followed by more
        count = max(_FEWEST, min(2 * int(piece.counters.get("steps", 0.0)), self._most))
        wide = _finer(replace(segment, shares=None, partial=False, step_budget=None, first=0.0), count)
        for share in (1.0, _STRICTER):
            try:
                again, done = self._part(replace(wide, tolerances=segment.tolerances.scaled(share, least=_ONE)), np.inf)
            except RuntimeError:
                return False
            if done is not None or again.stopped:
                return False
            if self._is_same(segment, again.x[:, -1], piece.x[:, -1]):
                return True
        return False

    def _part(self, segment: Segment, reach: float) -> tuple[Piece, tuple[float, Vector, Vector, float] | None]:
        """Rows of a segment up to the first that may be wrong, or up to `reach`; where it goes on, and how far."""
        is_last = reach >= segment.times[-1]
        inside = segment.times if is_last else segment.times[segment.times < reach]
        wide = segment
        if not is_last:
            wide = replace(segment, times=np.append(inside, reach))
        wide, piece, rows = self._resolved(wide)
        steps = int(piece.counters.get("steps", 0.0))
        if is_long := steps > self._most and bool(rows.is_steep.any()):
            self.skip(segment.start)
        places, doubt = _NOWHERE if is_long else self._places(wide, rows, steps)
        count = min(2 * steps, self._most)  # between rows that are farther apart than steps little is known
        if doubt.any() and len(rows.times) < min(steps, count // 2) and wide.shares is None and not wide.partial:
            wide = _finer(wide, count)
            piece = self.solve(self.problem, wide)
            rows = self._rows(wide, piece)
        times = wide.times[: piece.x.shape[1]]
        asked = np.isin(times, segment.times)
        for low, high, points in self._suspects(wide, rows, places, doubt):
            again = self._again(wide, rows, low, high, points)
            if again is None:
                continue
            here = float(rows.times[high])
            # by the row of each, not by equal times: what is one with a row to rounding is no row of its own
            row = np.searchsorted(rows.times, times, side="right") - 1
            keep, own = asked & (row <= low), row[asked & (row > low) & (times <= here)] - low - 1
            first = Piece(piece.x[:, keep], piece.z[:, keep], piece.counters)
            second = Piece(again.x[:, own], again.z[:, own], again.counters)
            gone = here - segment.start
            return _joined([first, second]), (here, again.x[:, -1], again.z[:, -1], _BEHIND * gone)
        found = Piece(piece.x[:, asked], piece.z[:, asked], piece.counters, piece.stopped)
        if is_last or piece.stopped:
            return found, None
        return found, (reach, piece.x[:, -1], piece.z[:, -1], _GROWTH * (reach - segment.start))

    def _resolved(self, segment: Segment) -> tuple[Segment, Piece, _Rows]:
        """A solution with rows so close that they tell how arguments go between them."""
        wide = segment
        if segment.shares is None and len(segment.times) < _FEWEST:
            wide = _finer(segment, _FEWEST)
        elif segment.shares is not None and not segment.partial:  # once more to an event, from far before it
            shares = even(_FEWEST)
            times = segment.start + shares * (segment.times[-1] - segment.start)
            wide = replace(segment, times=np.append(times[:-1], segment.times[-1]), shares=shares)
        while True:
            piece = self.solve(self.problem, wide)
            rows = self._rows(wide, piece)
            if piece.x.shape[1] < 2 * _NODES or self._are_resolved(wide, rows) or segment.partial:
                return wide, piece, rows
            if max(len(wide.times) * _FINER, piece.counters.get("steps", 0.0)) > self._most:
                return wide, piece, rows
            wide = _finer(replace(wide, shares=None, first=0.0), _FINER * len(wide.times))

    def _are_resolved(self, segment: Segment, rows: _Rows) -> bool:
        """Whether every other row tells the ones between."""
        first = self.known.levels.count
        if not rows.is_steep[:first].any():
            return True
        times, values = rows.times[1:], rows.values[1:, :first][:, rows.is_steep[:first]]
        found = interpolated(times[::2], values[::2], times[1:-1:2], 6)[0]
        off = np.abs(found - values[1:-1:2])
        moved = np.abs(np.diff(values, axis=0))
        local = np.maximum(moved[:-1:2][: len(off)], moved[1::2][: len(off)])
        size = replace(segment.tolerances, factor=0.0).of(np.abs(values).max(axis=0))
        return bool(((off > _SHARE * local + size).mean(axis=0) <= _KINKS).all())

    def _rows(self, segment: Segment, piece: Piece) -> _Rows:
        """The start of a segment and what was handed over of it."""
        times = np.append(segment.start, segment.times[: piece.x.shape[1]])
        # instants that are one to rounding tell nothing of what is between them
        keep = np.append(True, np.diff(times) > _ONE * np.abs(times[-1] - times[0]))
        x, z = np.column_stack([segment.x, piece.x]), np.column_stack([segment.z, piece.z])
        times, x, z = times[keep], x[:, keep], z[:, keep]
        values = self._values(segment, times, x, z)
        rows = _Rows(times, x, z, values, (times, values), True, self._are_steep(values))
        if len(times) < _FEW:
            return rows
        found, is_dense = self._dense(times, values, partial(self._between, segment, rows))
        if len(found[0]) == len(times):
            return rows
        return replace(rows, dense=found, is_dense=is_dense, is_steep=rows.is_steep | self._are_steep(found[1]))

    def _dense(
        self, times: Vector, values: Vector, at: Callable[[Vector], Vector]
    ) -> tuple[tuple[Vector, Vector], bool]:
        own = self.awake[: self.known.levels.count]
        times, values, is_dense = dense(times, values, self.known.levels, own, at)
        return (times, values), is_dense

    def _are_steep(self, values: Vector) -> Truth:
        return np.asarray(self.known.are_steep(values) & self.awake)

    def _values(self, segment: Segment, times: Vector, x: Vector, z: Vector) -> Vector:
        p = self.problem
        found = self.known.at(times, x, z, p.u, p.p, segment.p)
        return np.nan_to_num(np.clip(found, -_LARGEST, _LARGEST))

    def _suspects(
        self, segment: Segment, rows: _Rows, places: Vector, doubt: Truth
    ) -> Iterator[tuple[int, int, Vector]]:
        """Where equations are not satisfied: first and last row around, and the instants to stop at in between."""
        if not len(places):
            return
        bad = np.unique(places[self._bad(segment, rows, places, doubt)])
        k = np.clip(np.searchsorted(rows.times, bad, side="right"), 1, len(rows.times) - 1)
        while len(bad):
            high = int(k[0])
            here = k == high
            yield self._asleep(segment, rows, high), high, bad[here]
            bad, k = bad[~here], k[~here]

    def _bad(self, segment: Segment, rows: _Rows, places: Vector, doubt: Truth) -> Truth:
        """At which places the solution does not satisfy its equations, whose functions the rows do not tell."""
        off, large = self._defects(segment, rows, places)
        return np.asarray(large | ((off > _DEFECT) & doubt))

    def _asleep(self, segment: Segment, rows: _Rows, high: int) -> int:
        """The last row that stands before all that may have been missed."""
        before = np.arange(max(high - _BACK, 1), high)
        if not len(before):
            return 0
        good = self._defects(segment, rows, rows.times[before])[0] <= _DEFECT
        if good[0] or before[0] == 1:
            k = int(before[np.flatnonzero(good)[-1]]) if good.any() else 0
            return max(min(k, high - 1) - 1, 0)
        return max(high - 2, 0)  # rows are never as good as that

    def _denser(self, segment: Segment, rows: _Rows, behind: NDArray[np.intp]) -> tuple[Vector, Vector]:
        """Instants, and columns of values there, with more of them around some.

        States between rows are polynomials; what is a function of them need not be as good a one.
        """
        times, values = rows.dense
        near = np.unique(np.clip(behind[:, None] + np.array([-1, 0, 1]), 0, len(times) - 2))
        near = near[np.diff(times)[near] > _CLOSE * np.abs(times).max()]
        if not len(near):
            return times, values
        gap = times[near + 1] - times[near]
        more = (times[near][:, None] + gap[:, None] * np.arange(1, _DENSER) / _DENSER).ravel()
        return merged(times, values, more, self._between(segment, rows, more))

    def _between(self, segment: Segment, rows: _Rows, times: Vector, is_solved: bool = False) -> Vector:
        """Columns of values at instants between rows, with algebraic variables on their equations or between rows."""
        both = steady(rows.times, np.vstack([rows.x, rows.z]).T, times, min(_NODES, len(rows.times)))
        x, z = both[:, : len(rows.x)].T, both[:, len(rows.x) :].T
        if is_solved:
            with suppress(RuntimeError):
                z = on_equations(self.problem, replace(segment, times=times), x, z)
        return self._values(segment, times, x, z)

    def _rests_by_rates(self, segment: Segment, rows: _Rows) -> bool:
        """Whether nothing is steep between rows, where cubics with their states and rates tell how states go."""
        p, n, times = self.problem, self.problem.n_dynamic, rows.times
        rates = functions_of(p.compiled).rhs.many(times[:, None], rows.x.T, rows.z.T, p.u, p.p, segment.p)[:, :n]

        def at(t: Vector) -> Vector:
            k = np.clip(np.searchsorted(times, t), 1, len(times) - 1)
            h, x = (times[k] - times[k - 1])[:, None], rows.x.T[:, :n]
            s, rise = (t - times[k - 1])[:, None] / h, x[k] - x[k - 1]
            bend = (1.0 - s) * (h * rates[k - 1] - rise) - s * (h * rates[k] - rise)
            x = x[k - 1] + s * rise + s * (1.0 - s) * bend
            others = np.repeat(rows.x[n:, :1], len(t), axis=1)
            return self._values(segment, t, np.vstack([x.T, others]), np.zeros((0, len(t))))

        more = _finer(replace(segment, times=times[1:]), _FEWEST).times
        (_, values), is_dense = self._dense(np.append(times[:1], more), np.vstack([rows.values[:1], at(more)]), at)
        return is_dense and not self._are_steep(values).any()

    def _places(self, segment: Segment, rows: _Rows, steps: float) -> tuple[Vector, Truth]:
        """Instants at which something steep may come and go, ascending; and where rows do not tell its function.

        An argument turns there, or is in the middle of a step, or a function has become another one by some factor.
        Rows do not tell a function where those around, no closer than the `steps` that were taken are, say another
        value.
        """
        if len(rows.times) < _FEW or not rows.is_steep.any():
            return _NOWHERE
        if not rows.is_dense:
            self.skip(segment.start)
        found, owners = self._turns(segment, rows)
        doubt = self._are_doubtful(segment, rows, steps, found, owners)
        awake = self._awake(segment, rows, steps, found)
        found, doubt = np.append(found, awake), np.append(doubt, np.ones(len(awake), dtype=bool))
        order = np.argsort(found)
        return found[order], doubt[order]

    def _turns(self, segment: Segment, rows: _Rows) -> tuple[Vector, NDArray[np.int64]]:
        """Instants at which an argument turns or is in the middle of a step, and the places of these arguments."""
        (times, values), first = rows.dense, self.known.levels.count
        turns = crossed = np.zeros(0, dtype=np.intp)
        for is_denser in (False, True):
            if is_denser:
                times, values = self._denser(segment, rows, np.concatenate([turns, crossed]))
            rates = slopes(times, values)
            is_down, is_below = rates < 0.0, values[:, first:] < 0.0  # a row may stand where one of them is zero
            turns, columns = np.nonzero((is_down[:-1] != is_down[1:]) & rows.is_steep)
            crossed, own = np.nonzero((is_below[:-1] != is_below[1:]) & rows.is_steep[first:])
            if not len(turns) and not len(crossed):
                return np.zeros(0), np.zeros(0, dtype=np.int64)
        own += first
        found = roots(times, rates, columns, turns)
        # a middle that turns may be zero on both sides of this
        inside = np.flatnonzero(columns >= first)
        k, j, there = turns[inside], columns[inside], found[inside]
        top = interpolated(times, values, there, min(_NODES, len(times)))[0][np.arange(len(j)), j]
        both = (top * values[k, j] < 0.0) & (top * values[k + 1, j] < 0.0)
        k, j, there, top = k[both], j[both], there[both], top[both]
        columns, own = np.concatenate([columns, own, j, j]), np.concatenate([own, j, j])
        behind = np.concatenate([crossed, k, k])
        begin, end = (np.stack([times[n], values[n, own]]) for n in (behind, behind + 1))
        end[:, len(crossed) : len(crossed) + len(k)] = begin[:, len(crossed) + len(k) :] = there, top
        found = np.append(found, roots(times, values, own, behind, (begin, end)))
        owners = self.known.owners[columns]
        moves = self._move(segment, rows, found, owners)
        return found[moves], owners[moves]

    def _awake(self, segment: Segment, rows: _Rows, steps: float, turns: Vector) -> Vector:
        """Instants at which functions have become others, and the solution does not satisfy its equations.

        Of those between two rows the first, the last, and the one where it is farthest off: a step that ends there
        sees what is awake.
        """
        at = partial(self._between, segment, rows, is_solved=True)
        times, values = rows.dense
        more = np.setdiff1d(turns, times)
        if len(more):
            times, values = merged(times, values, more, at(more))
        own = rows.is_steep[: self.known.levels.count]
        found, columns, is_all = between(times, values, self.known.levels, own, at)
        if not is_all:
            self.skip(segment.start)
        if not len(found):
            return found
        some = self._as_far_as_steps(rows, steps)
        heights, k = self.known.levels.heights(at(found)), np.arange(len(found))
        there = heights[k, :, columns]
        around = told(rows.times[some], self.known.levels.heights(rows.values[some]), found, columns)
        found = np.unique(found[(np.abs(there - around) > _TOLD * np.abs(there)).any(axis=1)])
        off = self._defects(segment, rows, found)[0]
        found, off = found[off > _DEFECT], off[off > _DEFECT]
        chosen = [np.zeros(0)]
        for gap in np.split(np.arange(len(found)), np.flatnonzero(np.diff(np.searchsorted(rows.times, found))) + 1):
            if len(gap):
                chosen.append(found[[gap[0], gap[off[gap].argmax()], gap[-1]]])
        return np.unique(np.concatenate(chosen))

    @staticmethod
    def _as_far_as_steps(rows: _Rows, steps: float) -> NDArray[np.intp]:
        """Rows that are no closer than steps."""
        apart = max(1, round(len(rows.times) / max(steps, 1.0)))
        return np.unique(np.append(np.arange(0, len(rows.times), apart), len(rows.times) - 1))

    def _move(self, segment: Segment, rows: _Rows, found: Vector, columns: NDArray[np.int64]) -> Truth:
        """Whether functions are others at these instants than at the rows on both sides.

        What rests turns all the time, by rounding; nothing comes and goes there.
        """
        behind, k = np.clip(np.searchsorted(rows.times, found), 1, len(rows.times) - 1), np.arange(len(found))
        there = self.known.levels.heights(self._between(segment, rows, found))[k, :, columns]
        known = self.known.levels.heights(rows.values)
        around = np.stack([known[behind - 1, :, columns], known[behind, :, columns]])
        return np.asarray((np.abs(around - there) > _QUIET * np.abs(there) + _NOTHING).any(axis=(0, 2)))

    def _are_doubtful(
        self, segment: Segment, rows: _Rows, steps: float, found: Vector, columns: NDArray[np.int64]
    ) -> Truth:
        """Whether the values of functions at these instants are others than the rows say that are as far as steps."""
        times, some = rows.times, self._as_far_as_steps(rows, steps)
        known, k = self.known.levels.heights(rows.values[some]), np.arange(len(found))
        place = np.clip(np.searchsorted(times[some], found), 1, len(some) - 1)
        gap = times[some][place] - times[some][place - 1]
        doubt = np.zeros(len(found), dtype=bool)
        for share in (0.0, -_BESIDE, _BESIDE):  # in its middle a step is what the rows around it say by symmetry
            at = np.clip(found + share * gap, times[0], times[-1])
            here = self._between(segment, rows, at)
            there, around = self.known.levels.heights(here)[k, :, columns], told(times[some], known, at, columns)
            doubt |= (np.abs(there - around) > _TOLD * np.abs(there) + _NOTHING).any(axis=1)
        return doubt

    def _defects(self, segment: Segment, rows: _Rows, places: Vector) -> tuple[Vector, Truth]:
        """How far the solution between rows does not satisfy its equations at some places, and whether not at all.

        In tolerances, over the distance of rows.
        """
        p, n = self.problem, self.problem.n_dynamic
        k = np.clip(np.searchsorted(rows.times, places), 1, len(rows.times) - 1)
        width = rows.times[k] - rows.times[k - 1]
        both = np.vstack([rows.x, rows.z]).T
        near = 0.01 * width
        count = min(_NODES, len(rows.times))
        at, before, after = (steady(rows.times, both, places + d, count) for d in (0.0 * near, -near, near))
        slope = (after - before)[:, :n] / (2.0 * near[:, None])
        x, z = at[:, : len(rows.x)].T, at[:, len(rows.x) :].T
        if len(z):
            try:
                z = on_equations(p, replace(segment, times=places), x, z)
            except RuntimeError:
                return np.full(len(places), np.inf), np.zeros(len(places), dtype=bool)
        rates = functions_of(p.compiled).rhs.many(places[:, None], x.T, z.T, p.u, p.p, segment.p)[:, :n]
        allowed = segment.tolerances.of(x[:n].T, p.scale_x)
        off = np.abs(rates - slope)
        share = np.nan_to_num(off * width[:, None] / allowed, nan=np.inf)
        is_large = (share > _DEFECT) & ~(off <= _LARGE * np.maximum(np.abs(rates), np.abs(slope)))
        return share.max(axis=1, initial=0.0), np.asarray(is_large.any(axis=1))

    def _again(self, segment: Segment, rows: _Rows, low: int, high: int, points: Vector) -> Piece | None:
        """What leads elsewhere than to row `high` when a step ends at these points; None where nothing does."""
        try:
            again = self._through(segment, rows, low, high, points)
        except RuntimeError as error:
            if "TOO_MUCH_WORK" in str(error):
                self.skip(float(rows.times[low]))
            return None
        return None if self._is_same(segment, again.x[:, -1], rows.x[:, high]) else again

    def _through(self, segment: Segment, rows: _Rows, low: int, high: int, points: Vector) -> Piece:
        """Rows behind `low` up to `high`, integrated with a step that ends at each of some points."""
        own = rows.times[low + 1 : high + 1]
        here, x, z = float(rows.times[low]), rows.x[:, low], rows.z[:, low]
        parts: list[Piece] = []
        budget = _MOST_AGAIN if self.problem.compiled.algebraic else None
        for stop in _apart(points, np.append(here, own)):
            times = own[(own > here) & (own < stop)]
            asked = replace(segment, start=here, times=np.append(times, stop), x=x, z=z, shares=None, first=0.0)
            piece = self.solve(self.problem, replace(asked, partial=False, step_budget=budget))
            keep = np.isin(asked.times, own)
            parts.append(Piece(piece.x[:, keep], piece.z[:, keep], piece.counters))
            here, x, z = stop, piece.x[:, -1], piece.z[:, -1]
        return _joined(parts)

    def _is_same(self, segment: Segment, a: Vector, b: Vector) -> bool:
        n = self.problem.n_dynamic
        allowed = _SAME * segment.tolerances.of(np.maximum(np.abs(a[:n]), np.abs(b[:n])), self.problem.scale_x)
        return bool((np.abs(a - b)[:n] <= allowed).all())


def _finer(segment: Segment, count: int) -> Segment:
    """The same with so many rows at least, at distances that are no multiples of each other."""
    parts = max(1, -(-count // (2 * len(segment.times))))
    ends = np.append(segment.start, segment.times)
    even = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(1, parts + 1) / parts
    gap = np.diff(ends)[:, None] / parts
    between = even - 0.382 * gap
    return replace(segment, times=np.unique(np.concatenate([segment.times, even[:, :-1].ravel(), between.ravel()])))


def _apart(points: Vector, rows: Vector) -> list[float]:
    """Points between rows and the last row, ascending; a point that is all but at a row is this row."""
    closest = rows[nearest(rows, points)]
    moved = np.where(np.abs(points - closest) < _NEAR * (rows[-1] - rows[0]), closest, points)
    found: list[float] = []
    for stop in np.unique(moved).tolist():
        if min(stop - (found[-1] if found else rows[0]), rows[-1] - stop) >= _NEAR * (rows[-1] - rows[0]):
            found.append(stop)
    return [*found, float(rows[-1])]


def _joined(parts: list[Piece]) -> Piece:
    counters: dict[str, float] = {}
    for part in parts:
        add_counters(counters, part.counters)
    return Piece(
        np.hstack([p.x for p in parts]), np.hstack([p.z for p in parts]), counters, parts[-1].stopped if parts else ""
    )
