"""Runs of models whose structure follows their state: contacts that are in the equations only while they can touch.

A component takes part when its class has these methods (`library/contact/scene.py` is the example):

- `is_variable()`: whether this instance changes at all.
- `watched()`: names of its own signals that it decides by, relative to its path; scalars or arrays.
- `restructure(seen)`: make the structure for these values; True when it differs from the one before. None asks for the
  smallest structure, from which the first values are computed.
- `moved(before, after)`: for values at the instant of the choice and at n instants later (first axis), how far the
  choice is used up, 1 where it may begin to be wrong.
- `remarks(largest)`, or no such method: what to note after the run; `largest` gives the largest value of a signal.
- `labels()`: pairs of a path relative to the component, as it is now, and one that stays the same in all structures.

The run goes in pieces. Each is integrated a little further than before, and looked at afterwards: as long as nothing is
used up, the structure stays; where something is, the rows beyond are thrown away and the structure is chosen anew. This
is the neighbour list of molecular dynamics (L. Verlet, Physical Review 159 (1967) 98-103): the skin pays for steps, and
no bound of the velocity has to be known. States keep their values by name over all structures, also while they are
not in the equations.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.errors import IntegrationError, RunError
from acausal.flatten.instances import instances
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.result import Event, Result, Signal
from acausal.simulate.initialize import Start
from acausal.simulate.options import Options

Array = NDArray[np.float64]
RunPiece = Callable[[CompiledModel, Options, "Start | None", Array, bool], Result]
"""One run: `(compiled, options, start, output times, whether initial() is true at its start) -> result`."""
_log = logging.getLogger(__name__)
_FIRST = 0.05
_MOST_USED = 0.5
_SHORTEST = 1e-9


def variable_parts(model: Component) -> dict[str, Any]:
    """Components whose structure changes during a run, by path."""
    found: dict[str, Any] = {i.path: i.component for i in instances(model)}
    return {path: c for path, c in found.items() if hasattr(type(c), "restructure") and c.is_variable()}


def lasting_names(model: Component) -> dict[str, str]:
    """Beginnings of paths as they are in a model with all it may ever need, and as they are in results of its runs."""
    return {
        f"{path}.{own}" if path else own: f"{path}.{lasting}" if path else lasting
        for path, part in variable_parts(model).items()
        for own, lasting in part.labels()
    }


def shrink(model: Component) -> bool:
    """Give a model the structure its run begins with; False when its structure never changes."""
    parts = variable_parts(model)
    for part in parts.values():
        part.restructure(None)
    return bool(parts)


@dataclass(frozen=True, eq=False)
class _Rows:
    """The rows of one piece that count."""

    result: Result
    rows: slice
    names: Mapping[str, str]


@dataclass
class Pieces:
    """A run in pieces."""

    model: Component
    options: Options
    parameters: Mapping[str, object] | None
    run: RunPiece
    progress: Callable[[float, float], None] | None = None
    parts: dict[str, Any] = field(default_factory=dict)
    memory: dict[str, float] = field(default_factory=dict)
    pieces: list[_Rows] = field(default_factory=list)
    changes: list[Event] = field(default_factory=list)
    compiled: CompiledModel | None = None
    compilations: int = 0
    timings: dict[str, float] = field(default_factory=dict)

    def result(self) -> Result:
        """Run, and put the pieces together."""
        opts = self.options
        self.parts = variable_parts(self.model)
        shrink(self.model)
        self.compile()
        t, stop = opts.start_time, opts.stop_time
        # The poses at the start come from the start problem of the model without contacts.
        first = self.run(
            self._compiled, replace(opts, stop_time=t + _SHORTEST * (stop - t)), None, np.array([t]), False
        )
        seen = self.seen(first, 0)
        self.keep(first, 0)
        grid, length = opts.grid(), _FIRST * (stop - t)
        before, fresh = seen, True
        while t < stop:
            if fresh:
                before = seen
                if self.restructure(seen, t):
                    self.compile()
            end = stop if t + 1.2 * length >= stop else t + length
            times = np.append(grid[(grid > t) & (grid < end)], end)
            try:
                piece = self.run(
                    self._compiled, replace(opts, start_time=t, stop_time=end), self.start(), times, not self.pieces
                )
            except RunError as error:
                if error.result is not None:
                    self.add(error.result, slice(0, None))
                    error.result = self.joined()
                raise
            good, worst = self.good(before, piece)
            if good == 0:
                length /= 4
                if length < _SHORTEST * (stop - opts.start_time):
                    raise self.stuck(t)
                continue
            self.add(piece, slice(0, good + 1))
            self.keep(piece, good)
            t = float(piece.time[good])
            complete = good == len(piece.time) - 1
            seen, fresh = self.seen(piece, good), not complete or worst > _MOST_USED
            length = length * 2 if complete else max(float(piece.time[good] - piece.time[0]), length / 4)
            if self.progress is not None:
                self.progress((t - opts.start_time) / (stop - opts.start_time), t)
        return self.joined()

    @property
    def _compiled(self) -> CompiledModel:
        assert self.compiled is not None
        return self.compiled

    def compile(self) -> None:
        """The equations for the structure as it is now."""
        self.compiled = compile(self.model, parameters=self.parameters)
        self.compilations += 1
        for name, seconds in self.compiled.timings.items():
            self.timings[name] = self.timings.get(name, 0.0) + seconds

    def restructure(self, seen: Mapping[str, Mapping[str, Array]], t: float) -> bool:
        """Choose anew; notes what changed."""
        changed = [path for path, part in self.parts.items() if part.restructure(seen[path])]
        for path in changed:
            names = ", ".join(label for _, label in self.parts[path].labels()) or "none"
            self.changes.append(Event(t, f"{path}: contacts in the equations: {names}"))
            _log.debug("t = %g: %s: %s", t, path, names)
        return bool(changed)

    def seen(self, result: Result, row: int) -> dict[str, dict[str, Array]]:
        """What the components watch, at one row of a piece."""
        return {
            path: {n: np.asarray(result[f"{path}.{n}" if path else n][row]) for n in part.watched()}
            for path, part in self.parts.items()
        }

    def good(self, before: Mapping[str, Mapping[str, Array]], piece: Result) -> tuple[int, float]:
        """The last row up to which the structure was right, and how far it is used up there."""
        used = np.zeros(len(piece.time))
        for path, part in self.parts.items():
            after = {n: piece[f"{path}.{n}" if path else n] for n in part.watched()}
            used = np.maximum(used, part.moved(before[path], after))
        # Between two rows that are far from each other there may have been more.
        wrong = (used > 1.0) | (np.diff(used, prepend=used[0]) > _MOST_USED)
        last = int(np.argmax(wrong)) - 1 if wrong.any() else len(used) - 1
        return max(last, 0), float(used[max(last, 0)])

    def names(self, compiled: CompiledModel) -> dict[str, str]:
        """Beginnings of paths as they are in this structure, and as they are in the result."""
        found: dict[str, str] = {}
        for path, part in self.parts.items():
            prefix = f"{path}." if path else ""
            found |= {prefix + own: prefix + lasting for own, lasting in part.labels()}
        return found

    def keep(self, piece: Result, row: int) -> None:
        """Remember the states."""
        names = self.names(self._compiled)
        for name in self._compiled.states:
            self.memory[renamed(name, names)] = float(piece[name][row])

    def start(self) -> Start:
        """States as remembered, or as declared where they are new."""
        compiled = self._compiled
        names = self.names(compiled)
        x, z = (np.array(v, dtype=float).ravel() for v in compiled.guess(np.array(compiled.parameter_values)))
        for k, name in enumerate(compiled.states):
            x[k] = self.memory.get(renamed(name, names), x[k])
        return Start(x, z, ())

    def add(self, piece: Result, rows: slice) -> None:
        """Take rows of a piece into the result."""
        self.pieces.append(_Rows(piece, rows, self.names(self._compiled)))

    def stuck(self, t: float) -> IntegrationError:
        """The error for a skin that is used up in no time."""
        return IntegrationError(
            "AC406",
            f"the structure of {type(self.model).__name__} would have to change all the time at t = {t:.9g} s",
            evidence=[f"changing: {', '.join(self.parts)}"],
            cause="bodies move further than the skin of their scene in no time",
            help="give ContactScene a larger skin, or keep all pairs: ContactScene(keep=1000)",
        )

    def joined(self) -> Result:
        """One result over all pieces; signals that were not in the equations are nan there."""
        signals: dict[str, Signal] = {}
        sources: list[dict[str, Signal]] = []
        for piece in self.pieces:
            own = {renamed(name, piece.names): s for name, s in piece.result.signals.items()}
            sources.append(own)
            for name, signal in own.items():
                signals.setdefault(name, signal)
        columns = {name: k for k, name in enumerate(signals)}
        described = {
            name: replace(s, name=name)
            if all(o.get(name) is not None and o[name].column is None and o[name].value == s.value for o in sources)
            else replace(s, name=name, column=columns[name], sign=1, value=0.0)
            for name, s in signals.items()
        }
        time = np.concatenate([p.result.time[p.rows] for p in self.pieces])

        def trajectories() -> Array:
            return np.vstack([_values(p, own, columns) for p, own in zip(self.pieces, sources, strict=True)])

        stats = dict(self.pieces[-1].result.stats)
        each: list[Any] = [p.result.stats for p in self.pieces]
        for key in ("steps", "segments"):
            stats[key] = sum(own.get(key, 0.0) for own in each)
        spent = {k: sum(own["time"].get(k, 0.0) for own in each) for k in ("initialize", "integrate")}
        stats |= {"pieces": len(self.pieces), "structures": self.compilations, "time": {**self.timings, **spent}}
        events = [e for p in self.pieces for e in p.result.events if e.time <= p.result.time[p.rows][-1]]
        joined = Result(
            model=type(self.model).__name__,
            time=time,
            trajectories=trajectories,
            signals=described,
            events=tuple(sorted((*events, *self.changes), key=lambda e: e.time)),
            stats=stats,
        )
        stats["notes"] = tuple(dict.fromkeys([n for own in each for n in own.get("notes", ())] + self.remarks(joined)))
        return joined

    def remarks(self, joined: Result) -> list[str]:
        """What the components have to say about the run."""

        def largest(name: str) -> float:
            found = np.asarray(joined[name], dtype=float) if name in joined else np.zeros(1)
            return float(np.nanmax(found, initial=0.0))

        found: list[str] = []
        for path, part in self.parts.items():
            if hasattr(type(part), "remarks"):
                found += part.remarks(lambda name, path=path: largest(f"{path}.{name}" if path else name))
        return found


def _values(piece: _Rows, own: Mapping[str, Signal], columns: Mapping[str, int]) -> Array:
    """Values of one piece in the columns of the whole."""
    matrix = piece.result.matrix[piece.rows]
    values = np.full((len(matrix), len(columns)), np.nan)
    for name, signal in own.items():
        if signal.column is None:
            values[:, columns[name]] = signal.value
        else:
            values[:, columns[name]] = signal.sign * matrix[:, signal.column] + 0.0
    return values


def renamed(name: str, names: Mapping[str, str]) -> str:
    """A path with its beginning exchanged."""
    for own, lasting in names.items():
        if name.startswith(own) and name[len(own) : len(own) + 1] in ("", ".", "["):
            return lasting + name[len(own) :]
        if name.startswith(f"der({own}."):
            return f"der({lasting}{name[4 + len(own) :]}"
    return name
