"""Detects what a steep function does between the steps of a solver, and integrates such intervals again.

A solver sees a rate only where it evaluates it. `1 + tanh(k*(sin(w*t) - 0.999))` is zero except for a moment in each
period; if no evaluation falls into that moment, the error estimate does not see it. The argument of the function,
however, is smooth, and it is known wherever the solution is. The rows that a solver returns are therefore searched for
the instants at which such an argument has a turning point or a step function is in its middle
(`acausal.analyse.events.steep`): between these instants a function cannot rise and fall again unseen. At each of them
the defect of the solution is evaluated. Where the solution does not satisfy the equations, it is integrated again with
a step that ends at that instant. If this leads back to the next row, nothing was missed; otherwise the new solution
replaces the old one, and the run continues from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.driver.missed.adaptive_sampling import level_changes, merged, resolving_samples
from acausal.simulate.driver.missed.defect import LARGEST_DEFECT, defects
from acausal.simulate.equations.arguments import Arguments, arguments
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.location.between import interpolated, steady
from acausal.simulate.events.location.mesh import even
from acausal.simulate.events.location.rows import nearest, predicted, roots, slopes
from acausal.simulate.solvers.base import on_equations
from acausal.simulate.solvers.segment import Piece, Segment, add_counters

Integrate = Callable[[Problem, Segment], Piece]
# The least number of rows of a piece, the largest to which it is refined, and the largest number of values of arguments
# in all, for models with many steep functions such as contacts. Pieces of more steps than rows are not searched: no
# polynomial represents such a solution between rows, so that all candidates would be integrated again.
_FEWEST_ROWS, _MOST_ROWS, _MOST_VALUES = 32, 20_000, 400_000
# The most steps of a DAE between neighbouring rows that are integrated again: begun at a row, it may take tiny steps.
_MOST_STEPS_AGAIN = 5000
# The number of rows grows by this factor until they resolve the arguments.
_REFINEMENT = 8
# The largest number of steps per row with which few rows and their rates represent the states.
_STEPS_PER_ROW = 10.0
# Rows resolve an argument if the others predict every other row to this fraction of its variation there, except for
# this fraction of the rows: there may be kinks, and transients after a start.
_PREDICTION, _UNRESOLVED = 0.2, 0.1
# Solutions that differ by less are the same, in tolerances of the solver.
_SAME = 10.0
# The factor of the tolerance at which it is decided which of two different solutions is the better one.
_STRICTER = 1e-2
# The number of nodes of interpolating polynomials, and the least number of rows that are searched.
_NODES, _FEWEST_SEARCHED = 8, 4
# Arguments are clipped to this magnitude, which leaves room for products and slopes.
_LARGEST = 1e100
# The number of rows among which the last one that satisfies the equations is looked for.
_MOST_ROWS_BACK = 64
# The rows around an instant predict a function there to this fraction of its value, plus this absolute height.
_PREDICTED, _ZERO_HEIGHT = 0.02, 1e-14
# A function whose value at a turning point is that of the rows around it to this fraction does not move.
_AT_REST = 1e-3
# The number of parts of an interval in which an argument turns or crosses its middle; and how often the distance to
# that instant is halved in search of changes on the way there.
_PARTS, _HALVINGS = 8, 40
# Intervals shorter than this fraction of the time are not divided further.
_SHORTEST = 1e-11
# Rows closer than this fraction of the time between the first and the last coincide; and the tightest tolerance.
_SAME_INSTANT, _LEAST_TOLERANCE = 1e-13, 1e-13
# How far before and after a candidate a function is evaluated, too, as a fraction of the distance between rows.
_BESIDE = 0.2
# Stops count as one if they are closer than this fraction of the interval between the rows around them.
_SAME_STOP = 1e-6
_NO_CANDIDATES: tuple[Vector, Truth] = np.zeros(0), np.zeros(0, dtype=bool)
# After something was missed, this multiple of the time up to it is integrated at once, and then ever longer parts.
_FIRST_LENGTH, _LENGTH_GROWTH = 2.0, 4.0


@dataclass(frozen=True, eq=False)
class MissedEvents:
    """Integrates like `solve`, and integrates again whatever that has missed.

    `skip` is called with the start of each piece that cannot be searched [s].
    """

    solve: Integrate
    skip: Callable[[float], None]

    def __call__(self, problem: Problem, segment: Segment) -> Piece:
        """Return the solution at the times of a segment.

        Raises RuntimeError if the solver cannot continue.
        """
        search = self._search(problem, segment)
        return self.solve(problem, segment) if search is None else search.integrated(segment)

    def clears(self, problem: Problem, segment: Segment, piece: Piece) -> bool:
        """Whether a given solution at the times of a segment has missed nothing, as far as its rows show.

        For the solution of a solver that stops at events by itself. If it is not cleared, the segment must be
        integrated again by one that does not.
        """
        search = self._search(problem, segment)
        return search is None or search.is_clear(segment, piece)

    def candidates(self, problem: Problem, segment: Segment) -> Vector:
        """Instants of a segment at which a steep function may rise or fall, for other integrators to stop at."""
        search = self._search(problem, segment)
        return np.zeros(0) if search is None else search.candidates(segment)

    def _search(self, problem: Problem, segment: Segment) -> _Search | None:
        """None if no steep function has an effect."""
        steep = arguments(problem.compiled) if problem.n_dynamic and segment.step is None else None
        if steep is None:
            return None
        is_effective = steep.are_active(segment.p)
        return _Search(self.solve, self.skip, problem, steep, is_effective) if is_effective.any() else None


@dataclass(frozen=True, eq=False)
class _Rows:
    """Points of one solution: the start of a segment and the rows that a solver has returned.

    `times`, `x`, `z`: Instants, states and algebraic variables; shapes (n,), (nx, n) and (nz, n).
    `values`: Arguments of the steep functions and their middles; shape (n, columns).
    `samples`: The instants of the rows and others, between which cubics represent the arguments, and the columns there
    (`adaptive_sampling.resolving_samples`); `is_resolved`: whether there are enough of them.
    `is_steep`: Which of the columns belong to functions that are steep in the range of their arguments.
    """

    times: Vector
    x: Vector
    z: Vector
    values: Vector
    samples: tuple[Vector, Vector]
    is_resolved: bool
    is_steep: Truth

    @property
    def points(self) -> tuple[Vector, Vector, Vector]:
        """Instants, states and algebraic variables."""
        return self.times, self.x, self.z


@dataclass(frozen=True, eq=False)
class _Search:
    solve: Integrate
    skip: Callable[[float], None]
    problem: Problem
    steep: Arguments
    is_effective: Truth

    @property
    def _most(self) -> int:
        """The most rows, or steps, of a piece that is searched."""
        return min(_MOST_ROWS, _MOST_VALUES // self.steep.levels.count)

    def integrated(self, segment: Segment) -> Piece:
        """Integrate a segment; in parts, once something was missed."""
        parts: list[Piece] = []
        reach, remaining = np.inf, segment
        while True:
            piece, restart = self._part(remaining, reach)
            parts.append(piece)
            if restart is None:
                return _joined(parts)
            here, x, z, length = restart
            later = remaining.times[remaining.times > here]
            if not len(later):
                return _joined(parts)
            remaining = replace(remaining, start=here, times=later, x=x, z=z, fractions=None, first=0.0)
            reach = here + length

    def is_clear(self, segment: Segment, piece: Piece) -> bool:
        """Whether nothing can have been missed between the rows of a solution, even if there are few of them."""
        steps = piece.counters.get("steps", 0.0)
        rows = self._rows(segment, piece)
        if len(rows.times) < 2:
            return True
        if len(rows.times) < _FEWEST_ROWS:
            return self._is_mild(segment, piece, rows) or self._is_confirmed(segment, piece)
        if not rows.is_steep.any():
            return True
        if steps > self._most or not self._resolve_arguments(segment, rows):
            return self._is_confirmed(segment, piece)
        candidates, is_unpredicted = self._candidates(segment, rows, steps)
        if is_unpredicted.any() and len(rows.times) < steps:
            return self._is_confirmed(segment, piece)
        return all(
            self._corrected(segment, rows, *interval) is None
            for interval in self._violations(segment, rows, candidates, is_unpredicted)
        )

    def candidates(self, segment: Segment) -> Vector:
        """Instants at which an argument turns or a step function is in its middle, and instants close to these."""
        refined = _refined(segment, _FEWEST_ROWS)
        while True:
            piece = self.integrated(refined)
            rows = self._rows(refined, piece)
            if self._resolve_arguments(refined, rows) or _REFINEMENT * len(refined.times) > self._most:
                break
            refined = _refined(refined, _REFINEMENT * len(refined.times))
        candidates = self._candidates(refined, rows, piece.counters.get("steps", 1.0))[0]
        return np.concatenate([candidates, *(self._beside(refined, rows, candidates, sign) for sign in (-1.0, 1.0))])

    def _beside(self, segment: Segment, rows: _Rows, candidates: Vector, sign: float) -> Vector:
        """Instants ever closer to candidates, before (`sign` -1) or after them, between which a function changes."""
        if not len(candidates):
            return np.zeros(0)
        low, high = rows.times[0], rows.times[-1]
        room = np.where(sign < 0.0, np.diff(candidates, prepend=low), np.diff(candidates, append=high))
        fractions = np.append(0.5 ** np.arange(_HALVINGS), 0.0)
        at = np.clip(candidates[:, None] + sign * room[:, None] * fractions, low, high)
        values = self._interpolated(segment, rows, at.ravel())
        heights = self.steep.levels.heights(values).reshape(*at.shape, -1)
        is_different = np.abs(np.diff(heights, axis=1)) > _ZERO_HEIGHT * np.abs(heights).max(axis=1, keepdims=True)
        changes = is_different.any(axis=2)
        return np.asarray(at[:, :-1][changes & (at[:, :-1] > low) & (at[:, :-1] < high)])

    def _is_confirmed(self, segment: Segment, piece: Piece) -> bool:
        """Whether a solution with more rows ends at the same states and has missed nothing.

        If it ends elsewhere, it may be the worse of the two, because it begins at a kink; one with a stricter tolerance
        decides.
        """
        # with fewer rows, which resolve fewer functions, most pieces would have to be solved once more
        count = max(_FEWEST_ROWS, min(2 * int(piece.counters.get("steps", 0.0)), self._most))
        refined = _refined(replace(segment, fractions=None, partial=False, step_budget=None, first=0.0), count)
        for factor in (1.0, _STRICTER):
            tolerances = segment.tolerances.scaled(factor, least=_LEAST_TOLERANCE)
            try:
                again, restart = self._part(replace(refined, tolerances=tolerances), np.inf)
            except RuntimeError:
                return False
            if restart is not None or again.stopped:
                return False
            if self._is_same(segment, again.x[:, -1], piece.x[:, -1]):
                return True
        return False

    def _part(self, segment: Segment, reach: float) -> tuple[Piece, tuple[float, Vector, Vector, float] | None]:
        """Rows of a segment up to `reach` [s], or up to the end of the first interval that was integrated again.

        Also where the integration has to continue: instant, states, algebraic variables, and how far at once [s]; None
        at the end of the segment, or where the solver has stopped.
        """
        is_last = reach >= segment.times[-1]
        if is_last and len(segment.times) + 1 < _FEWEST_ROWS:  # perhaps nothing is steep there
            piece = self.solve(self.problem, segment)
            if self._is_mild(segment, piece, self._rows(segment, piece)):
                return piece, None
        inside = segment.times if is_last else segment.times[segment.times < reach]
        refined = segment if is_last else replace(segment, times=np.append(inside, reach))
        refined, piece, rows = self._resolved(refined)
        steps = int(piece.counters.get("steps", 0.0))
        if is_long := steps > self._most and bool(rows.is_steep.any()):
            self.skip(segment.start)
        candidates, is_unpredicted = _NO_CANDIDATES if is_long else self._candidates(refined, rows, steps)
        count = min(2 * steps, self._most)  # rows that are farther apart than steps leave too much open between them
        has_few_rows = len(rows.times) < min(steps, count // 2)
        if is_unpredicted.any() and has_few_rows and refined.fractions is None and not refined.partial:
            refined = _refined(refined, count)
            piece = self.solve(self.problem, refined)
            rows = self._rows(refined, piece)
        times = refined.times[: piece.x.shape[1]]
        is_requested = np.isin(times, segment.times)
        for low, high, stops in self._violations(refined, rows, candidates, is_unpredicted):
            again = self._corrected(refined, rows, low, high, stops)
            if again is None:
                continue
            here = float(rows.times[high])
            # by the row of each and not by equal times, because `_rows` drops instants that coincide with a row
            row = np.searchsorted(rows.times, times, side="right") - 1
            before = is_requested & (row <= low)
            inside_again = row[is_requested & (row > low) & (times <= here)] - low - 1
            first = Piece(piece.x[:, before], piece.z[:, before], piece.counters)
            second = Piece(again.x[:, inside_again], again.z[:, inside_again], again.counters)
            length = _FIRST_LENGTH * (here - segment.start)
            return _joined([first, second]), (here, again.x[:, -1], again.z[:, -1], length)
        found = Piece(piece.x[:, is_requested], piece.z[:, is_requested], piece.counters, piece.stopped)
        if is_last or piece.stopped:
            return found, None
        return found, (reach, piece.x[:, -1], piece.z[:, -1], _LENGTH_GROWTH * (reach - segment.start))

    def _resolved(self, segment: Segment) -> tuple[Segment, Piece, _Rows]:
        """Solve a segment with enough rows to resolve the arguments, as far as the limits allow."""
        refined = segment
        if segment.fractions is None and len(segment.times) < _FEWEST_ROWS:
            refined = _refined(segment, _FEWEST_ROWS)
        elif segment.fractions is not None and not segment.partial:  # to a located event, from the last mesh point
            fractions = even(_FEWEST_ROWS)
            times = segment.start + fractions * (segment.times[-1] - segment.start)
            refined = replace(segment, times=np.append(times[:-1], segment.times[-1]), fractions=fractions)
        while True:
            piece = self.solve(self.problem, refined)
            rows = self._rows(refined, piece)
            if piece.x.shape[1] < 2 * _NODES or self._resolve_arguments(refined, rows) or segment.partial:
                return refined, piece, rows
            if max(len(refined.times) * _REFINEMENT, piece.counters.get("steps", 0.0)) > self._most:
                return refined, piece, rows
            refined = _refined(replace(refined, fractions=None, first=0.0), _REFINEMENT * len(refined.times))

    def _resolve_arguments(self, segment: Segment, rows: _Rows) -> bool:
        """Whether the rows resolve the arguments: whether polynomials through every other row predict those between."""
        count = self.steep.levels.count
        if not rows.is_steep[:count].any():
            return True
        times, values = rows.times[1:], rows.values[1:, :count][:, rows.is_steep[:count]]
        predictions = interpolated(times[::2], values[::2], times[1:-1:2], 6)[0]
        error = np.abs(predictions - values[1:-1:2])
        change = np.abs(np.diff(values, axis=0))
        variation = np.maximum(change[:-1:2][: len(error)], change[1::2][: len(error)])
        allowed = replace(segment.tolerances, factor=0.0).of(np.abs(values).max(axis=0))
        return bool(((error > _PREDICTION * variation + allowed).mean(axis=0) <= _UNRESOLVED).all())

    def _rows(self, segment: Segment, piece: Piece) -> _Rows:
        """The start of a segment and the rows of a piece of it, without those that coincide."""
        times = np.append(segment.start, segment.times[: piece.x.shape[1]])
        keep = np.append(True, np.diff(times) > _SAME_INSTANT * np.abs(times[-1] - times[0]))
        x, z = np.column_stack([segment.x, piece.x]), np.column_stack([segment.z, piece.z])
        times, x, z = times[keep], x[:, keep], z[:, keep]
        values = self._values(segment, times, x, z)
        rows = _Rows(times, x, z, values, (times, values), True, self._are_steep(values))
        if len(times) < _FEWEST_SEARCHED:
            return rows
        samples, is_resolved = self._samples(times, values, partial(self._interpolated, segment, rows))
        if len(samples[0]) == len(times):
            return rows
        is_steep = rows.is_steep | self._are_steep(samples[1])
        return replace(rows, samples=samples, is_resolved=is_resolved, is_steep=is_steep)

    def _samples(
        self, times: Vector, values: Vector, at: Callable[[Vector], Vector]
    ) -> tuple[tuple[Vector, Vector], bool]:
        is_effective = self.is_effective[: self.steep.levels.count]
        times, values, is_resolved = resolving_samples(times, values, self.steep.levels, is_effective, at)
        return (times, values), is_resolved

    def _are_steep(self, values: Vector) -> Truth:
        return np.asarray(self.steep.are_steep(values) & self.is_effective)

    def _values(self, segment: Segment, times: Vector, x: Vector, z: Vector) -> Vector:
        p = self.problem
        found = self.steep.at(times, x, z, p.u, p.p, segment.p)
        return np.nan_to_num(np.clip(found, -_LARGEST, _LARGEST))

    def _violations(
        self, segment: Segment, rows: _Rows, candidates: Vector, is_unpredicted: Truth
    ) -> Iterator[tuple[int, int, Vector]]:
        """Intervals in which the equations are violated: first and last row, and the instants to stop at in between.

        A defect counts where the rows do not predict the function, or where the solver has missed the rate altogether.
        """
        if not len(candidates):
            return
        defect, is_missed = defects(self.problem, segment, rows.points, candidates)
        violated = np.unique(candidates[is_missed | ((defect > LARGEST_DEFECT) & is_unpredicted)])
        k = np.clip(np.searchsorted(rows.times, violated, side="right"), 1, len(rows.times) - 1)
        while len(violated):
            high = int(k[0])
            here = k == high
            yield self._restart_row(segment, rows, high), high, violated[here]
            violated, k = violated[~here], k[~here]

    def _restart_row(self, segment: Segment, rows: _Rows, high: int) -> int:
        """The row from which to integrate again up to row `high`, before anything that may have been missed.

        That is the row before the last one at which the solution satisfies the equations.
        """
        before = np.arange(max(high - _MOST_ROWS_BACK, 1), high)
        if not len(before):
            return 0
        is_good = defects(self.problem, segment, rows.points, rows.times[before])[0] <= LARGEST_DEFECT
        if is_good[0] or before[0] == 1:
            k = int(before[np.flatnonzero(is_good)[-1]]) if is_good.any() else 0
            return max(min(k, high - 1) - 1, 0)
        return max(high - 2, 0)  # no row of this solution satisfies the equations to that limit

    def _refined_samples(self, segment: Segment, rows: _Rows, intervals: NDArray[np.intp]) -> tuple[Vector, Vector]:
        """The samples of rows, with more of them in and beside some intervals, and the columns of values there.

        States are polynomials between rows; functions of them may be resolved less well.
        """
        times, values = rows.samples
        near = np.unique(np.clip(intervals[:, None] + np.array([-1, 0, 1]), 0, len(times) - 2))
        near = near[np.diff(times)[near] > _SHORTEST * np.abs(times).max()]
        if not len(near):
            return times, values
        gap = times[near + 1] - times[near]
        added = (times[near][:, None] + gap[:, None] * np.arange(1, _PARTS) / _PARTS).ravel()
        return merged(times, values, added, self._interpolated(segment, rows, added))

    def _interpolated(self, segment: Segment, rows: _Rows, times: Vector, is_solved: bool = False) -> Vector:
        """Columns of values at instants between rows; shape (n, columns).

        `is_solved`: Whether the algebraic equations are solved there; else their variables are interpolated, too.
        """
        states = steady(rows.times, np.vstack([rows.x, rows.z]).T, times, min(_NODES, len(rows.times)))
        x, z = states[:, : len(rows.x)].T, states[:, len(rows.x) :].T
        if is_solved:
            with suppress(RuntimeError):
                z = on_equations(self.problem, replace(segment, times=times), x, z)
        return self._values(segment, times, x, z)

    def _is_mild(self, segment: Segment, piece: Piece, rows: _Rows) -> bool:
        """Whether nothing is steep between few rows, where Hermite cubics through states and rates are the states."""
        if len(rows.z) or piece.counters.get("steps", 0.0) > _STEPS_PER_ROW * len(rows.times):
            return False
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

        added = _refined(replace(segment, times=times[1:]), _FEWEST_ROWS).times
        values = np.vstack([rows.values[:1], at(added)])
        (_, values), is_resolved = self._samples(np.append(times[:1], added), values, at)
        return is_resolved and not self._are_steep(values).any()

    def _candidates(self, segment: Segment, rows: _Rows, steps: float) -> tuple[Vector, Truth]:
        """Instants at which a steep function may rise or fall, ascending, and whether rows fail to predict it there.

        An argument turns there, a step function is in its middle, or a function has changed by more than some levels.
        The rows from which functions are predicted are as far apart as the `steps` of the solver.
        """
        if len(rows.times) < _FEWEST_SEARCHED or not rows.is_steep.any():
            return _NO_CANDIDATES
        if not rows.is_resolved:
            self.skip(segment.start)
        found, owners = self._turning_points(segment, rows)
        is_unpredicted = self._are_unpredicted(segment, rows, steps, found, owners)
        active = self._active_instants(segment, rows, steps, found)
        found, is_unpredicted = np.append(found, active), np.append(is_unpredicted, np.ones(len(active), dtype=bool))
        order = np.argsort(found)
        return found[order], is_unpredicted[order]

    def _turning_points(self, segment: Segment, rows: _Rows) -> tuple[Vector, NDArray[np.int64]]:
        """Instants at which an argument turns or a middle is zero, and the indices of these arguments."""
        (times, values), first = rows.samples, self.steep.levels.count
        turns = crossed = np.zeros(0, dtype=np.intp)
        for is_refined in (False, True):
            if is_refined:
                times, values = self._refined_samples(segment, rows, np.concatenate([turns, crossed]))
            rates = slopes(times, values)
            # by truth values and not by the signs of products, because a sample may be exactly zero
            is_falling, is_negative = rates < 0.0, values[:, first:] < 0.0
            turns, columns = np.nonzero((is_falling[:-1] != is_falling[1:]) & rows.is_steep)
            crossed, crossing = np.nonzero((is_negative[:-1] != is_negative[1:]) & rows.is_steep[first:])
            if not len(turns) and not len(crossed):
                return np.zeros(0), np.zeros(0, dtype=np.int64)
        crossing += first
        found = roots(times, rates, columns, turns)
        # a middle that turns within an interval may be zero on both sides of its extremum
        inside = np.flatnonzero(columns >= first)
        k, j, extremum = turns[inside], columns[inside], found[inside]
        top = interpolated(times, values, extremum, min(_NODES, len(times)))[0][np.arange(len(j)), j]
        both = (top * values[k, j] < 0.0) & (top * values[k + 1, j] < 0.0)
        k, j, extremum, top = k[both], j[both], extremum[both], top[both]
        columns, crossing = np.concatenate([columns, crossing, j, j]), np.concatenate([crossing, j, j])
        row = np.concatenate([crossed, k, k])
        begin, end = (np.stack([times[n], values[n, crossing]]) for n in (row, row + 1))
        end[:, len(crossed) : len(crossed) + len(k)] = begin[:, len(crossed) + len(k) :] = extremum, top
        found = np.append(found, roots(times, values, crossing, row, (begin, end)))
        owners = self.steep.owners[columns]
        moves = self._move(segment, rows, found, owners)
        return found[moves], owners[moves]

    def _active_instants(self, segment: Segment, rows: _Rows, steps: float, turns: Vector) -> Vector:
        """Instants at which a function has changed by several levels and the solution violates its equations.

        Of those between two rows only the first, the last and the one with the largest defect are returned: a step that
        ends there sees the active function.
        """
        at = partial(self._interpolated, segment, rows, is_solved=True)
        times, values = rows.samples
        added = np.setdiff1d(turns, times)
        if len(added):
            times, values = merged(times, values, added, at(added))
        is_steep = rows.is_steep[: self.steep.levels.count]
        found, columns, is_all = level_changes(times, values, self.steep.levels, is_steep, at)
        if not is_all:
            self.skip(segment.start)
        if not len(found):
            return found
        apart = self._as_far_as_steps(rows, steps)
        heights, k = self.steep.levels.heights(at(found)), np.arange(len(found))
        exact = heights[k, :, columns]
        expected = predicted(rows.times[apart], self.steep.levels.heights(rows.values[apart]), found, columns)
        found = np.unique(found[(np.abs(exact - expected) > _PREDICTED * np.abs(exact)).any(axis=1)])
        defect = defects(self.problem, segment, rows.points, found)[0]
        found, defect = found[defect > LARGEST_DEFECT], defect[defect > LARGEST_DEFECT]
        chosen = [np.zeros(0)]
        for gap in np.split(np.arange(len(found)), np.flatnonzero(np.diff(np.searchsorted(rows.times, found))) + 1):
            if len(gap):
                chosen.append(found[[gap[0], gap[defect[gap].argmax()], gap[-1]]])
        return np.unique(np.concatenate(chosen))

    @staticmethod
    def _as_far_as_steps(rows: _Rows, steps: float) -> NDArray[np.intp]:
        """Indices of rows that are no closer to each other than the steps of the solver, on average."""
        every = max(1, round(len(rows.times) / max(steps, 1.0)))
        return np.unique(np.append(np.arange(0, len(rows.times), every), len(rows.times) - 1))

    def _move(self, segment: Segment, rows: _Rows, found: Vector, columns: NDArray[np.int64]) -> Truth:
        """Whether the values of functions at these instants differ from those at the rows on both sides.

        An argument at rest has turning points all the time, because of rounding errors, at which nothing changes.
        """
        high, k = np.clip(np.searchsorted(rows.times, found), 1, len(rows.times) - 1), np.arange(len(found))
        here = self.steep.levels.heights(self._interpolated(segment, rows, found))[k, :, columns]
        heights = self.steep.levels.heights(rows.values)
        around = np.stack([heights[high - 1, :, columns], heights[high, :, columns]])
        return np.asarray((np.abs(around - here) > _AT_REST * np.abs(here) + _ZERO_HEIGHT).any(axis=(0, 2)))

    def _are_unpredicted(
        self, segment: Segment, rows: _Rows, steps: float, found: Vector, columns: NDArray[np.int64]
    ) -> Truth:
        """Whether functions at or beside these instants differ from the prediction of rows as far apart as steps."""
        times, apart = rows.times, self._as_far_as_steps(rows, steps)
        heights, k = self.steep.levels.heights(rows.values[apart]), np.arange(len(found))
        high = np.clip(np.searchsorted(times[apart], found), 1, len(apart) - 1)
        gap = times[apart][high] - times[apart][high - 1]
        is_unpredicted = np.zeros(len(found), dtype=bool)
        # in its middle a step function is always predicted, by symmetry
        for fraction in (0.0, -_BESIDE, _BESIDE):
            at = np.clip(found + fraction * gap, times[0], times[-1])
            values = self._interpolated(segment, rows, at)
            exact, expected = (
                self.steep.levels.heights(values)[k, :, columns],
                predicted(times[apart], heights, at, columns),
            )
            is_unpredicted |= (np.abs(exact - expected) > _PREDICTED * np.abs(exact) + _ZERO_HEIGHT).any(axis=1)
        return is_unpredicted

    def _corrected(self, segment: Segment, rows: _Rows, low: int, high: int, stops: Vector) -> Piece | None:
        """The rows after `low` up to `high`, integrated again with steps that end at some stops.

        None if this leads to row `high` as before, or if the solver fails.
        """
        try:
            again = self._through(segment, rows, low, high, stops)
        except RuntimeError as error:
            if "TOO_MUCH_WORK" in str(error):
                self.skip(float(rows.times[low]))
            return None
        return None if self._is_same(segment, again.x[:, -1], rows.x[:, high]) else again

    def _through(self, segment: Segment, rows: _Rows, low: int, high: int, stops: Vector) -> Piece:
        """Integrate the rows after `low` up to `high` with a step that ends at each of the stops."""
        times_again = rows.times[low + 1 : high + 1]
        here, x, z = float(rows.times[low]), rows.x[:, low], rows.z[:, low]
        parts: list[Piece] = []
        budget = _MOST_STEPS_AGAIN if self.problem.compiled.algebraic else None
        for stop in _distinct_stops(stops, np.append(here, times_again)):
            times = times_again[(times_again > here) & (times_again < stop)]
            requested = replace(segment, start=here, times=np.append(times, stop), x=x, z=z, fractions=None, first=0.0)
            piece = self.solve(self.problem, replace(requested, partial=False, step_budget=budget))
            keep = np.isin(requested.times, times_again)
            parts.append(Piece(piece.x[:, keep], piece.z[:, keep], piece.counters))
            here, x, z = stop, piece.x[:, -1], piece.z[:, -1]
        return _joined(parts)

    def _is_same(self, segment: Segment, a: Vector, b: Vector) -> bool:
        n = self.problem.n_dynamic
        allowed = _SAME * segment.tolerances.of(np.maximum(np.abs(a[:n]), np.abs(b[:n])), self.problem.scale_x)
        return bool((np.abs(a - b)[:n] <= allowed).all())


def _refined(segment: Segment, count: int) -> Segment:
    """The same segment with at least `count` rows, at distances that are no multiples of each other."""
    parts = max(1, -(-count // (2 * len(segment.times))))
    ends = np.append(segment.start, segment.times)
    even = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(1, parts + 1) / parts
    gap = np.diff(ends)[:, None] / parts
    between = even - 0.382 * gap
    return replace(segment, times=np.unique(np.concatenate([segment.times, even[:, :-1].ravel(), between.ravel()])))


def _distinct_stops(stops: Vector, rows: Vector) -> list[float]:
    """Stops and the last row, ascending; a stop that nearly coincides with a row is moved onto it."""
    closest = rows[nearest(rows, stops)]
    moved = np.where(np.abs(stops - closest) < _SAME_STOP * (rows[-1] - rows[0]), closest, stops)
    found: list[float] = []
    for stop in np.unique(moved).tolist():
        if min(stop - (found[-1] if found else rows[0]), rows[-1] - stop) >= _SAME_STOP * (rows[-1] - rows[0]):
            found.append(stop)
    return [*found, float(rows[-1])]


def _joined(parts: list[Piece]) -> Piece:
    counters: dict[str, float] = {}
    for part in parts:
        add_counters(counters, part.counters)
    return Piece(np.hstack([p.x for p in parts]), np.hstack([p.z for p in parts]), counters, parts[-1].stopped)
