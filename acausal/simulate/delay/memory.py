"""The memory of a run: which part of the past each stretch sees, and where the past breaks.

The method of steps (A. Bellen, M. Zennaro, Numerical Methods for Delay Differential Equations, 2003, chapter 3): a run
is cut into stretches that are no longer than the shortest delay, so that what a stretch reads is known when it begins.
What breaks at one instant, by an event or at the start of the run, breaks again one delay later, more smoothly by one
derivative with each integration in between; the run is cut there as long as a solver could notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from acausal.analyse.delays import DEGREE, WIDTH, Delay
from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.lower.chebyshev import between, fitted, tail
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.delay.errors import changed_kind, out_of_bounds, vanished
from acausal.simulate.delay.history import History, Panel
from acausal.simulate.delay.recording import Recording
from acausal.simulate.driver.agenda import TooFar
from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.events.regime import Regime
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Piece, Segment, Tolerances

# Breaks of higher derivatives are left to the solvers, whose order is at most five.
_LAST_ORDER = 5
_MOST_STRETCHES = 1e6
_INSTANT = 4e-12
# Share of their tolerance that BDF codes get: what is read back adds up, and each stretch begins with order one.
_BDF_SHARE, _FINEST = 0.1, 1e-13


@dataclass(frozen=True)
class Break:
    """An instant at which a derivative of that order of a source jumps; order 0 is the source itself."""

    time: float
    source: int
    order: int


class Memory:
    """What one run remembers: a source of stops (`driver/agenda.py`)."""

    def __init__(self, compiled: CompiledModel, p: Vector, u: Vector, tolerances: Tolerances, span: float) -> None:
        self.compiled = compiled
        self.p, self.u = p, u
        self.tolerances = tolerances
        self.span = span
        self.items = compiled.delays.items
        self.n = len(compiled.delays.sources)
        self.lengths, self.longest = _lengths(compiled, p, span)
        self.numbers = np.zeros(compiled.delays.size)
        self.windows: list[tuple[float, float]] = [(0.0, 0.0)] * len(self.items)
        self.breaks: list[Break] = []
        self.scale = np.zeros(self.n)
        self.history: History
        self._gaps: list[tuple[float, float]] = []
        self._upward = [True] * len(self.items)
        self._noise = np.zeros(len(self.items))  # how far off a delay that follows from states may read [s]
        self._exit = (0, 0.0)  # where a delay that varies left its window: which one, and at which of its edges
        self._arrived: tuple[int, float] | None = None  # the same for a stretch that was ended there
        self._begun = -np.inf  # where the stretch begins that `_read` is of
        self._read = np.zeros(len(self.items))
        self._reach = np.ones(len(self.items))  # width of the window of a delay that varies, by that of the stretch
        self._recording: Recording | None = None
        self._limit = np.inf
        self._left: float | None = None  # when a delay left the past that its stretch sees; None: more is to be seen
        first = compiled.n_timely - len(self.numbers)
        self.own = slice(first, first + len(self.numbers))
        """The places of the delays among the modes."""

    # ---- the start -------------------------------------------------------------------------------------------------

    def assume(self, past: Vector) -> None:
        """Numbers of all delays for sources that have always been `past`."""
        self.numbers[:] = 0.0
        for k, item in enumerate(self.items):
            self.numbers[WIDTH * k + 2] = past[item.source]

    def begin(self, t: float, past: Vector) -> None:
        """The run begins; before it the sources were `past`."""
        self.assume(past)
        self.history = History(t, past)
        self.scale = np.abs(past)
        self.breaks = [Break(t, k, 1) for k in range(self.n)]

    def sources(self, t: float, moment: Moment) -> Vector:
        """All sources at one instant."""
        return self._signals(moment.regime, np.array([t]), moment.x[:, None], moment.z[:, None], moment.m)[0, : self.n]

    # ---- before a stretch ------------------------------------------------------------------------------------------

    def next_stop(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """Look at the past for the stretch from `here` on, at most to `until`.

        Returns where the stretch ends, and the delays that jump just here.
        """
        end = min(until, self._limit)
        instant = _INSTANT * max(self.span, abs(here))
        lags = self._lags(here, moment)
        gaps = [self._gap(k, here - lag, here, instant) for k, lag in enumerate(lags)]
        for k, (item, lag) in enumerate(zip(self.items, lags, strict=True)):
            breaks = gaps[k][1] + lag if item.is_constant else np.inf
            end = min(end, here + lag, breaks)
        if until - end <= instant:
            end = until
        while True:
            found = [self._window(k, lags[k], gaps[k], here, end) for k in range(len(lags))]
            if all(good for _, good in found) or end - here <= 1e3 * instant:
                break
            end = here + 0.5 * (end - here)
        self._gaps, self._read, self._begun = gaps, here - lags, here
        numbers = np.concatenate([v for v, _ in found])
        causes = self._jumps(here - lags, numbers) if here > self.history.start else ()
        self.numbers = numbers
        if not end - here > 1e-3 * instant:
            raise vanished(self.compiled.name, here, self.items[int(np.argmin(lags))], float(np.min(lags)))
        return end, causes

    def set_modes(self, modes: Vector) -> None:
        """What the stretch sees of the past, into its modes."""
        modes[self.own] = self.numbers

    def jumped(self, t: float, moment: Moment) -> tuple[Vector, tuple[Cause, ...]] | None:
        """Modes with which delays read where an event has put them, and the delays whose values have jumped.

        None where each of them reads what its stretch sees anyway. A delay time that jumps would be read at the edge of
        that, in all that happens at the instant.
        """
        if not np.isnan(self.lengths).any() or not np.isfinite(self._begun):
            return None
        instant = _INSTANT * max(self.span, abs(t))
        lags, numbers = self._lags(t, moment), moment.m[self.own].copy()
        beyond = [k for k in range(len(lags)) if not self._is_seen(k, t - float(lags[k]), instant)]
        if not beyond:
            return None
        for k in beyond:
            gap, width = self._gap(k, t - lags[k], t, instant), float(lags[k])
            while True:
                found, is_good = self._window(k, float(lags[k]), gap, t, t + width)
                if is_good or width <= 1e3 * instant:
                    break
                width *= 0.5
            numbers[WIDTH * k : WIDTH * (k + 1)] = found
            if k < len(self._gaps):
                self._gaps[k], self._read[k] = gap, t - lags[k]
        causes = self._jumps(t - lags, numbers)
        self.numbers, m = numbers, moment.m.copy()
        m[self.own] = numbers
        return m, causes

    def _is_seen(self, k: int, read: float, instant: float) -> bool:
        low, high = self.windows[k]
        slack = self._slack(k, instant)
        return self.items[k].is_constant or low - slack <= read <= high + slack

    def _slack(self, k: int, instant: float) -> float:
        """How far beyond its window a delay that varies may read.

        What `_gap` takes for being beyond an edge is none that is left: the two would send the stretch to and fro.
        """
        low, high = self.windows[k]
        return float(max(1e-6 * (high - low) if np.isfinite(low) else 0.0, 2.0 * instant, 1.5 * self._noise[k]))

    def _lags(self, here: float, moment: Moment) -> Vector:
        """How long ago each delay reads at the beginning of the stretch."""
        lags = self.lengths.copy()
        if not np.isnan(lags).any():
            return lags
        row = self._signals(moment.regime, np.array([here]), moment.x[:, None], moment.z[:, None], moment.m)[0]
        for k, item in enumerate(self.items):
            if not item.is_constant:
                lags[k] = row[self.n + k]
                self._check(here, k, lags[k])
                if lags[k] * _MOST_STRETCHES < self.span:
                    raise vanished(self.compiled.name, here, item, float(lags[k]))
        return lags

    def _check(self, t: float, k: int, lag: float) -> None:
        small = 1e-9 * self.longest[k]
        if lag < -small or lag > self.longest[k] + small or np.isnan(lag):
            raise out_of_bounds(self.compiled.name, t, self.items[k], lag, float(self.longest[k]))

    def _gap(self, k: int, instant_read: float, here: float, instant: float) -> tuple[float, float]:
        """The stretch of the past without a break in which a delay reads, or is about to read."""
        item = self.items[k]
        times = np.array(sorted(b.time for b in self.breaks if b.source == item.source and b.time < here - instant))
        forward = item.is_constant or self._upward[k]
        instant = max(instant, self._noise[k])
        place = int(np.searchsorted(times, instant_read + instant if forward else instant_read - instant, side="right"))
        low = -np.inf if place == 0 else float(times[place - 1])
        high = here if place == len(times) else float(times[place])
        return low, high

    def _window(self, k: int, lag: float, gap: tuple[float, float], here: float, end: float) -> tuple[Vector, bool]:
        """Numbers of one delay for a stretch, and whether they say all that is to be said."""
        item = self.items[k]
        read = here - lag
        if item.is_constant:
            a, b = read, end - lag
        else:
            h = (end - here) * self._reach[k]
            a, b = max(gap[0], read - 0.6 * h), min(gap[1], read + 1.6 * h)
        found = np.zeros(WIDTH)
        if gap[1] <= self.history.start + _INSTANT * self.span and (item.is_constant or a < self.history.start):
            b = b if item.is_constant else gap[1]
            found[2] = self.history.panels[0].coefficients[0, item.source]
            self.windows[k] = (-np.inf, b)
            return found, True
        if not b > a:
            b = a + 1e-9 * max(lag, _INSTANT * self.span)
        past, exact = self.history.values(item.source, between(a, b, DEGREE))
        found[0], found[1] = 0.5 * (a + b), 2.0 / (b - a)
        found[2:] = fitted(past)
        self.windows[k] = (a, b)
        return found, exact or bool(tail(found[2:, None])[0] <= self._allowed()[item.source])

    def _jumps(self, read: Vector, numbers: Vector) -> tuple[Cause, ...]:
        """Delays whose value jumps from the end of the last stretch to the beginning of this one."""
        found = []
        for k, item in enumerate(self.items):
            left, right = (_read(v[WIDTH * k : WIDTH * (k + 1)], float(read[k])) for v in (self.numbers, numbers))
            if abs(right - left) > 20 * self._allowed()[item.source]:
                found.append(Cause(f"{item.label} jumps", item.where, item.component))
        return tuple(found)

    # ---- during a stretch ------------------------------------------------------------------------------------------

    def recorded(self, integrate: Any, multistep: bool) -> Any:
        """The same integration, which is remembered."""
        share = _BDF_SHARE if multistep else 1.0
        self._recording = Recording(integrate, self._along)

        def run(regime: Regime, segment: Segment) -> Piece:
            assert self._recording is not None, "made above"
            asked = segment.tolerances
            segment = replace(segment, tolerances=asked.scaled(share, least=min(_FINEST, asked.relative)))
            piece, panels = self._recording(regime, segment, self._limits)
            self._stay(panels)
            self.history.put([p._replace(coefficients=p.coefficients[:, : self.n]) for p in panels])
            return piece

        return run

    def _limits(self, found: Vector) -> Vector:
        """What may be left open of each signal, given its values."""
        self.scale = np.maximum(self.scale, np.abs(found[:, : self.n]).max(axis=0))
        times = np.full(found.shape[1] - self.n, self.tolerances.scaled(self.span).relative)
        return np.append(self._allowed(), times)

    def _allowed(self) -> Vector:
        return self.tolerances.of(self.scale)

    def _along(self, regime: Regime, segment: Segment, times: Vector, piece: Piece) -> Vector:
        """Sources at the start and at the rows of a stretch, and the delays where one varies."""
        all_times = np.append(segment.start, times)
        x, z = (np.column_stack([a, b]) for a, b in ((segment.x, piece.x), (segment.z, piece.z)))
        found = self._signals(regime, all_times, x, z, segment.p)
        return found[:, : self.n] if not np.isnan(self.lengths).any() else found

    def _signals(self, regime: Regime, times: Vector, x: Vector, z: Vector, m: Vector) -> Vector:
        modes = regime.modes(times, x, z, m)
        function = self.compiled.delay_signals if not regime.holds else self.compiled.blended_delay_signals
        return rows(function, (times[:, None], x.T, z.T, self.u, self.p, modes.T if modes.ndim == 2 else modes))

    def _stay(self, panels: Sequence[Panel]) -> None:
        """Raise TooFar where a delay that varies reads what the stretch cannot see."""
        first: float | None = None
        wider = False
        instant = _INSTANT * max(self.span, *(abs(p.b) for p in panels))
        for k, item in enumerate(self.items):
            if item.is_constant:
                continue
            (low, high), slack = self.windows[k], self._slack(k, instant)
            for p in panels:
                s = np.linspace(-1.0, 1.0, 65)
                t = 0.5 * (p.a + p.b) + 0.5 * (p.b - p.a) * s
                lag = np.polynomial.chebyshev.chebval(s, p.coefficients[:, self.n + k])
                self._check(float(t[int(np.argmin(lag))]), k, float(lag.min()))
                self._check(float(t[int(np.argmax(lag))]), k, float(lag.max()))
                read = t - lag
                out = (read > high + slack) | (read < low - slack)
                if not out.any():
                    continue
                j = int(np.argmax(out))
                self._upward[k] = bool(read[j] > high)
                edge = high if self._upward[k] else low
                if abs(edge - self._gaps[k][self._upward[k]]) > _INSTANT * self.span:
                    self._reach[k] *= 2.0
                    wider = True
                    break
                found = float(t[j]) if j == 0 else _crossing(p, self.n + k, edge, float(s[j - 1]), float(s[j]))
                if first is None or found < first:
                    first, self._exit = found, (k, edge)
                break
        if wider or first is not None:
            self._left = None if wider else first
            raise TooFar

    # ---- after a stretch -------------------------------------------------------------------------------------------

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Try the rest of the stretch again, or note what breaks where the run has come to."""
        if complete:
            self._reached(record.time)
        elif self._left is not None:
            self._shorten(record.time, self._left)
        for instant in events:
            self._broke(instant)
        return True

    def _shorten(self, here: float, t: float) -> None:
        """Try the stretch again, only up to `t`."""
        instant = _INSTANT * max(self.span, abs(here))
        k, edge = self._exit
        off = abs(edge - self._read[k])
        is_near = t <= here + 10 * instant
        self._limit = here + 100 * instant if is_near else t
        # it was there already, but for the error of the states; an event before an edge is none of that, unless it is
        # so near that no stretch fits between the two
        was_there = self._arrived == self._exit and off < 1e-3 * abs(here - self._read[k])
        if here == self._begun and (was_there or (is_near and off <= 100 * instant)):
            self._noise[k] = max(self._noise[k], 2.0 * off)
            self._limit = np.inf

    def _reached(self, t: float) -> None:
        """Breaks of what was read at the end of a stretch break the sources again."""
        self.history.cut(t)
        self._arrived = self._exit if np.isfinite(self._limit) else None
        self._limit = np.inf
        self._reach = np.maximum(1.0, 0.8 * self._reach)
        instant = 3 * _INSTANT * max(self.span, abs(t))
        smoother = dict(self.compiled.delays.smoother)
        for k, item in enumerate(self.items):
            read = t - self.lengths[k] if item.is_constant else self._edge(k)
            for b in [b for b in self.breaks if b.source == item.source and abs(b.time - read) <= instant]:
                for source in range(self.n):
                    if (k, source) in smoother:
                        self._break(t, source, b.order + smoother[k, source], instant)
        oldest = t - float(self.longest.max()) - 2 * instant
        self.breaks = [b for b in self.breaks if b.time >= oldest]
        self.history.forget(oldest)

    def _edge(self, k: int) -> float:
        """Where a delay that varies reads at the end of a stretch, when that is an edge of its window."""
        low, high = self.windows[k]
        return high if self._upward[k] else low

    def _break(self, t: float, source: int, order: int, instant: float) -> None:
        same = [b for b in self.breaks if b.source == source and abs(b.time - t) <= instant]
        if order <= _LAST_ORDER and all(b.order > order for b in same):
            self.breaks = [b for b in self.breaks if b not in same]
            self.breaks.append(Break(same[0].time if same else t, source, order))

    def _broke(self, t: float) -> None:
        """An event has happened: sources jump, or have a kink."""
        before, after = self.history.sides(t)
        for k in range(self.n):
            jumps = abs(after[k] - before[k]) > 20 * self._allowed()[k]
            self._break(t, k, 0 if jumps else 1, 3 * _INSTANT * max(self.span, abs(t)))


def _read(numbers: Vector, instant: float) -> float:
    """A delayed signal by its numbers."""
    s = np.clip((instant - numbers[0]) * numbers[1], -1.0, 1.0)
    return float(np.polynomial.chebyshev.chebval(s, numbers[2:]))


def _crossing(panel: Panel, column: int, edge: float, low: float, high: float) -> float:
    """The time in a panel at which `time - delay` is at an edge."""
    from scipy.optimize import brentq

    bracketed: Any = brentq

    def off(s: float) -> float:
        t = 0.5 * (panel.a + panel.b) + 0.5 * (panel.b - panel.a) * s
        return float(t - np.polynomial.chebyshev.chebval(s, panel.coefficients[:, column]) - edge)

    s = bracketed(off, low, high, xtol=1e-14) if off(low) * off(high) < 0 else low
    return float(0.5 * (panel.a + panel.b) + 0.5 * (panel.b - panel.a) * s)


def _lengths(compiled: CompiledModel, p: Vector, span: float) -> tuple[Vector, Vector]:
    """The constant delays (nan for those that vary), and the longest that each may be."""
    pool = compiled.solution.structure.reduced.pool
    leaves = {"par": p.__getitem__, "time": lambda _: 0.0}
    lengths, longest = [], []
    for item in compiled.delays.items:
        most = None if item.most is None else float(values(pool, [item.most], leaves)[item.most])
        constant = float(values(pool, [item.time], leaves)[item.time]) if item.is_constant else np.nan
        lengths.append(constant)
        longest.append(constant if most is None else most)
        if item.is_constant:
            _check_length(compiled.name, item, constant, longest[-1], span)
    return np.array(lengths), np.array(longest)


def _check_length(model: str, item: Delay, length: float, longest: float, span: float) -> None:
    if length == 0.0:
        raise changed_kind(model, item.name, 0.0)
    if length < 0.0 or length > longest or np.isnan(length):
        raise out_of_bounds(model, None, item, length, longest)
    if span / length > _MOST_STRETCHES:
        raise UsageError(
            "AC036",
            f"{item.name}: a delay of {length:g} s in a run of {span:g} s would take {span / length:.2g} stretches",
            where=(item.where,) if item.where is not None else (),
            help="a delay that short makes no difference: set it to 0 and compile again, or use PadeDelay",
        )


def check_undelayed(compiled: CompiledModel, p: Vector) -> None:
    """Refuse values of parameters under which a delay is there that the model was compiled without."""
    for node, label in compiled.flat.undelayed:
        length = float(values(compiled.flat.pool, [node], {"par": p.__getitem__, "time": lambda _: 0.0})[node])
        if length != 0.0:
            raise changed_kind(compiled.name, label, length)
