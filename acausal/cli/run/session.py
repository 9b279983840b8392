"""A run on the command line: its files, times and summary."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acausal.cli.models.names import unit_of
from acausal.cli.output.report import quantity, remark, say, seconds, table
from acausal.cli.run.progress import Clock
from acausal.errors import counted

if TYPE_CHECKING:
    from acausal.language.component import Component
    from acausal.lower.compiled import CompiledModel
    from acausal.result.result import Result

_COMPILATION = ("flatten", "reduce", "analyse", "solve", "lower")
_MOST_STATES = 20
_MOST_ELEMENTS = 6  # vectors up to this size (velocities, wrenches) get a row per element, fields do not
_STAGES = ("import", "compile", "initialize", "integrate", "observe", "save", "plot")


@dataclass
class Session:
    """A run of the command line: writes its files, prints its summary."""

    reference: str
    model: Component
    compiled: CompiledModel
    result_file: Path | None
    picture: Path | None
    clock: Clock
    units: bool = False
    written: list[tuple[Path, str]] = field(default_factory=list)

    def rescue(self, error: BaseException) -> None:
        """Save the partial result of a failed or interrupted run."""
        result = getattr(error, "result", None)
        if result is None or self.result_file is None:
            return
        reached = result.time[-1]
        if len(result.time) < 2:
            remark(f"nothing to save: the run had not left t = {reached:g} s")
            return
        self._save(result)
        remark(f"saved the run up to t = {reached:.6g} s ({counted(len(result.time), 'row')}) in {self.result_file}")

    def finish(self, result: Result) -> None:
        """Compute the observed variables, and write the files."""
        times: dict[str, float] = dict(result.stats.get("time", {}))  # type: ignore[call-overload]
        inside = {k: times[k] for k in ("initialize",) if k in times}
        self.clock.take("integrate", inside)
        # compute them here, so that their time is not attributed to saving
        _ = result.matrix
        for sentence in _undefined(result):
            remark(f"note: {sentence}")
        self.clock.lap("observe")
        self._save(result)
        self.clock.lap("save")
        if self.picture is not None:
            self._draw(result, self.picture)
            self.clock.lap("plot")

    def _save(self, result: Result) -> None:
        if self.result_file is not None:
            result.save(self.result_file, units=self.units)
            rows = counted(len(result.time), "row")
            self.written.append((self.result_file, f"{counted(len(result.names) + 1, 'signal')}, {rows}"))

    def _draw(self, result: Result, picture: Path) -> None:
        """The model's own figure, or its states."""
        from acausal.plot.plot import figure, plot

        panels = getattr(type(self.model), "figure", ())
        names = self.compiled.states or result.names[:1]
        if panels:
            figure(result, panels, file=picture)
        else:
            plot(result, *names[:12], file=picture)
        self.written.append((picture, counted(len(panels), "panel") if panels else "the states"))

    def timings(self, result: Result) -> dict[str, float]:
        """Seconds per stage; the stages of the compiler are parts of `compile`."""
        inner: dict[str, float] = dict(result.stats.get("time", {}))  # type: ignore[call-overload]
        parts = {k: inner[k] for k in _COMPILATION if k in inner}
        known = [*parts, "initialize", "integrate"]
        others = {k: v for k, v in inner.items() if k not in known}
        laps = {k: self.clock.laps[k] for k in _STAGES if k in self.clock.laps}
        return {**laps, **others, **parts, "total": self.clock.total}

    def final(self, result: Result) -> list[tuple[str, float, str]]:
        """(name, value, unit) of each state at the end."""
        reduced = self.compiled.solution.structure.reduced
        matrix, signals = result.matrix, result.signals
        found = []
        for name, v in zip(self.compiled.states, self.compiled.state_variables, strict=True):
            signal = signals.get(name)
            column = signal.column if signal is not None else None
            if signal is not None and column is not None:
                found.append((name, float(matrix[-1, column]) * signal.sign + 0.0, unit_of(reduced, v)))
        return found

    def reports(self, result: Result) -> list[tuple[str, str]]:
        """Reports of components, such as the pairs of a contact scene, by path.

        For a model whose structure has changed they are those at the end.
        """
        from acausal.flatten.instances.instances import instances
        from acausal.language.choices import is_reporting

        last: Any = result.stats.get("reports", {})
        found = [(i.path, i.component) for i in instances(self.model)]
        initial = {path: repr(c.report()) for path, c in found if is_reporting(c)}
        return list({**initial, **last}.items())

    def content(self, result: Result) -> dict[str, Any]:
        """The whole report, for `--json`."""
        stats = {k: v for k, v in result.stats.items() if k != "time"}
        return {
            "model": self.compiled.name,
            "reference": self.reference,
            "start_time": float(result.time[0]),
            "stop_time": float(result.time[-1]),
            "rows": len(result.time),
            "signals": len(result.names),
            "events": len(result.events),
            "stats": stats,
            "timings": self.timings(result),
            "final": {name: {"value": value, "unit": unit} for name, value, unit in self.final(result)},
            "files": [str(path) for path, _ in self.written],
        }

    def summary(self, result: Result, everything: bool) -> None:
        """Print the summary on stdout, and remarks on stderr."""
        stats = dict(result.stats)
        timings = self.timings(result)
        say(f"{self.compiled.name}: {result.time[0]:g} ... {result.time[-1]:g} s, {counted(len(result.time), 'row')}")
        counts = [
            counted(len(self.compiled.continuous), "state"),
            counted(len(self.compiled.algebraic), "iterated unknown"),
        ]
        events = f", {counted(len(result.events), 'event')}" if result.events else ""
        say(f"  solver   {stats['solver']} ({stats['reason']}), tolerance {stats['tolerance']:g}")
        say(f"  size     {len(self.compiled.flat.equations)} equations, {', '.join(counts)}{events}")
        stages = [f"{k} {seconds(v)}" for k, v in timings.items() if k in self.clock.laps]
        say(f"  time     {', '.join(stages)}; whole process {seconds(timings['total'])}")
        if everything:
            say("  compile  " + ", ".join(f"{k} {seconds(timings[k])}" for k in _COMPILATION if k in timings))
            known = ("solver", "reason", "tolerance", "notes", "time")
            for component, report in self.reports(result):
                say(f"  {component}: " + report.replace("\n", "\n    "))
            say("  counts   " + ", ".join(f"{k} {v:g}" for k, v in stats.items() if k not in known and _is_number(v)))
        final = self.final(result)
        if final:
            say("final values of the states")
            rows = _rows(final)
            table(rows[:_MOST_STATES], indent="  ")
            if len(rows) > _MOST_STATES:
                say(f"  and {len(rows) - _MOST_STATES} more")
        for note in stats.get("notes", ()):  # type: ignore[attr-defined]
            remark(f"note: {note}")
        for path, what in self.written:
            remark(f"wrote {path} ({what})")
        if not self.written:
            remark("wrote nothing; -o FILE saves the result, --plot draws it")


def _undefined(result: Result) -> list[str]:
    """Sentences on signals that become undefined during the run, which continued because no state depends on them."""
    if "pieces" in result.stats:  # with changing structure, signals outside the equations have no value
        return []
    import numpy as np

    lost = ~np.isfinite(result.matrix)
    if not lost.any():
        return []
    first = np.argmax(lost, axis=0)
    columns = np.flatnonzero(lost.any(axis=0))
    names: dict[int, str] = {}
    for name, signal in result.signals.items():
        if signal.column is not None:
            names.setdefault(signal.column, name)
    return [
        f"{names.get(int(k), k)} has no finite value at t = {result.time[first[k]]:g} s"
        + (" and after" if lost[first[k] :, k].all() else "")
        for k in columns[:4]
    ]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def _rows(final: list[tuple[str, float, str]]) -> list[tuple[str, str]]:
    """A row for each state, or, with the smallest and largest element, for each vector with many elements."""
    rows: list[tuple[str, str]] = []
    for name, group in groupby(final, key=lambda state: re.sub(r"\[[^][]*\]$", "", state[0])):
        states = list(group)
        if len(states) <= _MOST_ELEMENTS:
            rows += [(path, quantity(value, unit)) for path, value, unit in states]
        else:
            values, unit = [value for _, value, _ in states], states[0][2]
            rows.append((f"{name}, {len(states)} elements", f"{min(values):.6g} ... {quantity(max(values), unit)}"))
    return rows
