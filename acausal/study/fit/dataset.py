"""Measured signals of an experiment, and the inputs, start values and parameters under which it was made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UnitError, UsageError, meant
from acausal.result.csvfile import clock_among, named
from acausal.result.files import read
from acausal.result.result import Result
from acausal.result.seconds import seconds
from acausal.result.series import TimeSeries, read_all
from acausal.units import ambiguous, format_dimension, in_si, parse


@dataclass(frozen=True, eq=False)
class Dataset:
    """One experiment.

    Attributes
    ----------
    data
        Measured signals: a CSV file (`time [s], mass.s [mm], ...`), a pandas DataFrame over time, a `Result`, or a
        mapping from names to `TimeSeries` or `(times, values)`. A column with the name of an input of the model drives
        it, one with the name of a variable is compared with it; every column must be one or the other.
    inputs, start, parameters
        As in `simulate`, for this experiment only.
    sigma
        Standard deviations of the noise of this experiment by name of a signal, in SI; estimated if not given.
    name
        For messages and pictures.
    """

    data: Any
    inputs: Mapping[str, Any] = field(default_factory=dict)
    start: Mapping[str, object] = field(default_factory=dict)
    parameters: Mapping[str, object] = field(default_factory=dict)
    sigma: Mapping[str, float] = field(default_factory=dict)
    name: str = ""


@dataclass(frozen=True, eq=False)
class Measured:
    """One measured signal in SI: its name in the model, times [s] and values, both of shape (n,)."""

    name: str
    times: Vector
    values: Vector


def columns_of(dataset: Dataset) -> dict[str, TimeSeries]:
    """The columns of a data set by name.

    Raises UsageError: AC014, AC044 and AC045 for data that cannot be read, AC055 for an unknown type of data.
    """
    data = dataset.data
    if isinstance(data, str | Path):
        if Path(data).suffix.lower() != ".csv":
            return _from_result(Result(**vars(read(Path(data)))))
        return read_all(data)
    if isinstance(data, Result):
        return _from_result(data)
    if isinstance(data, Mapping):
        return {str(n): _series(str(n), v) for n, v in data.items()}
    if hasattr(data, "columns") and hasattr(data, "to_numpy"):
        return _from_frame(data)
    raise UsageError(
        "AC055",
        f"data of type {type(data).__name__} are not measurements",
        help="give a CSV file, a DataFrame over time, a Result, or {'mass.s': (times, values)}",
    )


def _series(name: str, value: Any) -> TimeSeries:
    if isinstance(value, TimeSeries):
        return value
    if not isinstance(value, tuple) or len(value) != 2:
        raise UsageError("AC055", f"{name} is neither a TimeSeries nor a pair of times and values")
    return TimeSeries(value[0], value[1], name=name)


def _from_result(result: Result) -> dict[str, TimeSeries]:
    moving = [n for n in result.names if result.signals[n].column is not None]
    return {n: TimeSeries(result.time, result[n], unit=result.unit(n), name=n) for n in moving}


def _from_frame(frame: Any) -> dict[str, TimeSeries]:
    heads = [named(str(column)) for column in frame.columns]
    clock = clock_among([name for name, _ in heads])
    second = named(str(frame.index.name))[1] if clock is None else heads[clock][1]
    try:
        times = seconds(frame.index if clock is None else frame.iloc[:, clock], second)
    except (TypeError, ValueError, UnitError) as error:
        raise UsageError("AC055", f"the measurements are not over time in s: {error}") from None
    units = frame.attrs.get("units", {})
    found: dict[str, TimeSeries] = {}
    for k, (column, (name, unit)) in enumerate(zip(frame.columns, heads, strict=True)):
        if k == clock:
            continue
        if name in found:
            raise UsageError("AC055", f"the measurements have two columns '{name}'", help="give each its own name")
        try:
            values = frame.iloc[:, k].to_numpy(dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise UsageError("AC055", f"column '{column}' does not consist of numbers: {error}") from None
        present = ~np.isnan(values)
        found[name] = TimeSeries(times[present], values[present], unit=unit or units.get(column, ""), name=str(column))
    return found


def measured(columns: Mapping[str, TimeSeries], inputs: tuple[str, ...], run: Result) -> tuple[Measured, ...]:
    """The columns to compare with the model, in SI; `run` is a result of the model.

    Raises UsageError: AC055 for a column that is no signal of the model, or if there is no column to compare.
    Raises UnitError: AC151 for a unit that does not fit.
    """
    found = []
    for name, series in columns.items():
        if name in inputs:
            continue
        if name not in run or run.elements(name)[0]:
            raise UsageError(
                "AC055",
                f"column '{name}' is neither a variable nor an input of {run.model}",
                evidence=meant(name, [*inputs, *run.names]),
                help="rename the column, or leave it out",
            )
        found.append(Measured(name, series.times, _in_si(name, series, run.unit(name))))
    if not found:
        raise UsageError("AC055", f"the data contain only inputs of {run.model}: there is nothing to compare it with")
    return tuple(found)


def _in_si(name: str, series: TimeSeries, declared: str) -> Vector:
    if series.unit in ("", declared):
        return series.values
    have, need = parse(series.unit).dimension, parse(declared).dimension
    if have != need:
        raise UsageError(
            "AC151",
            f"{series.name} is in {series.unit}, {format_dimension(have)}; {name} is in {declared}",
            help="correct the unit in the first row",
        )
    reason = ambiguous(series.unit, declared)
    if reason is not None:
        fact = f"{series.name} is in {series.unit}; {name} is in {declared}"
        raise UsageError(
            "AC151", fact, evidence=[reason], help="correct the unit in the first row, or convert the values"
        )
    offset = in_si(0.0, series.unit)
    return np.asarray(series.values * (in_si(1.0, series.unit) - offset) + offset)
