"""The agenda of a run: the instants at which it has to stop, and what requires them.

Some stops are known before the run begins: time events, samples, breaks of inputs over time, and outputs. They form the
`Schedule`. Others depend on the run itself, such as the end of the past that a delay can read; a `Source` supplies
them, stretch by stretch. The driver does not distinguish them: it goes from stop to stop.
"""

from __future__ import annotations

import math
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
from acausal.simulate.multiples import multiples
from acausal.simulate.native.program import Placed
from acausal.simulate.record.record import Recorder

# Stops coincide if they are closer than this fraction of the run, or than some rounding errors of the time.
_SAME_INSTANT = 1e-13
# Outputs and stops coincide if they are closer than this fraction of the segment, or of the run.
_MARGIN = 1e-12
_ROUNDING = 4.0 * float(np.finfo(float).eps)
# A tick is at an instant if it is within this fraction of the interval of its clock.
_AT_TICK = 1e-9


@dataclass(frozen=True, eq=False)
class Schedule:
    """The segments of a run, between `n` instants that are known before it starts."""

    instants: Vector  # start, time events and samples, stop [s]; ascending, shape (n,)
    modes: Vector  # modes of relations of time, and coefficients of inputs, in each segment; shape (n - 1, n_timely)
    samples: Vector  # which samples are true at each instant, shape (n, samples)
    times: Vector  # output times of all segments; the last one of each is its end
    ends: NDArray[np.int64]  # index after the last output time of each segment, shape (n - 1,)
    # The longest step of a multistep method in each segment [s], or None.
    bounds: tuple[float | None, ...]

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.instants) - 1

    @cached_property
    def longest(self) -> int:
        """The most output times of any segment."""
        return int(lengths(self.ends).max())

    @cached_property
    def placed(self) -> Placed:
        """Its arrays for compiled code, under the names that are used there."""
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

    `instants`, `grid`: Ascending times [s], of any number each.
    `tables`, `longest`: Steps are no longer than these tables permit, nor than `longest` [s].
    """
    a, b = instants[:-1], instants[1:]
    margin = _MARGIN * (b - a)
    segment = np.minimum(np.maximum(np.searchsorted(instants, grid, side="right") - 1, 0), len(a) - 1)
    outputs = grid[(grid > (a + margin)[segment]) & (grid < (b - margin)[segment])]
    inside = np.searchsorted(outputs, b)
    middle, modes = 0.5 * (a + b), functions_of(compiled).modes
    timely = modes.many(middle[:, None], p)[:, : compiled.n_timely]
    # without tables, one bound holds for all segments, which may be thousands
    bounded = len(a) if tables.are_dense else 1
    bounds = tuple(
        tables.longest(*ends, longest) for ends in zip(a[:bounded].tolist(), b[:bounded].tolist(), strict=True)
    )
    return Schedule(
        instants,
        inputs.into(compiled, timely, middle),
        due(compiled, p, instants),
        np.insert(outputs, inside, b),
        inside + np.arange(1, len(b) + 1),
        bounds if tables.are_dense else bounds * len(a),
    )


def lengths(ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Lengths of parts that follow each other from 0 on, by their ends; in a tenth of the time of `np.diff`."""
    found = ends.copy()
    found[1:] -= ends[:-1]
    return found


Known = Callable[[CompiledModel, Vector, Inputs, float, float], Vector]
"""Instants known in advance: `(compiled, p, inputs, start, stop) -> times`, in any order, possibly outside the run."""

KNOWN: tuple[Known, ...] = (
    lambda compiled, p, inputs, start, stop: functions_of(compiled).instants(p)[0],
    lambda compiled, p, inputs, start, stop: sample_times(compiled, p, start, stop),
    lambda compiled, p, inputs, start, stop: inputs.breaks,
)


def known_instants(
    compiled: CompiledModel, p: Vector, inputs: Inputs, start: float, stop: float, cuts: Vector | None = None
) -> Vector:
    """Start, instants known in advance or given as `cuts` inside the run, and stop [s]; ascending and distinct."""
    shortest = max(_SAME_INSTANT * (stop - start), _ROUNDING * max(abs(start), abs(stop)))
    known = [times(compiled, p, inputs, start, stop) for times in KNOWN]
    found = np.concatenate(known if cuts is None else [*known, cuts])
    inside = found[(found > start + shortest) & (found < stop - shortest)]
    if not len(inside):
        return np.array([start, stop])
    inside = np.unique(inside)
    is_distinct = np.diff(inside, prepend=-np.inf) > shortest
    return np.concatenate([[start], inside[is_distinct], [stop]])


class Source(Protocol):
    """Stops a run at instants that depend on the run itself. It is called at the start of each stretch."""

    def next_stop(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """Where the stretch from `here` has to end, at most at `until`, and what the source has caused at `here`."""
        ...

    def set_modes(self, modes: Vector) -> None:
        """Write the modes that it determines during the stretch into those that depend on time, shape (n_timely,)."""
        ...

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Whether the equations hold from here on; if not, the run ends, without the event at its end.

        The stretch has come to `record.time`, with `events` at these times on the way. It is not `complete` if it was
        broken off by `TooFar`. The source may cut invalid rows from the record.
        """
        ...


class TooFar(Exception):
    """Raised where a stretch leaves the range of a source: rows recorded so far count, and the run continues there."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """From one stop, `start`, to the next, `end` [s]."""

    start: float
    end: float
    modes: Vector  # modes that depend on time alone while it lasts, shape (n_timely,)
    samples: Vector  # which samples are true at its start
    times: Vector  # output times, the last one is `end`
    longest: float | None = None  # the longest step [s], if it is limited
    # Whether it begins at an instant of the schedule; otherwise a source has stopped the run there, for these `causes`.
    opens: bool = True
    causes: tuple[Cause, ...] = ()

    @cached_property
    def alone(self) -> Schedule:
        """It as a schedule of one segment, for compiled code."""
        samples, ends = np.stack([self.samples, np.zeros_like(self.samples)]), np.array([len(self.times)])
        instants = np.array([self.start, self.end])
        return Schedule(instants, self.modes[None], samples, self.times, ends, (self.longest,))


@dataclass(frozen=True)
class Position:
    """How far a run has come: to `here` [s], in which segment.

    `entered`: Whether the event at the start of the stretch has been executed.
    `fresh`: Whether nothing has followed it yet.
    `arrived`: Whether a state event is here that has not been executed.
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

    def stretch(self, position: Position, moment: Moment, opens: bool) -> Stretch:
        """The stretch that begins at a position; `opens` as in `Stretch`."""
        schedule, segment = self.schedule, position.segment
        start, end = float(schedule.instants[segment]), float(schedule.instants[segment + 1])
        stretch = Stretch(
            start,
            end,
            schedule.modes[segment],
            schedule.samples[segment],
            schedule.outputs(segment),
            schedule.bounds[segment],
        )
        if not self.sources:
            return stretch
        causes: tuple[Cause, ...] = ()
        for source in self.sources:
            end, reasons = source.next_stop(position.here, end, moment)
            causes += reasons
        modes = stretch.modes.copy()
        for source in self.sources:
            source.set_modes(modes)
        outputs, margin = stretch.times, self.margin
        near = outputs[np.abs(outputs - end) <= margin]
        end = float(near[0]) if len(near) else end
        times = np.append(outputs[(outputs > position.here + margin) & (outputs < end - margin)], end)
        samples = stretch.samples if opens else np.zeros_like(stretch.samples)
        return Stretch(position.here, end, modes, samples, times, stretch.longest, opens, causes)

    @property
    def margin(self) -> float:
        """Instants coincide if they are closer than this [s]."""
        return max(_MARGIN * self.span, _ROUNDING * float(np.abs(self.schedule.instants[[0, -1]]).max()))

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Report to all sources how far a stretch has come; whether all of them accept it."""
        return all([source.accepts(record, events, complete) for source in self.sources])


def clocks(compiled: CompiledModel, p: Vector) -> list[tuple[float, float]]:
    """Start and interval of each sample [s]."""
    pool = compiled.solution.structure.reduced.pool
    leaves = {"par": p.__getitem__, "time": lambda _: 0.0}
    found = []
    for number in compiled.state_events.samples:
        _, a, b = pool.nodes[number]
        evaluated = values(pool, [a, b], leaves)
        first, interval = float(evaluated[a]), float(evaluated[b])
        if not (np.isfinite(first) and 0.0 < interval < np.inf):
            raise not_a_clock(compiled.name, first, interval, users(compiled, number))
        found.append((first, interval))
    return found


def users(compiled: CompiledModel, sample: int) -> list[Clause]:
    """Clauses whose conditions contain a sample."""
    pool = compiled.solution.structure.reduced.pool
    return [c for c in compiled.state_events.clauses if sample in pool.reachable(c.conditions)]


def sample_times(compiled: CompiledModel, p: Vector, start: float, stop: float) -> Vector:
    """All instants of samples between two times [s], clock by clock."""
    return np.concatenate([np.zeros(0), *(_ticks(*clock, start, stop) for clock in clocks(compiled, p))])


def due(compiled: CompiledModel, p: Vector, times: Vector) -> Vector:
    """Which samples are true at n ascending instants, shape (n, samples).

    A tick belongs to the nearest instant, however far away that is: at 1e6 s, a clock of 1 ms is accurate to 1e-7 of
    its interval, and instants of a long run that coincide up to rounding errors were merged.
    """
    found = np.zeros((len(times), len(compiled.state_events.samples)))
    for k, clock in enumerate(clocks(compiled, p)):
        found[_nearest(times, _ticks(*clock, times[0], times[-1])), k] = 1.0
    return found


def _ticks(first: float, interval: float, start: float, stop: float) -> Vector:
    """The ticks of a clock between two times [s], which are included up to rounding errors."""
    margin = _AT_TICK + _ROUNDING * max(abs(first), abs(start), abs(stop)) / interval
    begin, end = math.ceil((start - first) / interval - margin), math.floor((stop - first) / interval + margin)
    return multiples(first, interval, np.arange(max(0, begin), end + 1))


def _nearest(times: Vector, ticks: Vector) -> NDArray[np.int64]:
    """Indices of the ascending times that are nearest to the ticks."""
    if len(times) == 1:
        return np.zeros(len(ticks), dtype=np.int64)
    right = np.clip(np.searchsorted(times, ticks), 1, len(times) - 1)
    return np.where(ticks - times[right - 1] <= times[right] - ticks, right - 1, right)
