"""The past values of a run: which part of the past each stretch reads, and where the past has breaks.

This is the method of steps (A. Bellen, M. Zennaro, Numerical Methods for Delay Differential Equations, 2003, chapter
3): a run is cut into stretches that are no longer than the shortest delay, so that all values that a stretch reads are
known when it begins. A break in a signal, by an event or at the start of the run, recurs one delay later. Each
integration in between raises the order of the derivative that jumps by one. The run is cut at breaks up to the order
that affects solvers.

Each stretch sees the past of a delayed signal through a *window*: one polynomial over the interval that it will read.
For a constant delay that interval is known. For a delay that varies it is estimated, and the stretch is repeated if the
delay reads outside (`TooFar`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from acausal.analyse.delays import DEGREE, WIDTH, Delay
from acausal.arrays import Vector
from acausal.errors import EventError, UsageError
from acausal.lower.chebyshev import between, fitted, tail
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.delay.history import History, Panel
from acausal.simulate.delay.recording import Recording
from acausal.simulate.driver.agenda import TooFar
from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.events.regime import Regime
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Piece, Segment, Tolerances

# Breaks in higher derivatives are left to the solvers, whose order is at most five.
_LAST_ORDER = 5
_MOST_STRETCHES = 1e6
# Times that differ by less than this fraction of the run count as one instant.
_INSTANT = 4e-12
# BDF methods get this fraction of their tolerance, at least `_FINEST`: delays feed errors back, so that they add up,
# and each stretch begins with order one.
_BDF_FRACTION, _FINEST = 0.1, 1e-13


@dataclass(frozen=True)
class Break:
    """An instant [s] at which the derivative of this order of a source jumps; order 0 is the source itself."""

    time: float
    source: int
    order: int


class Memory:
    """The past of the delayed signals (sources) in one run, as a source of stops (`driver/agenda.py`)."""

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
        self._reads_upper_edge = [True] * len(self.items)
        self._read_error = np.zeros(len(self.items))  # error of the instant read by a delay that depends on states [s]
        self._exit_edge = (0, 0.0)  # the variable delay that left its window, and the edge at which it left [s]
        self._exit_of_limited: tuple[int, float] | None = None  # the same for a stretch that was shortened to end there
        self._stretch_start = -np.inf  # start of the stretch to which `_read_at_start` belongs [s]
        self._read_at_start = np.zeros(len(self.items))  # the instant that each delay reads there [s]
        self._relative_width = np.ones(len(self.items))  # window of a variable delay, relative to the stretch
        self._recording: Recording | None = None
        self._end_limit = np.inf
        self._exit_time: float | None = None  # when a delay left its window; None if the window is to be widened
        first = compiled.n_timely - len(self.numbers)
        self.delay_modes = slice(first, first + len(self.numbers))
        """Positions of the numbers of the delays among the modes."""

    # ---- the start -------------------------------------------------------------------------------------------------

    def assume(self, past: Vector) -> None:
        """Set the numbers of all delays for sources that were constant at `past`, shape (n,)."""
        self.numbers[:] = 0.0
        for k, item in enumerate(self.items):
            self.numbers[WIDTH * k + 2] = past[item.source]

    def begin(self, t: float, past: Vector) -> None:
        """Begin the run; before it, the sources were constant at `past`, shape (n,)."""
        self.assume(past)
        self.history = History(t, past)
        self.scale = np.abs(past)
        self.breaks = [Break(t, k, 1) for k in range(self.n)]

    def sources(self, t: float, moment: Moment) -> Vector:
        """All sources at one instant, shape (n,)."""
        return self._signals(moment.regime, np.array([t]), moment.x[:, None], moment.z[:, None], moment.m)[0, : self.n]

    # ---- before a stretch ------------------------------------------------------------------------------------------

    def next_stop(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """Choose the windows of the stretch from `here` on, which ends at `until` at the latest [s].

        Returns the end of the stretch, and the delays whose values jump at `here`.
        """
        end = min(until, self._end_limit)
        instant = _INSTANT * max(self.span, abs(here))
        lags = self._lags(here, moment)
        gaps = [self._gap(k, here - lag, here, instant) for k, lag in enumerate(lags)]
        for k, (item, lag) in enumerate(zip(self.items, lags, strict=True)):
            breaks = gaps[k][1] + lag if item.is_constant else np.inf
            end = min(end, here + lag, breaks)
        if until - end <= instant:
            end = until
        while True:
            windows = [self._window(k, lags[k], gaps[k], here, end) for k in range(len(lags))]
            if all(is_good for _, is_good in windows) or end - here <= 1e3 * instant:
                break
            end = here + 0.5 * (end - here)
        self._gaps, self._read_at_start, self._stretch_start = gaps, here - lags, here
        numbers = np.concatenate([v for v, _ in windows])
        causes = self._jumps(here - lags, numbers) if here > self.history.start else ()
        self.numbers = numbers
        if not end - here > 1e-3 * instant:
            raise vanished(self.compiled.name, here, self.items[int(np.argmin(lags))], float(np.min(lags)))
        return end, causes

    def set_modes(self, modes: Vector) -> None:
        """Write the numbers of the delays, through which the stretch sees the past, into its modes."""
        modes[self.delay_modes] = self.numbers

    def jumped(self, t: float, moment: Moment) -> tuple[Vector, tuple[Cause, ...]] | None:
        """Return modes with windows around the instants that delays read after an event, and the delays that jumped.

        None if each delay still reads inside its window. Otherwise a delay time that jumps would be read at the edge of
        the window during the rest of the event.
        """
        if not np.isnan(self.lengths).any() or not np.isfinite(self._stretch_start):
            return None
        instant = _INSTANT * max(self.span, abs(t))
        lags, numbers = self._lags(t, moment), moment.m[self.delay_modes].copy()
        outside = [k for k in range(len(lags)) if not self._is_in_window(k, t - float(lags[k]), instant)]
        if not outside:
            return None
        for k in outside:
            gap, width = self._gap(k, t - lags[k], t, instant), float(lags[k])
            while True:
                window, is_good = self._window(k, float(lags[k]), gap, t, t + width)
                if is_good or width <= 1e3 * instant:
                    break
                width *= 0.5
            numbers[WIDTH * k : WIDTH * (k + 1)] = window
            if k < len(self._gaps):
                self._gaps[k], self._read_at_start[k] = gap, t - lags[k]
        causes = self._jumps(t - lags, numbers)
        self.numbers, m = numbers, moment.m.copy()
        m[self.delay_modes] = numbers
        return m, causes

    def _is_in_window(self, k: int, read: float, instant: float) -> bool:
        low, high = self.windows[k]
        slack = self._slack(k, instant)
        return self.items[k].is_constant or low - slack <= read <= high + slack

    def _slack(self, k: int, instant: float) -> float:
        """How far outside its window a variable delay may read [s].

        It exceeds the tolerance by which `_gap` assigns an instant to the far side of an edge. Otherwise the two would
        move the stretch back and forth across the edge.
        """
        low, high = self.windows[k]
        return float(max(1e-6 * (high - low) if np.isfinite(low) else 0.0, 2.0 * instant, 1.5 * self._read_error[k]))

    def _lags(self, here: float, moment: Moment) -> Vector:
        """The length of each delay at the beginning of the stretch [s]."""
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
        """The interval of the past without breaks in which a delay reads, or is about to read [s]."""
        item = self.items[k]
        times = np.array(sorted(b.time for b in self.breaks if b.source == item.source and b.time < here - instant))
        forward = item.is_constant or self._reads_upper_edge[k]
        instant = max(instant, self._read_error[k])
        after = int(np.searchsorted(times, instant_read + instant if forward else instant_read - instant, side="right"))
        low = -np.inf if after == 0 else float(times[after - 1])
        high = here if after == len(times) else float(times[after])
        return low, high

    def _window(self, k: int, lag: float, gap: tuple[float, float], here: float, end: float) -> tuple[Vector, bool]:
        """Numbers of one delay for a stretch, shape (WIDTH,), and whether they represent the past accurately enough."""
        item = self.items[k]
        read = here - lag
        if item.is_constant:
            a, b = read, end - lag
        else:
            h = (end - here) * self._relative_width[k]
            a, b = max(gap[0], read - 0.6 * h), min(gap[1], read + 1.6 * h)
        numbers = np.zeros(WIDTH)
        if gap[1] <= self.history.start + _INSTANT * self.span and (item.is_constant or a < self.history.start):
            b = b if item.is_constant else gap[1]
            numbers[2] = self.history.panels[0].coefficients[0, item.source]
            self.windows[k] = (-np.inf, b)
            return numbers, True
        if not b > a:
            b = a + 1e-9 * max(lag, _INSTANT * self.span)
        past, exact = self.history.values(item.source, between(a, b, DEGREE))
        numbers[0], numbers[1] = 0.5 * (a + b), 2.0 / (b - a)
        numbers[2:] = fitted(past)
        self.windows[k] = (a, b)
        return numbers, exact or bool(tail(numbers[2:, None])[0] <= self._allowed()[item.source])

    def _jumps(self, read: Vector, numbers: Vector) -> tuple[Cause, ...]:
        """Delays whose value jumps between the end of the last stretch and the beginning of this one."""
        causes = []
        for k, item in enumerate(self.items):
            left, right = (_read(v[WIDTH * k : WIDTH * (k + 1)], float(read[k])) for v in (self.numbers, numbers))
            if abs(right - left) > 20 * self._allowed()[item.source]:
                causes.append(Cause(f"{item.label} jumps", item.where, item.component))
        return tuple(causes)

    # ---- during a stretch ------------------------------------------------------------------------------------------

    def recorded(self, integrate: Any, multistep: bool) -> Any:
        """Wrap an integration so that the sources along it are recorded in the history."""
        fraction = _BDF_FRACTION if multistep else 1.0
        self._recording = Recording(integrate, self._recorded_signals)

        def run(regime: Regime, segment: Segment) -> Piece:
            assert self._recording is not None, "made above"
            tolerances = segment.tolerances
            segment = replace(segment, tolerances=tolerances.scaled(fraction, least=min(_FINEST, tolerances.relative)))
            piece, panels = self._recording(regime, segment, self._limits)
            self._check_windows(panels)
            self.history.put([p._replace(coefficients=p.coefficients[:, : self.n]) for p in panels])
            return piece

        return run

    def _limits(self, recorded: Vector) -> Vector:
        """Allowed errors of the recorded signals, given their values of shape (m, signals)."""
        self.scale = np.maximum(self.scale, np.abs(recorded[:, : self.n]).max(axis=0))
        of_delays = np.full(recorded.shape[1] - self.n, self.tolerances.scaled(self.span).relative)
        return np.append(self._allowed(), of_delays)

    def _allowed(self) -> Vector:
        return self.tolerances.of(self.scale)

    def _recorded_signals(self, regime: Regime, segment: Segment, times: Vector, piece: Piece) -> Vector:
        """Sources at the start and at the rows of a stretch, and also the lengths of all delays if any varies."""
        all_times = np.append(segment.start, times)
        x, z = (np.column_stack([a, b]) for a, b in ((segment.x, piece.x), (segment.z, piece.z)))
        signals = self._signals(regime, all_times, x, z, segment.p)
        return signals[:, : self.n] if not np.isnan(self.lengths).any() else signals

    def _signals(self, regime: Regime, times: Vector, x: Vector, z: Vector, m: Vector) -> Vector:
        modes = regime.modes(times, x, z, m)
        function = self.compiled.delay_signals if not regime.holds else self.compiled.blended_delay_signals
        return rows(function, (times[:, None], x.T, z.T, self.u, self.p, modes.T if modes.ndim == 2 else modes))

    def _check_windows(self, panels: Sequence[Panel]) -> None:
        """Raise TooFar if a variable delay reads outside its window during the stretch."""
        first: float | None = None
        is_to_widen = False
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
                outside = (read > high + slack) | (read < low - slack)
                if not outside.any():
                    continue
                j = int(np.argmax(outside))
                self._reads_upper_edge[k] = bool(read[j] > high)
                edge = high if self._reads_upper_edge[k] else low
                if abs(edge - self._gaps[k][self._reads_upper_edge[k]]) > _INSTANT * self.span:
                    self._relative_width[k] *= 2.0
                    is_to_widen = True
                    break
                exit_time = float(t[j]) if j == 0 else _crossing(p, self.n + k, edge, float(s[j - 1]), float(s[j]))
                if first is None or exit_time < first:
                    first, self._exit_edge = exit_time, (k, edge)
                break
        if is_to_widen or first is not None:
            self._exit_time = None if is_to_widen else first
            raise TooFar

    # ---- after a stretch -------------------------------------------------------------------------------------------

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Record breaks at the end of a complete stretch and at events, or shorten a stretch for another attempt."""
        if complete:
            self._complete(record.time)
        elif self._exit_time is not None:
            self._shorten(record.time, self._exit_time)
        for instant in events:
            self._break_at_event(instant)
        return True

    def _shorten(self, here: float, t: float) -> None:
        """Repeat the stretch, but only up to `t` [s]."""
        instant = _INSTANT * max(self.span, abs(here))
        k, edge = self._exit_edge
        distance = abs(edge - self._read_at_start[k])
        is_near = t <= here + 10 * instant
        self._end_limit = here + 100 * instant if is_near else t
        # The last stretch already ended at this edge, up to the error of the states. A distance left by an event before
        # the edge is no such error, unless it is so small that no stretch fits in between.
        was_at_edge = self._exit_of_limited == self._exit_edge and distance < 1e-3 * abs(here - self._read_at_start[k])
        if here == self._stretch_start and (was_at_edge or (is_near and distance <= 100 * instant)):
            self._read_error[k] = max(self._read_error[k], 2.0 * distance)
            self._end_limit = np.inf

    def _complete(self, t: float) -> None:
        """Complete a stretch: breaks that delays read at its end cause new breaks in the sources."""
        self.history.cut(t)
        self._exit_of_limited = self._exit_edge if np.isfinite(self._end_limit) else None
        self._end_limit = np.inf
        self._relative_width = np.maximum(1.0, 0.8 * self._relative_width)
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
        """The instant that a variable delay reads at the end of a stretch, if that is an edge of its window [s]."""
        low, high = self.windows[k]
        return high if self._reads_upper_edge[k] else low

    def _break(self, t: float, source: int, order: int, instant: float) -> None:
        same = [b for b in self.breaks if b.source == source and abs(b.time - t) <= instant]
        if order <= _LAST_ORDER and all(b.order > order for b in same):
            self.breaks = [b for b in self.breaks if b not in same]
            self.breaks.append(Break(same[0].time if same else t, source, order))

    def _break_at_event(self, t: float) -> None:
        """Record the breaks of the sources at an event: a jump, or a kink."""
        before, after = self.history.sides(t)
        for k in range(self.n):
            jumps = abs(after[k] - before[k]) > 20 * self._allowed()[k]
            self._break(t, k, 0 if jumps else 1, 3 * _INSTANT * max(self.span, abs(t)))


def _read(numbers: Vector, instant: float) -> float:
    """The value of a delayed signal at an instant, from its numbers."""
    s = np.clip((instant - numbers[0]) * numbers[1], -1.0, 1.0)
    return float(np.polynomial.chebyshev.chebval(s, numbers[2:]))


def _crossing(panel: Panel, column: int, edge: float, low: float, high: float) -> float:
    """The time in a panel at which `time - delay` crosses an edge [s]."""
    from scipy.optimize import brentq

    find_root: Any = brentq

    def difference(s: float) -> float:
        t = 0.5 * (panel.a + panel.b) + 0.5 * (panel.b - panel.a) * s
        return float(t - np.polynomial.chebyshev.chebval(s, panel.coefficients[:, column]) - edge)

    s = find_root(difference, low, high, xtol=1e-14) if difference(low) * difference(high) < 0 else low
    return float(0.5 * (panel.a + panel.b) + 0.5 * (panel.b - panel.a) * s)


def _lengths(compiled: CompiledModel, p: Vector, span: float) -> tuple[Vector, Vector]:
    """The constant delays (nan for variable ones), and the maximum of each [s]; shapes (k,)."""
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
            help="so short a delay does not matter for the result: set it to 0 and compile again, or use PadeDelay",
        )


def check_undelayed(compiled: CompiledModel, p: Vector) -> None:
    """Refuse parameter values that make a delay nonzero which was zero when the model was compiled."""
    for node, label in compiled.flat.undelayed:
        length = float(values(compiled.flat.pool, [node], {"par": p.__getitem__, "time": lambda _: 0.0})[node])
        if length != 0.0:
            raise changed_kind(compiled.name, label, length)


def out_of_bounds(model: str, t: float | None, item: Delay, length: float, longest: float) -> EventError | UsageError:
    """A delay that is negative, or longer than its declared maximum; `t` is None for a constant delay."""
    limits = f"it is {length:.9g} s, and must be at least 0" + (f" and at most {longest:.9g} s" if longest >= 0 else "")
    kind = UsageError if t is None else EventError
    return kind(
        "AC182",
        f"{item.name} cannot be read" + (f" at t = {t:.9g} s in {model}" if t is not None else f" in {model}"),
        where=(item.where,) if item.where is not None else (),
        evidence=[limits],
        cause="the future of a signal is unknown" if length < 0 else "older values are no longer stored",
        help="limit it: maximum(T, 0.0)" if length < 0 else "raise the maximum, the third argument of delay",
    )


def vanished(model: str, t: float, item: Delay, length: float) -> EventError:
    """A variable delay that becomes so short that a run makes no progress."""
    return EventError(
        "AC185",
        f"{item.name} is {length:.3g} s at t = {t:.9g} s in {model}: too short to continue",
        where=(item.where,) if item.where is not None else (),
        cause="a run is integrated in stretches that are no longer than its shortest delay",
        help="give it a lower limit that does not matter for the result: maximum(T, 1e-3)",
    )


def changed_kind(model: str, name: str, length: float) -> UsageError:
    """A delay that is zero in a model compiled with a nonzero one, or the other way round."""
    zero = length == 0.0
    return UsageError(
        "AC037",
        f"{name} is {length:g} s, but {model} was compiled {'with a delay there' if zero else 'with 0 s there'}",
        cause="with a delay of zero the model has other equations, because the delayed signal is the signal itself",
        help="compile again with the value: acausal.compile(model, parameters={...})",
    )
