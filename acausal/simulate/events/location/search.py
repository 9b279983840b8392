"""From event to event with solvers that only deliver points.

A solver is given mesh points, instants at which it hands over what it has, and may take a few steps from each to the
next; where it needs more it stops, and goes on from there with closer mesh points. So no step is far from a mesh point,
whatever the output interval and the length of the run, and what is integrated with frozen modes beyond an event is a
few mesh points and is thrown away. Where a guard is passed, or is not known well enough to say that it is not
(`between.py`), the stretch is sampled more closely from the mesh point before.

Mesh points are shares of a length, of which there are few (`mesh.py`), so that their integrators are kept. Outputs and
the point of an event lie between mesh points: they are interpolated where that is proved to be good (`between.py`),
else the solution is integrated to them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.events.guards import AT_REST, LOCATED, Guards, Moment
from acausal.simulate.events.location import mesh as meshing
from acausal.simulate.events.location.between import LeftGuards, between, lowest, root
from acausal.simulate.events.regime import Regime
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.base import islands, on_equations, pace
from acausal.simulate.solvers.segment import Piece, Segment, add_counters

Integrate = Callable[[Regime, Segment], Piece]
Record = Callable[[Vector, Piece], None]

# Steps that a solver may take from one mesh point to the next, how many are aimed at, and how many it may take where
# the same stretch was passed before, from another start.
_MOST_STEPS, _WANTED_STEPS, _KNOWN_STEPS = 10, 2.0, 400
# Share of the tolerance where a crossing is looked for, and what rounding allows.
_CLOSER, _FINEST = 1e-2, 1e-14
_DIVISION = 16
_DEEPEST = 8
_NEAREST = 8
_LATE_TURN, _MOST_TURNS = 2, 7
# How far a piece may go, by how long the stretch has been.
_FARTHER = 16.0
# Mesh points of a piece behind one that has stopped, by those of that one; of several in a row ever closer.
_NEARER, _MOST_NEARER = 0.2, 3
# A stop is at the beginning of a stretch so many mesh points from there; how much farther apart the first mesh points
# may be in the next such stretch if they were close enough in this one.
_OPENING, _WIDER = 16.0, 2.0
# So many failures must have brought a run on by this share of it.
_MANY, _PROGRESS = 100, 1e-6
# And so many steps by this one, whatever the outputs are.
_PATIENCE, _ADVANCE = 20_000, 1e-4
# Pieces of what is left where a stretch without guards needs more steps than one call of a solver may take.
_FINER = 1000


@dataclass(frozen=True, eq=False)
class Arrival:
    """Where a stretch has come to: to an event at `time`, or (None) to its end.

    `vague` is the guard that made it where this was never as large as it may be wrong; `small` is the one that was
    never as large as by errors of states that had not relaxed.
    """

    time: float | None
    x: Vector
    z: Vector
    vague: int | None = None
    small: int | None = None


@dataclass(frozen=True, eq=False)
class _Seen:
    """Rows of one try at the mesh points: the start and up to two mesh points before it come first; `here` is the
    start's row.

    `values` may be below zero by what guards that have just left it are off; `head` are those of the first rows, up to
    which this is not zero, without. `least` are the lowest values behind the start, shape (guards,).
    """

    times: Vector
    head: Vector
    values: Vector
    judged: Vector
    least: Vector
    here: int

    def plain(self, first: int, last: int) -> Vector:
        """Values of some rows that may not be below zero by anything; shape (rows, guards)."""
        found = self.values[first:last].copy(order="K")
        own = self.head[first:last]
        found[: len(own)] = own
        return found


@dataclass
class _Way:
    """What is left of a stretch, and how it has gone so far."""

    segment: Segment
    moment: Moment
    band: Vector
    start: LeftGuards
    record: Record
    times: Vector
    values: Vector
    largest: Vector
    apart: Segment
    closer: list[tuple[float, float]] = field(default_factory=list)
    shrink: float = 1.0
    steps_allowed: int = _MOST_STEPS
    stops: int = 0
    share: float = _CLOSER
    failures: int = 0
    mark: float = 0.0
    since: float = 0.0
    steps: float = 0.0
    is_finer: bool = False
    relations: bytes = b""


class _NotDelivered(RuntimeError):
    """Rows between two mesh points cannot be integrated to."""


def _is_long(words: str) -> bool:
    """Whether a solver says that it was not allowed more steps; a one-step method says only that it has not arrived."""
    return "TOO_MUCH_WORK" in words or words.startswith("segment returned")


@dataclass
class Search:
    """The stretches of one run; how far apart its mesh points may be is remembered from one to the next."""

    guards: Guards
    solver: Solver
    integrate: Integrate
    span: float
    spacing: float = np.inf
    pace: float = 0.0
    openings: dict[bytes, float] = field(default_factory=dict)
    """How far apart the first mesh points of a stretch may be, by the relations that hold in it."""

    def to_event(self, segment: Segment, moment: Moment, band: Vector, gap: float, record: Record) -> Arrival:
        """Integrate with the modes of a moment to the next event, or to the end of a segment.

        Raises RuntimeError when the solver cannot go on; what came before is recorded.

        `band`: How far beyond its guard each one may be; shape (guards,).
        `gap`: How long such stretches are about; inf when it is not known.
        `record`: Told the rows at times of the segment, as they are known.
        """
        way = self._begun(segment, moment, band, record)
        end = float(segment.times[-1])
        while True:
            here = way.segment.start
            ahead = max(8.0 * gap, _FARTHER * (here - segment.start), 1e-9 * self.span)
            marks, asked = self._asked(way, min(end, here + ahead))
            piece = self._tried(moment.regime, asked)
            count = piece.x.shape[1]
            if not count:
                self._failed(way, marks, piece.stopped)
                continue
            self._relax(here, float(asked.times[count - 1]), piece)
            rows = self._looked(asked, count, marks)
            seen = self._seen(way, asked, piece, rows)
            found = self._suspicion(way, seen, piece, rows)
            # not the interval before a failure, whose other side is not known
            keep, closer = int(rows[-2]) + 1 if piece.stopped and len(rows) > 2 else count, way.closer[:0]
            if found is not None:
                row, passed = found
                left, right = float(seen.times[row]), float(seen.times[row + 1])
                if passed and not way.closer:
                    left = float(seen.times[self._trusted(way, seen, row, piece, rows)])
                keep = int(np.searchsorted(asked.times[:count], left, side="right"))
                if not passed or not self._is_located(way, seen, row, right - left):
                    closer = [(right, (right - left) / _DIVISION)]
                elif not self._rests(way, seen, row, piece, rows):
                    return self._ended(way, seen, row, asked, piece)
            try:
                self._accept(way, asked, piece, seen, keep)
            except _NotDelivered as error:  # between closer mesh points they are known
                self._failed(way, marks, str(error))
                continue
            if found is None:
                self._adapt(way, np.append(here, asked.times[rows]), piece, end)
            way.closer += closer
            while way.closer and way.segment.start >= way.closer[-1][0]:
                way.closer.pop()
                self._rest(way, way.segment.start, way.segment.x, way.segment.z)
            if way.segment.start >= end:
                return Arrival(None, self._whole(way, end, way.segment.x), way.segment.z)

    def _relax(self, start: float, end: float, piece: Piece) -> None:
        """Note over which step errors have relaxed, by this piece and those before; explicit steps relax nothing."""
        if not self.solver.explicit:
            took = pace(start, end, piece.counters)
            self.guards.step = min(self.pace, took) if self.pace and took else self.pace or took

    def _begun(self, segment: Segment, moment: Moment, band: Vector, record: Record) -> _Way:
        segment = replace(segment, partial=True)
        count = len(moment.regime.active_set.owners)
        values, rates, noises, leaving = (np.zeros(count, dtype=d) for d in (float, float, float, bool))
        if count:
            g, rates, noise = self.guards.state(segment.start, moment)
            leaving = (g <= noise) & (rates > noise)
            # a guard that leaves zero is beyond it by rounding for a while, and by nothing later on
            noises = np.where(leaving, np.maximum(LOCATED * noise, band), 0.0)
            band = np.where(leaving, 0.0, band)
            values = np.maximum(g + band, 0.0)
        start = LeftGuards(segment.start, values, leaving, rates, noises)
        times = np.array([segment.start])
        way = _Way(segment, moment, band, start, record, times, values[None, :], values, segment)
        way.mark = way.since = segment.start
        way.relations = moment.m[self.guards.first :].tobytes()
        return way

    def _rest(self, way: _Way, t: float, x: Vector, z: Vector) -> Truth:
        """Guards that have come to rest on zero since the stretch began; they may be passed by a little now.

        A capacitor that discharges through 1e-5 Ohm is empty after a microsecond; whether what is left of it is 1e-90
        or -1e-90 V is rounding, and no crossing to be looked for again and again. What falls at its rate crosses.
        """
        at = replace(way.moment, x=x, z=z)
        g, rate, noise = self.guards.state(t, at)
        moved = np.abs(g) + np.abs(rate) * (t - way.start.time)
        resting: Truth = (moved <= LOCATED * noise) & ~way.start.leaving
        way.band = np.where(resting, np.maximum(way.band, 2.0 * LOCATED * noise), way.band)
        return resting

    def _asked(self, way: _Way, limit: float) -> tuple[Vector, Segment]:
        """The next mesh points, and the segment that ends at the last of them, with the outputs in between."""
        segment, problem = way.segment, way.moment.regime.problem
        here, outputs = segment.start, segment.times
        if not way.moment.regime.active_set.owners:
            if not way.is_finer or segment.step is not None:
                return outputs, segment
            times = np.union1d(np.linspace(here, outputs[-1], _FINER + 1)[1:], outputs)
            return times, replace(segment, times=times)
        least, asked = meshing.resolution(here, self.span), segment
        if way.closer:  # the error of a stiff variable may be that of a long time in its guard
            asked = replace(asked, tolerances=segment.tolerances.scaled(way.share, least=_FINEST))
            until, spacing = way.closer[-1]
            length, shares = until - here, meshing.even(max(2, round((until - here) / spacing)))
            first = self._first(way, asked, length) if self.solver.multistep else 0.0
            asked = replace(asked, first=first, step_budget=_KNOWN_STEPS)
        elif segment.step is not None:
            count = max(1, int(meshing.most(problem, fixed=True) * way.shrink))
            marks, times = meshing.merged(meshing.stepped(here, outputs, limit, segment.step, count), outputs)
            return marks, replace(asked, times=times)
        else:
            spacing = way.shrink * min(self._spaced(way), (limit - here) / 64)
            first = self._first(way, asked, limit - here)
            length, shares = meshing.growing(limit - here, first, spacing, meshing.most(problem), least)
            begun = meshing.begun(shares, length, first)
            more = math.ceil(math.log2(max(float(shares[0]) * length / begun, 16.0))) - 4
            asked = replace(asked, first=begun, step_budget=way.steps_allowed + 4 * math.ceil(more / 4))
            until = limit if length == limit - here else here + length
        marks = np.asarray(here + length * shares)
        marks[-1] = until
        if segment.step is None:
            return marks, replace(asked, times=marks, shares=shares)
        marks, times = meshing.merged(marks, outputs)
        return marks, replace(asked, times=times)

    def _spaced(self, way: _Way) -> float:
        """How far apart mesh points may be from here on: where a stretch begins, as in others with the same
        relations."""
        if way.segment.start > way.start.time:
            return self.spacing
        return self.openings.get(way.relations, self.spacing)

    def _first(self, way: _Way, asked: Segment, horizon: float) -> float:
        """The first step."""
        if not way.moment.regime.problem.n_dynamic:
            return np.inf
        if self.pace and not self.solver.multistep:
            return way.shrink * self.pace
        return way.shrink * meshing.first_step(way.moment.regime.problem, asked, horizon)

    def _solved(self, regime: Regime, segment: Segment) -> Piece:
        """The solution, by an integrator that is kept; where it does not get away, by one that is told the rates."""
        try:
            return self.integrate(regime, segment)
        except RuntimeError as error:
            if segment.shares is None or "TOO_MUCH_WORK" in str(error):
                raise
            return self.integrate(regime, replace(segment, shares=None, first=0.0))

    def _tried(self, regime: Regime, segment: Segment) -> Piece:
        try:
            return self._solved(regime, segment)
        except RuntimeError as error:
            return Piece(np.zeros((len(segment.x), 0)), np.zeros((len(segment.z), 0)), {}, str(error))

    def _failed(self, way: _Way, marks: Vector, words: str) -> None:
        """Less far, after a try without a single row; RuntimeError when that is nowhere."""
        here = way.segment.start
        way.failures += 1
        if way.failures % _MANY == 0:  # near a pole small pieces arrive somewhere again and again
            if here - way.mark < _PROGRESS * self.span:
                raise RuntimeError(words)
            way.mark = here
        if not way.moment.regime.active_set.owners:
            if way.is_finer or not _is_long(words):
                raise RuntimeError(words)
            way.is_finer = True
            return
        if way.closer and way.share < 1.0 and not _is_long(words):
            way.share = 1.0  # voltages over micro-ohms: rounding alone is more than a hundredth of the tolerance
            return
        if float(marks[0]) - here <= 2.0 * meshing.resolution(here, self.span):
            # a start at a kink: it may take many steps of no length
            if not _is_long(words) or way.steps_allowed >= _PATIENCE:
                raise RuntimeError(words)
            way.steps_allowed *= _DIVISION
            return
        if way.closer:
            right = float(marks[0])
            way.closer.append((right, (right - here) / _DIVISION))
            if len(way.closer) > 2 * _DEEPEST:
                raise RuntimeError(words)
        else:
            way.shrink /= _DIVISION
            if way.shrink < 1e-15:
                raise RuntimeError(words)

    def _looked(self, asked: Segment, count: int, marks: Vector) -> NDArray[np.int64]:
        """Which of so many rows are mesh points."""
        if asked.shares is not None or marks is asked.times:
            return np.arange(count)
        reached = marks[: np.searchsorted(marks, asked.times[count - 1], side="right")]
        return np.searchsorted(asked.times[:count], reached)

    def _seen(self, way: _Way, asked: Segment, piece: Piece, rows: NDArray[np.int64]) -> _Seen:
        moment, known = way.moment, len(way.times)
        times, plain = asked.times[rows], np.zeros((len(rows), len(way.band)))
        if moment.regime.active_set.owners and len(rows):
            x, z = (piece.x, piece.z) if len(rows) == piece.x.shape[1] else (piece.x[:, rows], piece.z[:, rows])
            plain = self.guards.along(times, x, z, moment.m, moment.regime)
            if way.band.any():
                plain = plain + way.band
        times, values = np.concatenate([way.times, times]), np.concatenate([way.values, plain])
        # those before, too: a jump of the allowance at the start of a try would look like a guard that turns back
        near = way.start.near(times)
        head = values[: len(near)].copy()
        values[: len(near)] += near
        least = values[known:].min(axis=0, initial=np.inf)
        if len(times) > known:
            way.largest = np.maximum(way.largest, np.maximum(values[known:].max(axis=0), -least))
        return _Seen(times, head, values, way.start.judged(times, values), least, known - 1)

    def _suspicion(self, way: _Way, seen: _Seen, piece: Piece, rows: NDArray[np.int64]) -> tuple[int, bool] | None:
        """The first interval, by the row where it begins, in which a guard is passed (True) or may be."""
        if not way.moment.regime.active_set.owners:
            return None
        last, is_passed = len(seen.times), False
        low = np.flatnonzero(~(seen.least >= 0.0))
        if len(low):  # or nan
            below = (seen.values[seen.here + 1 :, low] < 0.0).any(axis=1)
            is_passed = bool(below.any())
            last = seen.here + 1 + int(np.argmax(below)) if is_passed else last
        if len(way.closer) < _DEEPEST:
            doubtful, bounds = lowest(seen.times[: last + 1], seen.judged[: last + 1])
            doubt = (bounds < 0.0) & (seen.judged[doubtful] >= 0.0) & (seen.judged[doubtful + 1] >= 0.0)
            for k in np.flatnonzero(doubt.any(axis=1) & (doubtful >= seen.here)):
                row = int(doubtful[k])
                if self._counts(way, seen, row, bounds[k], doubt[k], piece, rows):
                    return row, False
        return (last - 1, True) if is_passed else None

    def _counts(
        self, way: _Way, seen: _Seen, row: int, low: Vector, doubt: Truth, piece: Piece, rows: NDArray[np.int64]
    ) -> bool:
        """Whether guards may come below zero by more than they are wrong."""
        t, k = float(seen.times[row]), row - seen.here
        if float(seen.times[row + 1]) - t <= _DIVISION * meshing.resolution(t, self.span):
            return False
        x, z = (way.segment.x, way.segment.z) if k == 0 else (piece.x[:, rows[k - 1]], piece.z[:, rows[k - 1]])
        noise = 2.0 * self.guards.rates(t, replace(way.moment, x=x, z=z))[1]
        leaving = way.start.leaving
        noise[leaving] /= max(t - way.start.time, float(seen.times[row + 1]) - t)
        return bool((low < -noise)[doubt].any())

    def _trusted(self, way: _Way, seen: _Seen, row: int, piece: Piece, rows: NDArray[np.int64]) -> int:
        """The last row, up to this one, where guards that are passed behind it are above what they may be wrong by.

        A component that follows its source is worse between the steps of a solver than it is at their ends: at a mesh
        point that seems to be before a crossing it may have happened.
        """
        passed = seen.values[row + 1] < 0.0
        while row > seen.here:
            x, z = (v[:, rows[row - seen.here - 1]] for v in (piece.x, piece.z))
            at = replace(way.moment, x=x, z=z)
            noise = self.guards.rates(float(seen.times[row]), at, between=True)[1]
            if (seen.values[row] > noise)[passed].all():
                break
            row -= 1
        return row

    def _adapt(self, way: _Way, times: Vector, piece: Piece, end: float) -> None:
        """How far apart mesh points may be from now on."""
        if way.closer or not way.moment.regime.active_set.owners or way.segment.step is not None or len(times) < 2:
            return
        way.shrink, way.steps_allowed = 1.0, _MOST_STEPS
        way.stops = way.stops + 1 if piece.stopped else 0
        gaps = np.diff(times)
        last = float(gaps[-2:].max()) if len(gaps) > 1 else float(gaps[-1])
        opens = float(times[-1]) <= way.start.time + _OPENING * last
        if piece.stopped:  # closer than the steps were, as they are shorter behind a start
            self.spacing = _NEARER ** min(way.stops, _MOST_NEARER) * float(gaps[-1])
            if opens:
                self.openings[way.relations] = self.spacing
            return
        ramp = int(np.sum(gaps[1:] > 1.5 * gaps[:-1])) + 1
        steps = piece.counters.get("steps", 0.0)
        rate = max(steps - 3.0 * ramp, 0.02 * len(gaps)) / max(len(gaps) - ramp, 1)
        self.spacing = last * float(np.clip(_WANTED_STEPS / rate, 0.25, 100.0))
        if float(times[0]) == way.start.time:
            own = float(gaps[min(ramp, len(gaps) - 1)])
            self.openings[way.relations] = own if times[-1] >= end else _WIDER * own
        self.pace = (times[-1] - times[0]) / steps if steps else 0.0

    def _accept(self, way: _Way, asked: Segment, piece: Piece, seen: _Seen, keep: int) -> None:
        """Go on from the last of so many rows."""
        if not keep:
            return
        segment = way.segment
        times = asked.times[:keep]
        counters = dict(piece.counters)
        here = float(times[-1])
        passed = int(np.searchsorted(segment.times, here, side="right"))
        due = segment.times[:passed]
        x, z = self._rows(way, asked, piece, due, counters)
        if asked.shares is None:
            way.apart = replace(way.apart, start=here, x=piece.x[:, keep - 1])
        else:
            self._grow(way, due, x)
        way.record(due, Piece(x, z, counters))
        way.steps += counters.get("steps", 0.0)
        advance = (here - way.since) / (_ADVANCE * self.span)
        if way.steps > _PATIENCE * max(advance, 1.0):
            raise RuntimeError("TOO_MUCH_WORK: the run hardly comes on")
        if advance >= 1.0:
            way.since, way.steps = here, 0.0
        x, z = piece.x[:, keep - 1], piece.z[:, keep - 1]
        way.segment = replace(segment, start=here, times=segment.times[passed:], x=x, z=z)
        if not way.moment.regime.active_set.owners:
            return
        # the last mesh points, for the parabolas
        last = int(np.searchsorted(seen.times, here)) + 1
        way.times, way.values = seen.times[max(0, last - 3) : last], seen.plain(max(0, last - 3), last)

    def _is_located(self, way: _Way, seen: _Seen, row: int, width: float) -> bool:
        """Whether an interval in which a guard is passed is narrow enough for its root.

        Not where all guards that are passed have left zero at the start of the stretch: the end of a short hop must
        not be taken for its beginning. Nor where one has come to rest: it jumps there, and has no root.
        """
        if not way.closer:
            return False
        if len(way.closer) >= _DEEPEST or width <= _DIVISION * meshing.resolution(float(seen.times[row]), self.span):
            return True
        passed = seen.values[row + 1] < 0.0
        if (passed & self._jumps(way, seen.plain(row, row + 2))).any():
            return False
        return not (float(seen.times[row]) == way.start.time and way.start.leaving[passed].all())

    def _jumps(self, way: _Way, values: Vector) -> Truth:
        """Guards that are at rest at some of these rows."""
        rests = self.guards.rests[way.moment.regime.active_set.owner]
        return np.asarray(rests & (np.abs(values) == AT_REST).any(axis=0))

    def _rests(self, way: _Way, seen: _Seen, row: int, piece: Piece, rows: NDArray[np.int64]) -> bool:
        """Whether all guards that are passed behind a row have come to rest there."""
        k = row - seen.here
        x, z = (way.segment.x, way.segment.z) if k == 0 else (piece.x[:, rows[k - 1]], piece.z[:, rows[k - 1]])
        passed = seen.values[row + 1] < 0.0
        allowed = way.band.copy()
        return bool((self._rest(way, float(seen.times[row]), x, z) & (way.band > allowed))[passed].all())

    def _ended(self, way: _Way, seen: _Seen, row: int, asked: Segment, piece: Piece) -> Arrival:
        """The event between two mesh points: its instant, from the interpolated guards, then by Newton's method."""
        segment, moment = way.segment, way.moment
        left, right = float(seen.times[row]), float(seen.times[row + 1])
        passed = np.flatnonzero(seen.values[row + 1] < 0.0)
        root, which = min((self._root(seen, row, int(k)), int(k)) for k in passed)
        jumps = self._jumps(way, seen.plain(row, row + 2))
        counters: dict[str, float] = {}
        t, x, z = segment.start, segment.x, segment.z
        smallest, noise = meshing.resolution(root, self.span) / 16, way.largest
        for turn in range(_MOST_TURNS):
            t = min(max(root, left), right)
            if t - segment.start <= smallest:
                t, x, z = segment.start, segment.x, segment.z
            else:
                # the end of a step, not a point between two
                last = self._solved(moment.regime, self._only(asked, t))
                x, z = last.x[:, -1], last.z[:, -1]
                add_counters(counters, last.counters)
                if jumps[which] and len(z):  # on their equations, as the event iteration will have them
                    there = replace(segment, times=np.array([t]))
                    z = on_equations(moment.regime.problem, there, x[:, None], z[:, None])[:, 0]
            at = replace(moment, x=x, z=z)
            distances, rate, noise = self.guards.state(t, at)
            value = float((distances + way.band + way.start.near(np.array([t])).sum(axis=0))[which])
            if turn + 1 == _MOST_TURNS:
                break
            if jumps[which] and value > 0.0:  # of another integration the end of rest is elsewhere
                right = t + _DIVISION * max(right - left, smallest)
                root = right
                continue
            if jumps[which] or rate[which] == 0.0:
                break
            step = -value / float(rate[which])
            if abs(step) <= smallest or abs(value) <= 0.1 * LOCATED * noise[which] or abs(step) > right - left:
                break
            if turn >= _LATE_TURN:
                # errors of these integrations are all that is left: once it is passed, it does not flip back
                if value < 0.0:
                    break
                step *= 4.0
            root = t + step
        due = segment.times[: np.searchsorted(segment.times, t)]
        earlier = self._rows(way, asked, piece, due, counters)
        self._grow(way, due, earlier[0])
        add_counters(counters, piece.counters)
        way.record(due, Piece(*earlier, counters))
        x = self._whole(way, t, x)
        widest = self.guards.rates(t, replace(moment, x=x, z=z), between=True)[1]
        vague, small = (which if n[which] > way.largest[which] else None for n in (noise, widest))
        return Arrival(t, x, z, vague, small)

    def _only(self, asked: Segment, t: float) -> Segment:
        """The same that ends at a time, and delivers nothing before."""
        shares = None if asked.shares is None else meshing.even(1)
        return replace(asked, times=np.array([t]), shares=shares, partial=False, step_budget=None)

    def _rows(
        self, way: _Way, asked: Segment, piece: Piece, due: Vector, counters: dict[str, float]
    ) -> tuple[Vector, Vector]:
        """States and algebraic variables at some instants of a piece; what that takes is added to the counters."""
        segment, regime = way.segment, way.moment.regime
        problem, n = regime.problem, regime.problem.n_dynamic
        there = np.searchsorted(asked.times[: piece.x.shape[1] - 1], due)
        if (asked.times[there] == due).all():
            return piece.x[:, there], piece.z[:, there]
        x, z = np.tile(segment.x[:, None], (1, len(due))), np.tile(segment.z[:, None], (1, len(due)))
        nodes = np.append(segment.start, asked.times[: piece.x.shape[1]])
        xs, zs = np.hstack([segment.x[:, None], piece.x]), np.hstack([segment.z[:, None], piece.z])
        nominal = np.concatenate([problem.scale_x, problem.scale_z])
        values = np.vstack([xs[:n], zs])
        size = np.abs(values[:, np.searchsorted(nodes, due).clip(1) - 1]).T
        allowed = segment.tolerances.of(size, nominal)
        if functions_of(problem.compiled).newton() is not None:
            allowed[:, n:] = np.inf  # they are put onto their equations
        found, good = between(nodes, values.T, due, allowed)
        x[:n], z[:] = found[:, :n].T, found[:, n:].T
        if good.any() and len(z):
            at = np.flatnonzero(good)
            z[:, at] = on_equations(problem, replace(segment, times=due[at]), x[:, at], z[:, at])
        if not good.all():
            at = np.flatnonzero(~good)
            k = int(np.searchsorted(nodes, due[at[0]])) - 1
            other = replace(segment, start=float(nodes[k]), times=due[at], x=xs[:, k], z=zs[:, k], first=0.0)
            try:
                own = self.integrate(regime, replace(other, partial=False, step_budget=None, shares=None))
            except RuntimeError as error:
                raise _NotDelivered(str(error)) from None
            x[:n, at], z[:, at] = own.x[:n], own.z
            add_counters(counters, own.counters)
        return x, z

    def _whole(self, way: _Way, t: float, x: Vector) -> Vector:
        """All states at the end of a stretch, with the integrals that act on nothing."""
        found = x[:, None].copy()
        self._grow(way, np.array([t]), found)
        return found[:, 0]

    def _grow(self, way: _Way, times: Vector, x: Vector) -> None:
        """The integrals that act on nothing, into states at some times behind the last ones that were asked for."""
        problem = way.moment.regime.problem
        if not problem.compiled.quadratures or not len(times):
            return
        own = slice(problem.n_dynamic, problem.n_dynamic + problem.compiled.quadratures)
        later = times > way.apart.start
        x[own, ~later] = way.apart.x[own, None]
        if later.any():
            x[own, later] = islands(problem, replace(way.apart, times=times[later]))
            way.apart = replace(way.apart, start=float(times[-1]), x=x[:, -1])

    def _root(self, seen: _Seen, row: int, k: int) -> float:
        """Where the polynomial through the nearest mesh points is zero."""
        low = max(seen.here, min(row + 1 - _NEAREST // 2, len(seen.times) - _NEAREST))
        near = slice(low, low + _NEAREST)
        return root(seen.times[near], seen.values[near, k], row - low)
