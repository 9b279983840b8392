"""`Sweep`: results of a sweep as a table of members and as families of curves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import UsageError, meant
from acausal.providers import provided
from acausal.result.signals import Signal
from acausal.study.sweep.store import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Sweep:
    """Runs of one model: n members, k varied parameters, s signals at r times.

    Parameters
    ----------
    model
        Name of the model.
    parameters, values
        The varied parameters, and their values in SI units, shape (n, k).
    time
        Times of the rows, shape (r,) [s].
    signals
        The stored signals.
    finals, rows
        Values at the end of each run, shape (n, s), and over time, shape (n, r, s); nan for failed members, and after a
        termination by the model.
    status
        "ok", "failed" or "missing" (not run yet) for each member.
    codes, messages, notes
        Code and message of the error of failed members, "" for others; notes of the runs.
    stop_times, seconds, events
        Final time of each run [s], its wall time [s], and its number of events, shapes (n,).
    """

    model: str
    parameters: tuple[Signal, ...]
    values: Vector
    time: Vector
    signals: tuple[Signal, ...]
    finals: Vector
    rows: Vector
    status: tuple[str, ...]
    codes: tuple[str, ...]
    messages: tuple[str, ...]
    notes: tuple[tuple[str, ...], ...]
    stop_times: Vector
    seconds: Vector
    events: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def failed(self) -> tuple[int, ...]:
        """Numbers of the failed members."""
        return tuple(k for k, status in enumerate(self.status) if status == "failed")

    @cached_property
    def _places(self) -> dict[str, tuple[str, int]]:
        varied = {s.name: ("varied", k) for k, s in enumerate(self.parameters)}
        return {**varied, **{s.name: ("signal", k) for k, s in enumerate(self.signals)}}

    def __contains__(self, name: object) -> bool:
        return name == "time" or name in self._places

    def __iter__(self) -> Iterator[str]:
        """Names of the varied parameters and stored signals, which are the columns; the length is that of the rows."""
        return iter(self._places)

    def __getitem__(self, name: str) -> Vector:
        """Values of a signal over time, shape (n, r), of a varied parameter, shape (n,), or of `time`, shape (r,).

        Raises UsageError: AC010 for a name that is not stored.
        """
        if name == "time":
            return self.time.copy()
        kind, k = self._locate(name)
        return np.array(self.values[:, k] if kind == "varied" else self.rows[:, :, k])

    def final(self, name: str) -> Vector:
        """Values at the end of each run, shape (n,); nan for failed or missing members.

        Raises UsageError: AC010 for a name that is not stored.
        """
        kind, k = self._locate(name)
        return np.array((self.values if kind == "varied" else self.finals)[:, k])

    def unit(self, name: str) -> str:
        """Declared unit of a signal or a varied parameter; AC010 for a name that is not stored."""
        kind, k = self._locate(name)
        return (self.parameters if kind == "varied" else self.signals)[k].unit

    def _locate(self, name: str) -> tuple[str, int]:
        if name not in self._places:
            raise UsageError(
                "AC010",
                f"the sweep of {self.model} has not stored the signal '{name}'",
                evidence=meant(name, list(self._places)),
                help=f"signals=[{name!r}] stores it: acausal sweep ... --signals {name}",
            )
        return self._places[name]

    def save(self, path: str | Path) -> None:
        """Write the table: `.parquet` or `.nc` (everything), or `.csv` (without the rows over time).

        Raises
        ------
        UsageError
            AC012 when the file cannot be written, AC013 for another suffix, AC015 when a package is missing.
        """
        provided("write_sweep")(self, Path(path))

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` over `member` and `time`, parameters and status as coordinates."""
        return provided("sweep_dataset")(self)

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` with one row per member: parameters, status, and signals at the end of the run."""
        return provided("sweep_frame")(self)

    def plot(self, *names: str, by: str | None = None, file: str | Path | None = None) -> Figure:
        """Plot families of curves; see `acausal.study.sweep.picture`."""
        drawn: Figure = provided("sweep_picture")(self, *names, by=by, file=file)
        return drawn

    def __repr__(self) -> str:
        varied = ", ".join(s.name for s in self.parameters)
        counts = [f"{self.status.count(s)} {s}" for s in ("failed", "missing") if s in self.status]
        return f"Sweep({', '.join([f'{self.model}: {len(self)} members over {varied}', *counts])})"


def load_sweep(path: str | Path) -> Sweep:
    """Read a sweep from its `.sweep` file; members that were not run yet are "missing".

    Raises
    ------
    UsageError
        AC014 if there is no such file, AC062 if it is not a sweep.
    """
    if not Path(path).is_file():
        raise UsageError("AC014", f"there is no file {path}")
    store = Store(Path(path))
    try:
        return sweep_from(store)
    finally:
        store.close()


def sweep_from(store: Store) -> Sweep:
    """The sweep of a store."""
    known = store.definition()
    n, r, s = len(known.values), len(known.grid), len(known.signals)
    finals, rows = np.full((n, s), np.nan), np.full((n, r, s), np.nan)
    stop_times, seconds, events = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n, dtype=np.int64)
    status, codes, messages = ["missing"] * n, [""] * n, [""] * n
    notes: list[tuple[str, ...]] = [()] * n
    for o in store.outcomes(known):
        finals[o.member], rows[o.member] = o.final, o.rows
        stop_times[o.member], seconds[o.member], events[o.member] = o.stop, o.seconds, o.events
        status[o.member] = "failed" if o.code else "ok"
        codes[o.member], messages[o.member], notes[o.member] = o.code, o.message, o.notes
    return Sweep(
        known.model, known.parameters, known.values, known.grid, known.signals, finals, rows,
        tuple(status), tuple(codes), tuple(messages), tuple(notes), stop_times, seconds, events,
    )  # fmt: skip


Report = Callable[["Progress"], None]


@dataclass(frozen=True)
class Progress:
    """Progress of a sweep: members done (including failed ones) of the total, elapsed and remaining time [s]."""

    done: int
    total: int
    failed: int
    elapsed: float
    remaining: float
