"""Result of a simulation: the trajectory of every variable of the model, by its path."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from acausal.errors import InternalError, UsageError, meant
from acausal.providers import provided
from acausal.result.files import read, write
from acausal.result.signals import Array, Event, Signal, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Event", "Result", "Signal", "load"]

# Up to this many columns are computed individually; beyond this, the whole matrix is.
_MANY = 64
# Minimum number of rows for a spline, which is used if its error is below this fraction of the error of a
# shape-preserving cubic. At a kink both errors are similar.
_SPLINE_ROWS, _BETTER = 16, 0.25
_ELEMENT = re.compile(r"(?P<base>.+)\[(?P<index>\d+(?:, ?\d+)*)\]")


class _Events:
    """Descriptor of `Result.events`: the events, or a function that describes them when they are first read."""

    def __get__(self, result: Result | None, owner: type[Result]) -> tuple[Event, ...]:
        if result is None:
            return ()
        kept: Any = result.__dict__["events"]
        if callable(kept):
            kept = result.__dict__["events"] = kept()
        events: tuple[Event, ...] = kept
        return events

    def __set__(self, result: Result, events: tuple[Event, ...] | Callable[[], tuple[Event, ...]]) -> None:
        result.__dict__["events"] = events


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """Trajectories of one run, by name.

    Parameters
    ----------
    model
        Name of the model.
    time
        Shape (n,), in s, non-decreasing; two equal neighbours are the values before and after an event.
    trajectories
        Shape (n, k), or a function that computes it, so that variables that the integration does not need cost
        nothing until the first of them is read.
    signals
        Description of every signal, in the order of declaration.
    events, stats
        Events of the run, or a function that describes them; and statistics: solver, reason for its choice, counters,
        times.
    dense
        Dense output: maps times of the run, shape (m,), to rows of `trajectories`, shape (m, k), accurate to the run's
        tolerance, nan where the solver does not succeed; None for results read from a file.
    some
        Maps j column indices to these columns of `trajectories`, shape (n, j), without computing the others; None if
        this would cost as much as all columns.
    """

    model: str
    time: Array
    trajectories: Array | Callable[[], Array]
    signals: Mapping[str, Signal]
    events: tuple[Event, ...] = cast("Any", _Events())
    stats: Mapping[str, object] = field(default_factory=dict)
    dense: Callable[[Array], Array] | None = None
    some: Callable[[Sequence[int]], Array] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", np.asarray(self.time, dtype=float))
        if self.time.ndim != 1 or (self.time[1:] < self.time[:-1]).any():
            raise InternalError("AC901", f"the time of a result of {self.model} does not increase")

    def __reduce__(self) -> tuple[type[Result], tuple[object, ...]]:
        """Pickle with all values computed and without dense output, like a result read from a file."""
        return Result, (self.model, self.time, self.matrix, dict(self.signals), self.events, dict(self.stats))

    @cached_property
    def matrix(self) -> Array:
        """The trajectories, shape (n, k), computed on first access."""
        values = self.trajectories() if callable(self.trajectories) else self.trajectories
        matrix = np.asarray(values, dtype=float)
        if matrix.ndim != 2 or len(matrix) != len(self.time):
            raise InternalError(
                "AC902", f"a result of {self.model} has {len(self.time)} times and trajectories of shape {matrix.shape}"
            )
        return matrix

    @cached_property
    def _column_cache(self) -> dict[int, Array]:
        """Cache of columns that were computed individually, shape (n,) each."""
        return {}

    def columns(self, columns: Sequence[int]) -> Array:
        """Columns of the trajectories by index, shape (n, len(columns)); many requests compute the whole matrix."""
        missing = [k for k in dict.fromkeys(columns) if k not in self._column_cache]
        if "matrix" in self.__dict__ or self.some is None or len(self._column_cache) + len(missing) > _MANY:
            return self.matrix[:, columns]
        if missing:
            self._column_cache.update(zip(missing, self.some(missing).T, strict=True))
        found = [self._column_cache[k] for k in columns]
        return found[0][:, None] if len(found) == 1 else np.stack(found, axis=1)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all signals in the order of declaration, without `time`."""
        return tuple(self.signals)

    @cached_property
    def _arrays(self) -> dict[str, list[tuple[tuple[int, ...], str]]]:
        arrays: dict[str, list[tuple[tuple[int, ...], str]]] = {}
        for name in self.signals:
            if match := _ELEMENT.fullmatch(name):
                index = tuple(int(i) for i in match["index"].split(","))
                arrays.setdefault(match["base"], []).append((index, name))
        return arrays

    @cached_property
    def _first_index(self) -> int:
        """Smallest index of arrays: 0, or 1 in files of Modelica tools.

        It is common to all arrays: the last two of three entries of a vector are not a vector of two.
        """
        return 0 if any(0 in index for members in self._arrays.values() for index, _ in members) else 1

    def elements(self, name: str) -> tuple[tuple[int, ...], list[Signal]]:
        """Shape and signals of a name, in row-major order; the shape of a scalar is ().

        Raises
        ------
        UsageError
            AC010, with the nearest names, when there is no such signal or its elements do not fill an array.
        """
        if not isinstance(name, str):
            raise UsageError(
                "AC010",
                f"{name!r} is not a name of a signal",
                help="give one name at a time: result['mass.s']; result.at(t, name) takes the time first",
            )
        if name == "time":
            return (), [Signal("time", unit="s", doc="Time")]
        if name in self.signals:
            return (), [self.signals[name]]
        members = sorted(self._arrays.get(name, []))
        if members and len({len(index) for index, _ in members}) == 1:
            indices = np.array([index for index, _ in members])
            shape = tuple(int(i) for i in indices.max(axis=0) - self._first_index + 1)
            if len(members) == int(np.prod(shape)):
                return shape, [self.signals[element] for _, element in members]
        raise UsageError(
            "AC010",
            f"{self.model} has no signal '{name}'",
            evidence=meant(name, ["time", *self.names, *self._arrays]),
            help=(
                f"the run computed only what the outputs {', '.join(map(str, outputs[:4]))} need: add it to outputs"
                if isinstance(outputs := self.stats.get("outputs"), tuple) and outputs
                else f"the names of all {len(self.names)} signals are in result.names; acausal plot FILE lists them"
            ),
        )

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (name == "time" or name in self.signals or name in self._arrays)

    def __iter__(self) -> Iterator[str]:
        """Names of the signals, as `names`."""
        return iter(self.names)

    def __getitem__(self, name: str) -> Array:
        """Values over the run: shape (n,) for a scalar, (n, 3) for a vector, (n, 3, 3) for a matrix."""
        if name == "time":
            return self.time.copy()
        shape, signals = self.elements(name)
        return self._assemble(signals, shape, len(self.time), self.columns)

    def unit(self, name: str) -> str:
        """Unit of a signal, or of the elements of an array, as declared."""
        return self.elements(name)[1][0].unit

    def final(self, name: str) -> float | Array:
        """Value at the end of the run: a float, or an array of the shape of the signal."""
        last = self[name][-1]
        return np.asarray(last) if last.ndim else float(last)

    def at(self, t: ArrayLike, name: str) -> float | Array:
        """Value at one or several times of the run.

        At a stored time the stored value is returned (at an event, the one after it). Between stored times the dense
        output of the solver is evaluated or, for results from a file, a cubic that never extends across an event.

        Parameters
        ----------
        t
            Times in s; the shape of the answer is the shape of `t` followed by that of the signal.

        Raises
        ------
        UsageError
            AC010 for an unknown name, AC011 for a time outside the run.
        """
        try:
            times = np.asarray(t, dtype=float)
        except (TypeError, ValueError):
            raise UsageError("AC011", f"{t!r} is not a time", help="result.at(t, name) takes times [s] first") from None
        flat = times.ravel()
        slack = 4 * np.finfo(float).eps * np.abs(self.time[[0, -1]]).max()
        # an event this close to the stop time replaces it as the last row
        beyond = max(slack, 1e-12 * np.ptp(self.time))
        # the comparison is negated, so that nan counts as outside
        outside = flat[~((flat >= self.time[0] - beyond) & (flat <= self.time[-1] + beyond))]
        if outside.size:
            raise UsageError(
                "AC011",
                f"{outside[0]:.17g} s is outside the run of {self.model}",
                evidence=[f"the run goes from {self.time[0]:.10g} s to {self.time[-1]:.10g} s"],
            )
        flat = np.clip(flat, self.time[0], self.time[-1])
        shape, signals = self.elements(name)
        if name == "time":
            values: Array = flat
        else:
            values = self._assemble(signals, shape, flat.size, lambda columns: self._rows(flat, columns, slack))
        values = values.reshape(times.shape + shape)
        return values if values.ndim else float(values)

    def rows(self, times: Array) -> Array:
        """The trajectories at `times` of the run, shape (n,), as `at` gives signals; shape (n, k)."""
        return self._rows(times, list(range(self.matrix.shape[1])), 0.0)

    def _assemble(
        self, signals: Sequence[Signal], shape: tuple[int, ...], n: int, read: Callable[[list[int]], Array]
    ) -> Array:
        """Values, shape (n, *shape), from columns fetched by `read` and from constants."""
        values = np.empty((n, len(signals)))
        varying = [(i, s.column, s.sign) for i, s in enumerate(signals) if s.column is not None]
        for i, signal in enumerate(signals):
            if signal.column is None:
                values[:, i] = signal.value
        # skip `read` for constants: it may compute the trajectories
        if varying:
            positions, columns, signs = (list(x) for x in zip(*varying, strict=True))
            # adding zero turns the -0.0 of a negated alias into 0.0
            values[:, positions] = read(columns) * np.array(signs, dtype=float) + 0.0
        return values.reshape((n, *shape))

    def _rows(self, times: Array, columns: list[int], slack: float) -> Array:
        """Columns at arbitrary times of the run, shape (len(times), len(columns)); stored rows within `slack` [s]."""
        rows = np.empty((times.size, len(columns)))
        # the last stored point not after t, hence the value after an event; with a slack of a few ulps, a request for
        # 0.3 finds the point stored at 3 * 0.1
        index = np.searchsorted(self.time, times + slack, side="right") - 1
        is_stored = np.abs(self.time[index] - times) <= slack
        stored = self.columns(columns)
        rows[is_stored] = stored[index[is_stored]]
        between = np.flatnonzero(~is_stored)
        if self.dense is not None and between.size:
            dense_rows = self.dense(times[between])[:, columns]
            rows[between] = dense_rows
            between = between[np.isnan(dense_rows).all(axis=1)]
        starts = np.flatnonzero(np.diff(self.time) == 0) + 1
        bounds = [0, *starts.tolist(), len(self.time)]
        segment = np.searchsorted(starts, index[between], side="right")
        for k in np.unique(segment):
            wanted = between[segment == k]
            piece = slice(bounds[k], bounds[k + 1])
            rows[wanted] = _interpolate(self.time[piece], stored[piece], times[wanted])
        return rows

    def table(self) -> Table:
        """All values as one record; computes missing ones."""
        return Table(self.model, self.time, self.matrix, self.signals, self.events, self.stats)

    def save(self, path: str | Path, *, units: bool = False) -> None:
        """Write all signals to a `.mat` (Dymola, OpenModelica), `.csv`, `.npz` or `.parquet` file, or nothing at all.

        Parameters
        ----------
        units
            Whether a `.csv` has units in its second row; the other formats always store units.

        Raises
        ------
        UsageError
            AC012 when the file cannot be written, AC013 for another suffix, AC015 for Parquet without pyarrow.
        """
        write(self.table(), Path(path), units)

    def plot(self, *names: str, **options: Any) -> Figure:
        """Draw signals; the options are those of `acausal.plot.plot.plot`."""
        drawn: Figure = provided("plot")(self, *names, **options)
        return drawn

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` with time as index and one column per signal; `attrs["units"]` holds units by name."""
        pandas = _extra("pandas")
        _ = self.matrix  # compute all columns at once
        columns = {name: self[name] for name in self.names}
        frame = pandas.DataFrame(columns, index=pandas.Index(self.time, name="time"))
        frame.attrs |= {"model": self.model, "units": {name: s.unit for name, s in self.signals.items()}}
        return frame

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` over `time`, with the attributes `units` and `long_name`."""
        xarray = _extra("xarray")
        _ = self.matrix
        data = {
            name: ("time", self[name], {"units": signal.unit, "long_name": signal.doc})
            for name, signal in self.signals.items()
        }
        coordinates = {"time": ("time", self.time, {"units": "s", "long_name": "Time"})}
        return xarray.Dataset(data, coords=coordinates, attrs={"model": self.model})

    def _repr_html_(self) -> str:
        shown: str = provided("result_html")(self)
        return shown

    def __repr__(self) -> str:
        span = f"{self.time[0]:g} .. {self.time[-1]:g} s" if self.time.size else "no time"
        parts = [span, f"{self.time.size} points", f"{len(self.signals)} signals"]
        if self.events:
            parts.append(f"{len(self.events)} event{'s' if len(self.events) > 1 else ''}")
        if "solver" in self.stats:
            parts.append(str(self.stats["solver"]))
        return f"Result({self.model}: {', '.join(parts)})"


def load(path: str | Path) -> Result:
    """Read a result, or measurements over time, from a `.mat`, `.csv`, `.npz` or `.parquet` file.

    Names in CSV and Parquet files may carry units, `time [ms], force [kN]`; times become seconds, values stay.

    Raises
    ------
    UsageError
        AC013 for another suffix, AC014 when the file cannot be read, AC015 for Parquet without pyarrow.
    """
    return Result(**vars(read(Path(path))))


def _interpolate(time: Array, values: Array, t: Array) -> Array:
    """Cubic interpolation of (time, values) at `t`; linear if values are not finite.

    A spline has an error of fourth order in the distance of rows, a shape-preserving cubic one of second order at
    extrema, but no overshoot at kinks. A column is interpolated by the spline if a spline through every second row
    predicts the other rows better than the cubic does.

    `time`: shape (n,); `values`: shape (n, k); `t`: shape (m,). Returns shape (m, k).
    """
    if len(time) > 2 and np.isfinite(values).all():
        from scipy.interpolate import CubicSpline, PchipInterpolator

        found = np.asarray(PchipInterpolator(time, values, axis=0)(t))
        if len(time) >= _SPLINE_ROWS:
            between = time[1:-1:2], values[1:-1:2]
            errors = [
                np.abs(kind(time[::2], values[::2], axis=0)(between[0]) - between[1]).max(axis=0)
                for kind in (CubicSpline, PchipInterpolator)
            ]
            smooth = np.flatnonzero(errors[0] < _BETTER * errors[1])
            found[:, smooth] = CubicSpline(time, values[:, smooth], axis=0)(t)
        return found
    return np.stack([np.interp(t, time, column) for column in values.T], axis=1)


def _extra(package: str) -> Any:
    import importlib

    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        raise UsageError(
            "AC015", f"this needs the package {package}, which is not installed", help=f"pip install {package}"
        ) from error
