"""The agenda of a run: where it has to stop, and who asks for it.

Some stops are known before the run begins: time events, samples, breaks of inputs over time, outputs. They are the
`Schedule`. Others follow from what the run has come to, such as the end of the past that a delay can read: they are
handed in by a `Source`, stretch by stretch. The driver knows neither; it goes from stop to stop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.state_events import Clause
from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.kinks import NONE, Kinks
from acausal.simulate.events.errors import not_a_clock
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.native.program import Placed
from acausal.simulate.record.record import Recorder

# Stops nearer than this share of the run, or than times are rounded, are one.
_APART = 1e-13
_MARGIN = 1e-12
_ROUNDING = 4.0 * float(np.finfo(float).eps)
# A tick as near as this to an instant, by the interval of the clock, is at it.
_NEAR = 1e-9


@dataclass(frozen=True, eq=False)
class Schedule:
    """The segments of a run, between `n` instants that are known before it starts."""

    instants: Vector  # start, time events and samples, stop [s]; ascending, shape (n,)
    # Modes of the relations of time and numbers of inputs over time in each segment, shape (n - 1, n_timely).
    modes: Vector
    samples: Vector  # which samples are true at each instant, shape (n, samples)
    times: Vector  # output times of all segments, each up to its end, and `ends`, where those of each segment end
    ends: NDArray[np.int64]
    # The longest step of a method of several steps in each segment [s], where there is one.
    bounds: tuple[float | None, ...]

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.instants) - 1

    @cached_property
    def longest(self) -> int:
        """The most output times of any segment."""
        return int(np.max(np.diff(self.ends, prepend=0)))

    @cached_property
    def placed(self) -> Placed:
        """Its arrays as compiled code reads them, by its names for them."""
        numbers = {
            "boundary": self.instants,
            "timely_modes": self.modes,
            "due": self.samples,
            "times": self.times,
        }
        found: dict[str, NDArray[Any]] = {k: np.ascontiguousarray(v, dtype=np.float64) for k, v in numbers.items()}
        return Placed(found | {"times_end": self.ends})

    def outputs(self, segment: int) -> Vector:
        """Output times of one segment; the last one is its end."""
        return self.times[self.ends[segment - 1] if segment else 0 : self.ends[segment]]


def schedule(
    compiled: CompiledModel,
    p: Vector,
    inputs: Inputs,
    instants: Vector,
    grid: Vector,
    tables: Kinks = NONE,
    longest: float | None = None,
) -> Schedule:
    """The schedule over `instants`, with outputs on `grid` and at every instant.

    `instants`, `grid`: Times [s], ascending, of any number each.
    `tables`, `longest`: No step is longer than the bound of these tables and than this [s].
    """
    a, b = instants[:-1], instants[1:]
    margin = _MARGIN * (b - a)
    owner = np.clip(np.searchsorted(instants, grid, side="right") - 1, 0, len(a) - 1)
    kept = grid[(grid > (a + margin)[owner]) & (grid < (b - margin)[owner])]
    inside = np.searchsorted(kept, b)
    middle, modes = 0.5 * (a + b), functions_of(compiled).modes
    timely = modes.many(middle[:, None], p)[:, : compiled.n_timely]
    # without tables one bound holds for thousands of segments
    bounded = len(a) if tables.are_dense else 1
    bounds = tuple(
        tables.longest(*ends, longest) for ends in zip(a[:bounded].tolist(), b[:bounded].tolist(), strict=True)
    )
    return Schedule(
        instants,
        inputs.into(compiled, timely, middle),
        due(compiled, p, instants),
        np.insert(kept, inside, b),
        inside + np.arange(1, len(b) + 1),
        bounds if tables.are_dense else bounds * len(a),
    )


Known = Callable[[CompiledModel, Vector, Inputs, float, float], Vector]
"""Instants known in advance: `(compiled, p, inputs, start, stop) -> times`, in any order, also outside of the run."""

KNOWN: tuple[Known, ...] = (
    lambda compiled, p, inputs, start, stop: functions_of(compiled).instants(p)[0],
    lambda compiled, p, inputs, start, stop: sample_times(compiled, p, start, stop),
    lambda compiled, p, inputs, start, stop: inputs.breaks,
)


def known_instants(
    compiled: CompiledModel, p: Vector, inputs: Inputs, start: float, stop: float, cuts: Vector | None = None
) -> Vector:
    """Start, the instants known in advance inside the run and further `cuts`, and stop [s], ascending, each once."""
    least = max(_APART * (stop - start), _ROUNDING * max(abs(start), abs(stop)))
    known = [times(compiled, p, inputs, start, stop) for times in KNOWN]
    found = np.concatenate(known if cuts is None else [*known, cuts])
    if not len(found):
        return np.array([start, stop])
    found = np.unique(found)
    inside = found[np.isfinite(found) & (found > start + least) & (found < stop - least)]
    apart = np.diff(inside, prepend=-np.inf) > least
    return np.concatenate([[start], inside[apart], [stop]])


class Source(Protocol):
    """What stops a run at instants that follow from the run itself. It is asked where a stretch begins."""

    def next_stop(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """Where the stretch from `here` on has to end, at most at `until`, and what happens at `here` because of it."""
        ...

    def set_modes(self, modes: Vector) -> None:
        """Write its own modes during the stretch into those that depend on time, shape (n_timely,)."""
        ...

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Whether the equations hold from here on; if not, the run ends, without the event at its end.

        The stretch has come to `record.time`, with `events` on the way; not `complete` where it was found to go too
        far. Rows that should not be there may be cut from the record.
        """
        ...


class TooFar(Exception):
    """A stretch has left what a source can answer for: the rows recorded count, and it is tried again from there."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """From one stop to the next."""

    # `start`, `end`: its stops [s].
    start: float
    end: float
    modes: Vector  # modes that depend on time alone while it lasts, shape (n_timely,)
    samples: Vector  # which samples are true at its start
    times: Vector  # output times, the last one is `end`
    longest: float | None = None  # the longest step [s], where there is one
    # Whether it begins at an instant of the schedule; else a source has cut there, because of `causes`.
    opens: bool = True
    causes: tuple[Cause, ...] = ()


@dataclass(frozen=True)
class Place:
    """How far a run has come: `here` [s], in which segment.

    `entered` says whether the event at the start of the stretch has been, `fresh` that nothing has followed it yet,
    `arrived` that the event of a variable is here, and has not been passed.
    """

    segment: int
    here: float
    entered: bool
    fresh: bool
    arrived: bool = False


@dataclass(frozen=True, eq=False)
class Agenda:
    """All stops of a run; `span` is its length [s]."""

    schedule: Schedule
    sources: tuple[Source, ...]
    span: float

    def stretch(self, place: Place, moment: Moment, opens: bool) -> Stretch:
        """The stretch that begins at a place."""
        known, k = self.schedule, place.segment
        start, end = float(known.instants[k]), float(known.instants[k + 1])
        whole = Stretch(start, end, known.modes[k], known.samples[k], known.outputs(k), known.bounds[k])
        if not self.sources:
            return whole
        causes: tuple[Cause, ...] = ()
        for source in self.sources:
            end, why = source.next_stop(place.here, end, moment)
            causes += why
        modes = whole.modes.copy()
        for source in self.sources:
            source.set_modes(modes)
        outputs, margin = whole.times, self.margin
        near = outputs[np.abs(outputs - end) <= margin]
        end = float(near[0]) if len(near) else end
        times = np.append(outputs[(outputs > place.here + margin) & (outputs < end - margin)], end)
        samples = whole.samples if opens else np.zeros_like(whole.samples)
        return Stretch(place.here, end, modes, samples, times, whole.longest, opens, causes)

    @property
    def margin(self) -> float:
        """Instants nearer than this are one [s]."""
        return max(_MARGIN * self.span, _ROUNDING * float(np.abs(self.schedule.instants[[0, -1]]).max()))

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Tell the sources how far a stretch has come; whether all of them can go on."""
        return all([source.accepts(record, events, complete) for source in self.sources])


def clocks(compiled: CompiledModel, p: Vector) -> list[tuple[float, float]]:
    """Start and interval of each sample [s]."""
    pool = compiled.solution.structure.reduced.pool
    leaves = {"par": p.__getitem__, "time": lambda _: 0.0}
    found = []
    for number in compiled.state_events.samples:
        _, a, b = pool.nodes[number]
        known = values(pool, [a, b], leaves)
        first, interval = float(known[a]), float(known[b])
        if not (np.isfinite(first) and 0.0 < interval < np.inf):
            raise not_a_clock(compiled.name, first, interval, users(compiled, number))
        found.append((first, interval))
    return found


def users(compiled: CompiledModel, sample: int) -> list[Clause]:
    """Clauses whose condition holds a sample."""
    pool = compiled.solution.structure.reduced.pool
    return [c for c in compiled.state_events.clauses if sample in pool.reachable(c.conditions)]


def sample_times(compiled: CompiledModel, p: Vector, start: float, stop: float) -> Vector:
    """All instants of samples between two times [s], clock by clock."""
    return np.concatenate([np.zeros(0), *(_ticks(*clock, start, stop) for clock in clocks(compiled, p))])


def due(compiled: CompiledModel, p: Vector, times: Vector) -> Vector:
    """Which samples are true at n instants, ascending, shape (n, samples).

    A tick belongs to the instant next to it, however far that is by the interval: at 1e6 s a clock of 1 ms is known to
    1e-7 of its interval, and instants of a long run that cannot be told apart have become one.
    """
    found = np.zeros((len(times), len(compiled.state_events.samples)))
    for k, clock in enumerate(clocks(compiled, p)):
        found[_nearest(times, _ticks(*clock, times[0], times[-1])), k] = 1.0
    return found


def _ticks(first: float, interval: float, start: float, stop: float) -> Vector:
    """The ticks of a clock between two times [s], the ends included to rounding."""
    near = _NEAR + _ROUNDING * max(abs(first), abs(start), abs(stop)) / interval
    k = np.arange(max(0.0, np.ceil((start - first) / interval - near)), np.floor((stop - first) / interval + near) + 1)
    return first + interval * k


def _nearest(times: Vector, ticks: Vector) -> NDArray[np.int64]:
    """Indices of the times, ascending, that are nearest to the ticks."""
    if len(times) == 1:
        return np.zeros(len(ticks), dtype=np.int64)
    right = np.clip(np.searchsorted(times, ticks), 1, len(times) - 1)
    return np.where(ticks - times[right - 1] <= times[right] - ticks, right - 1, right)
