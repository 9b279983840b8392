"""Conversion of the given inputs of a run: constants to the vector u, functions of time to polynomials."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real as Number
from pathlib import Path
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, UnitError, UsageError
from acausal.flatten.parameters import check_limit
from acausal.language.declarations.declaration import Declaration
from acausal.lower.chebyshev import INPUT_WIDTH
from acausal.lower.compiled import CompiledModel
from acausal.numeric.stretches import variation
from acausal.result.csvfile import clock_among
from acausal.result.files import READERS
from acausal.result.result import Result
from acausal.result.seconds import seconds
from acausal.result.series import TimeSeries, read_series
from acausal.simulate.inputs.pieces import Pieces, held, sampled, straight
from acausal.simulate.options import input_vector
from acausal.simulate.solvers.segment import Tolerances
from acausal.units import ambiguous, convert, format_dimension, in_si, parse

# Allowed error of an input, relative to the size of its variation, as a fraction of the tolerance.
_FRACTION = 0.1
# Rounding error of a value and of a polynomial through it, relative to the value.
_ROUNDING = 32.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of one run."""

    u: Vector  # constants, shape (nu,); 0 for inputs that vary
    # `places`, `pieces`: indices in u of the inputs that vary, and their polynomials over the run.
    places: tuple[int, ...] = ()
    pieces: tuple[Pieces, ...] = ()

    @cached_property
    def breaks(self) -> Vector:
        """Instants at which the run is to be cut [s]."""
        return np.concatenate([np.zeros(0), *(p.breaks for p in self.pieces)])

    @property
    def jumps(self) -> Vector:
        """Instants at which an input jumps [s]."""
        return np.concatenate([np.zeros(0), *(p.jumps for p in self.pieces)])

    def numbers(self, times: Vector) -> Vector:
        """The numbers of all polynomials at n instants, shape (n, INPUT_WIDTH * len(places))."""
        return np.hstack([np.zeros((len(times), 0)), *(p.at(times) for p in self.pieces)])

    def into(self, compiled: CompiledModel, modes: Vector, times: Vector) -> Vector:
        """Write these numbers into the modes of the relations of time at n instants, shape (n, k), and return them."""
        if not self.places:
            return modes
        first = len(compiled.time_events.relations)
        modes[:, first : first + INPUT_WIDTH * len(self.places)] = self.numbers(times)
        return modes


def given_inputs(compiled: CompiledModel, given: Any, start: float, stop: float, tolerances: Tolerances) -> Inputs:
    """Convert the argument of `simulate(inputs=...)`, for a run from `start` to `stop` [s].

    Raises UsageError: AC033 for names and constants, AC044 for data that are no function of time or do not cover the
    run, AC045 for files.
    Raises DeclarationError: AC136 for values outside the limits of the input.
    Raises UnitError: AC151 for a unit that does not fit.
    """
    if not isinstance(given, Mapping):
        return Inputs(input_vector(compiled, given))
    given = {n: _number(compiled, n, v) for n, v in given.items()}
    varying = {n: v for n, v in given.items() if n in compiled.inputs and not isinstance(v, Number)}
    varying = {n: v for n, v in varying.items() if np.ndim(v) > 0 or callable(v) or _is_series(v)}
    u = input_vector(compiled, {n: 0.0 if n in varying else v for n, v in given.items()}, unchecked=varying)
    if not varying:
        return Inputs(u)
    places = tuple(k for k, name in enumerate(compiled.inputs) if name in varying)
    pieces = []
    for k in places:
        name, declared = compiled.inputs[k], compiled.flat.declaration(compiled.flat.inputs[k])
        pieces.append(_pieces(name, declared, varying[name], start, stop, tolerances.scaled(_FRACTION).relative))
    return Inputs(u, places, tuple(pieces))


def _number(compiled: CompiledModel, name: str, value: Any) -> Any:
    """Convert a constant with a unit, such as "20 degC", to a number; returns all other values unchanged."""
    if (
        not isinstance(value, str)
        or name not in compiled.inputs
        or ":" in value
        or Path(value).suffix.lower() in READERS
    ):
        return value
    unit = compiled.flat.declaration(compiled.flat.inputs[compiled.inputs.index(name)]).unit
    try:
        return convert(value, unit)
    except UnitError as error:
        if error.code == "AC152":  # not a number: perhaps the name of a file
            return value
        raise UsageError(error.code, f"input {name}: {error.fact}", evidence=error.evidence, help=error.help) from None


def _is_series(value: Any) -> bool:
    return isinstance(value, str | Result | TimeSeries) or (hasattr(value, "index") and hasattr(value, "to_numpy"))


def _allowed_error(values: Vector, fraction: float) -> float:
    """Allowed error of polynomials: a fraction of the variation of the values, at least their rounding error."""
    return max(fraction * variation(values), _ROUNDING * float(np.abs(values).max()))


def _pieces(name: str, declared: Declaration, value: Any, start: float, stop: float, fraction: float) -> Pieces:
    if callable(value) and not isinstance(value, Result):
        signal = _vectorised(value, name)
        samples = signal(np.linspace(start, stop, 1001))
        error = _allowed_error(samples, fraction)
        _check_limits(name, declared, samples, error)
        return sampled(signal, np.array([start, stop]), error, f"input {name}")
    series, exact = _in_unit(name, declared, *series_of(name, value))
    times, values = _covering(name, series, start, stop)
    inside = (times >= start) & (times <= stop)
    used = values[inside] if inside.any() else values
    error = _allowed_error(used, fraction)
    _check_limits(name, declared, used, 10.0 * error / _FRACTION)
    if series.interpolation == "hold":
        return held(times, values)
    if series.interpolation == "linear":
        return straight(times, values, error)
    return _smooth(name, times, values, error, exact)


@dataclass(frozen=True, eq=False)
class _StraightLines:
    """Linear interpolation between points."""

    times: Vector
    values: Vector

    def __call__(self, at: Vector) -> Vector:
        return np.asarray(np.interp(at, self.times, self.values))


@dataclass(frozen=True, eq=False)
class _Scaled:
    """A signal converted to another unit."""

    signal: Callable[[Vector], Vector]
    scale: float
    zero: float

    def __call__(self, at: Vector) -> Vector:
        return self.signal(at) * self.scale + self.zero


def _vectorised(function: Callable[[float], Any], name: str) -> Callable[[Vector], Vector]:
    """Turn a function of one instant into one of many."""

    def signal(times: Vector) -> Vector:
        values = np.empty(len(times))
        for k, t in enumerate(times.tolist()):
            try:
                values[k] = float(function(t))
            except (TypeError, ValueError, ArithmeticError) as error:
                raise UsageError(
                    "AC044",
                    f"input {name} at t = {t:.9g} s: {error}",
                    help="a function takes the time in s and returns one number",
                ) from error
            if not np.isfinite(values[k]):
                raise UsageError(
                    "AC044", f"input {name} is {values[k]} at t = {t:.9g} s", help="return a finite number"
                )
        return values

    return signal


def series_of(name: str, value: Any) -> tuple[TimeSeries, Callable[[Vector], Vector] | None]:
    """Convert data of any kind to a series; the second item, if any, gives more accurate values between its rows."""
    if isinstance(value, TimeSeries):
        return value, None
    if isinstance(value, str):
        head, colon, tail = value.rpartition(":")
        file, column = (head, tail) if colon and Path(head).suffix else (value, None)
        if Path(file).suffix:
            return read_series(file, column), None
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], Result):
        result, signal = value
        return _of_result(result, str(signal))
    if isinstance(value, Result):
        return _of_result(value, name)
    if hasattr(value, "to_numpy"):
        return _of_pandas(name, value), None
    try:
        if isinstance(value, tuple) and len(value) == 2:
            time, values = seconds(value[0]), np.asarray(value[1], dtype=np.float64)
        else:
            rows = np.asarray(value, dtype=np.float64)
            if rows.ndim != 2 or rows.shape[1] != 2:
                raise ValueError(f"an array of shape {rows.shape}")
            time, values = rows.T
    except (TypeError, ValueError) as error:
        raise UsageError(
            "AC044",
            f"input {name} = {_abbreviated(value)} is not a function of time: {error}",
            help="a number, a function of time, (times, values), rows (time, value), TimeSeries, a Result, "
            "a pandas Series, or 'file.csv:column'",
        ) from None
    return TimeSeries(time, values, name=f"input {name}"), None


def _abbreviated(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _of_result(result: Result, signal: str) -> tuple[TimeSeries, Callable[[Vector], Vector] | None]:
    series = TimeSeries(result.time, result[signal], "smooth", result.unit(signal), f"{signal} of {result.model}")
    return series, lambda times: np.asarray(result.at(times, signal))


def _of_pandas(name: str, value: Any) -> TimeSeries:
    """Convert a Series over time, or a DataFrame that has a column of that name, or a single column."""
    if hasattr(value, "columns"):
        named_columns = [(c, str(c).partition(" [")[0]) for c in value.columns]
        clock_index = clock_among([head for _, head in named_columns])
        clock = [] if clock_index is None else [value.columns[clock_index]]
        columns = [(c, head) for k, (c, head) in enumerate(named_columns) if k != clock_index]
        fitting = [c for c, head in columns if head == name or len(columns) == 1]
        if len(fitting) != 1:
            raise UsageError(
                "AC045",
                f"the table for input {name} has no column of this name",
                evidence=[f"its columns: {', '.join(str(c) for c, _ in columns[:8])}"],
                help=f"inputs={{'{name}': table['column']}}",
            )
        time, column = value[clock[0]] if clock else value.index, value[fitting[0]]
        label, head = str(fitting[0]), str(clock[0]) if clock else str(value.index.name)
    else:
        time, column, label, head = value.index, value, str(value.name), str(value.index.name)
    unit, second = (text.partition(" [")[2].rstrip("] ") for text in (label, head))
    declared = getattr(column, "attrs", {}).get("units", "")  # one unit, or those of a frame, which columns inherit
    unit = unit or str(declared.get(label, "") if isinstance(declared, Mapping) else declared)
    try:
        times = seconds(time, second)
    except (TypeError, ValueError, UnitError) as error:
        raise UsageError("AC044", f"the index of the data for input {name} is not a time in s: {error}") from None
    return TimeSeries(times, column.to_numpy(dtype=np.float64), "linear", unit, f"input {name}")


def _in_unit(
    name: str, declared: Declaration, series: TimeSeries, exact: Callable[[Vector], Vector] | None
) -> tuple[TimeSeries, Callable[[Vector], Vector] | None]:
    """Convert a series, and its values at any time, to the unit of the input, which is coherent."""
    if not series.unit or series.unit == declared.unit:
        return series, exact
    try:
        source = parse(series.unit)
        if declared.unit and source.dimension != parse(declared.unit).dimension:
            raise UsageError(
                "AC151",
                f"{series.name} in {series.unit} does not fit input {name} in {declared.unit}",
                evidence=[f"{series.unit} has the dimension {format_dimension(source.dimension)}"],
            )
        reason = ambiguous(series.unit, declared.unit) if declared.unit else None
        if reason is not None:
            fact = f"{series.name} in {series.unit} does not fit input {name} in {declared.unit}"
            raise UsageError("AC151", fact, evidence=[reason], help="correct the unit, or convert the values")
        zero = in_si(0.0, series.unit)
        scale = in_si(1.0, series.unit) - zero
    except UsageError:
        raise
    except AcausalError as error:
        raise UsageError(error.code, f"{series.name}: {error.fact}", evidence=error.evidence, help=error.help) from None
    series = replace(series, value=series.values * scale + zero, unit=declared.unit)
    return series, exact and _Scaled(exact, scale, zero)


def _covering(name: str, series: TimeSeries, start: float, stop: float) -> tuple[Vector, Vector]:
    """Return the rows that the run needs: those inside, and one more at each end (four for splines).

    Raises UsageError: AC044 where the run begins before the series, or ends after it.
    """
    times, values = series.times, series.values
    slack = 1e-9 * (stop - start)
    if times[0] > start + slack or times[-1] < stop - slack:
        overlap = max(times[0], start), min(times[-1], stop)
        first, last = overlap if overlap[0] < overlap[1] else (times[0], times[-1])
        raise UsageError(
            "AC044",
            f"{series.name} goes from {times[0]:.9g} s to {times[-1]:.9g} s, the run from {start:.9g} to {stop:.9g} s",
            cause="an input is unknown outside the time of its data",
            help=f"simulate from start_time={first:.12g} to stop_time={last:.12g}, "
            f"or give input {name} rows up to the end",
        )
    first = max(int(np.searchsorted(times, start, side="right")) - 1, 0)
    last = min(int(np.searchsorted(times, stop, side="left")), len(times) - 1)
    if first == last:
        first = last - 1
    margin = 3 if series.interpolation == "smooth" else 0  # a spline depends on neighbouring rows
    rows = slice(max(first - margin, 0), last + margin + 1)
    return times[rows], values[rows]


def _check_limits(name: str, declared: Declaration, values: Vector, slack: float) -> None:
    """Raise AC136 for values outside the declared limits by more than `slack`, as results have errors themselves."""
    for value in (values.min(), values.max()):
        nearest = min(max(float(value), declared.min), declared.max)
        if abs(nearest - value) > slack:
            check_limit(name, "", declared, float(value))


def _smooth(name: str, times: Vector, values: Vector, error: float, exact: Callable[[Vector], Vector] | None) -> Pieces:
    """Interpolate by splines between jumps, or by `exact` values where a spline through the rows is too inaccurate."""
    from scipy.interpolate import CubicSpline

    doubles = (np.flatnonzero(np.diff(times) == 0.0) + 1).tolist()
    bounds = [(i, j) for i, j in zip([0, *doubles], [*doubles, len(times)], strict=True) if j - i > 1]
    curves: list[Callable[[Vector], Vector]] = []
    for i, j in bounds:
        t, v = times[i:j], values[i:j]
        chord = v[0] + (v[-1] - v[0]) * ((t - t[0]) / (t[-1] - t[0]))
        if float(np.abs(chord - v).max()) <= error and (j - i > 2 or exact is None):
            curves.append(_StraightLines(t, v))
        elif j - i < 8:
            curves.append(exact or CubicSpline(t, v))
        else:  # a spline through every second point has sixteen times the error
            off = float(np.abs(CubicSpline(t[::2], v[::2])(t[: len(t[::2]) * 2 - 1]) - v[: len(t[::2]) * 2 - 1]).max())
            curves.append(exact if exact is not None and off > 16.0 * error else CubicSpline(t, v))
    knots = np.array([*(times[i] for i, _ in bounds), times[bounds[-1][1] - 1]])

    def signal(at: Vector) -> Vector:
        k = int(np.clip(np.searchsorted(knots, at[len(at) // 2], side="right") - 1, 0, len(curves) - 1))
        return np.asarray(curves[k](at))

    return sampled(signal, knots, error, f"input {name}")
