"""Runs of models whose structure follows their state: contacts that are in the equations only while they can touch.

What takes part are components with a choice of structures (`acausal.language.choices`), such as
`library/contact/scene/scene.py`. The model itself stays as it is: a run goes from one frozen choice to the next, and
compiles the model with it.

A run of one structure has the contacts as a source of stops: it is looked at what has been recorded, less and less
often; as long as nothing is used up, the run goes on. Where something is, the rows beyond are cut, the run ends, and
the next one begins there with a structure chosen anew. This is the neighbour list of molecular dynamics (L. Verlet,
Physical Review 159 (1967) 98-103): the skin pays for steps, and no bound of the velocity has to be known. States keep
their values by name over all structures, also while they are not in the equations.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.errors import IntegrationError, RunError
from acausal.flatten.instances.instances import changing, placed
from acausal.flatten.parameters import check_overrides
from acausal.language.choices import Choice, is_reporting
from acausal.language.component import Component
from acausal.lower.compiled import CompiledModel
from acausal.lower.lowered import Recipe
from acausal.result.result import Event, Result
from acausal.simulate.driver.agenda import Source
from acausal.simulate.driver.run import Progress
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.options import Options
from acausal.simulate.record.record import Recorder
from acausal.simulate.restructure.joined import Joined, Piece, all_renamed, renamed
from acausal.simulate.restructure.structures import Watch, named, structure
from acausal.simulate.start.initialize import Start

Array = NDArray[np.float64]
RunPiece = Callable[
    [CompiledModel, Options, "Start | None", Array, bool, "tuple[Source, ...]", Progress | None], Result
]
"""One run: `(compiled, options, start, outputs, whether initial() is true at its start, sources, progress)`."""
Seen = Mapping[str, Mapping[str, Array]]
"""What the components watch, by path and name within the component."""
_log = logging.getLogger(__name__)
_FIRST = 0.1
_MOST_USED = 0.5
# From so much on the structure is chosen anew at a look.
_WORN = 0.25
# The next look is where so much of what is left will have been used, as fast as it was until now.
_MOST_FORESEEN = 0.3
# And so many times as long as the last at most. With four times, a drill that comes down to a plate goes on without it
# for so long that its run crawls (200 s for 1.4).
_GROWTH = 2.0
# Rows between two looks that are looked at, if there are more: those at events of one body are rows of all others.
_ROWS = 64
_SHORTEST = 1e-9


def lasting_names(model: Component) -> dict[str, str]:
    """Beginnings of paths as they are in a model with all it may ever need, and as they are in results of its runs."""
    return _labels({path: part.whole() for path, part in changing(model).items()})


def opening(model: Component) -> dict[str, Choice]:
    """The choices that a run begins with, by path; empty for a model whose structure never changes."""
    return {path: part.least(False) for path, part in changing(model).items()}


def _labels(choices: Mapping[str, Choice]) -> dict[str, str]:
    """Beginnings of paths as they are with these choices, and as they are in results."""
    return {named(path, own): named(path, kept) for path, c in choices.items() for own, kept in c.labels()}


@dataclass
class Skin:
    """The contacts of one structure, as a source of stops.

    `watch` reads what the components watch, `before` is what it was when their structures were chosen; `length` is the
    time to the next look [s].
    """

    watch: Watch
    choices: dict[str, Choice]
    before: Mapping[str, Mapping[str, Array]]
    length: float
    stop: float
    _from: float = -np.inf
    _rows: int = 0

    def next_stop(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """The next check of the skin, which is no event."""
        self._from = here
        end = until if here + 1.2 * self.length >= self.stop else here + self.length
        return min(end, until), ()

    def set_modes(self, modes: Array) -> None:
        """Contacts have no modes of time."""

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Whether the structure still holds; rows from where it did not are cut."""
        first, self._rows = self._rows, record.count
        rows = spread(record.count - first, _ROWS)
        recorded = record.since(first, rows)
        seen, times = self.watch.read(recorded), recorded.time
        used = self._used(seen, len(times))
        # between two rows that are far from each other there may have been more
        wrong = (used > 1.0) | (np.diff(used, prepend=used[0]) > _MOST_USED)
        span = record.time - self._from
        if wrong.any():
            good = _apart(record.times(first), int(rows[max(int(np.argmax(wrong)) - 1, 0)]))
            # the row before the stop, if there is one: what has happened there happens again
            record.cut(first + good if good > 0 else max(first - 1, 0))
            self.length = max(record.time - self._from, self.length / 4)
            return False
        last = float(used[-1])
        holds = last <= _WORN or self._chosen_anew(seen)
        left = 1.0 - last if last <= _WORN else 1.0
        pace = max(last - float(used[0]), 1e-9) / span
        self.length = min(_GROWTH * max(self.length, span), _MOST_FORESEEN * left / pace)
        return holds

    def _chosen_anew(self, seen: Seen) -> bool:
        """Choose for the last row; whether the equations are the same."""
        now = at_row(seen, -1)
        following = {path: c.following(now[path]) for path, c in self.choices.items()}
        if any(c.structure() != self.choices[path].structure() for path, c in following.items()):
            return False
        self.choices, self.before = following, now
        return True

    def _used(self, seen: Seen, rows: int) -> Array:
        """How much of the skin is used up at each row [1]."""
        used = np.zeros(rows)
        for path, choice in self.choices.items():
            used = np.maximum(used, choice.moved(self.before[path], seen[path]))
        return used


def at_row(seen: Seen, row: int) -> dict[str, dict[str, Array]]:
    """Values of the watched signals at a row."""
    return {path: {name: values[row] for name, values in own.items()} for path, own in seen.items()}


def spread(count: int, most: int) -> NDArray[np.int64]:
    """The first and the last of so many rows, and `most` of those between them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _apart(times: Array, row: int) -> int:
    """The last row up to this one that is no side of an event."""
    while row > 0 and times[row] in (times[row - 1], times[row + 1]):
        row -= 1
    return row


@dataclass
class Pieces:
    """A run of one structure after the other."""

    recipe: Recipe
    options: Options
    parameters: Mapping[str, object]
    run: RunPiece
    progress: Progress | None = None
    choices: dict[str, Choice] = field(default_factory=dict)
    memory: dict[str, float] = field(default_factory=dict)
    pieces: list[Piece] = field(default_factory=list)
    changes: list[Event] = field(default_factory=list)
    compiled: CompiledModel | None = None
    compilations: int = 0
    timings: dict[str, float] = field(default_factory=dict)

    def result(self) -> Result:
        """Run, and put the pieces together."""
        opts = self.options
        self.choices = opening(self.recipe.model)
        if self.parameters:
            whole = {kept: own for own, kept in lasting_names(self.recipe.model).items()}
            check_overrides({renamed(p, whole): v for p, v in self.parameters.items()}, placed(self.recipe.model)[0])
        self.compile()
        t, stop = opts.start_time, opts.stop_time
        # The poses at the start come from the start problem of the model without contacts.
        first = self.run(self._compiled, opts, None, np.zeros(0), False, (), None)
        self.keep(first, 0)
        seen, grid, length = at_row(self.watch().read(first), 0), opts.grid(), _FIRST * opts.span
        report = None if self.progress is None else self._report
        while t < stop:
            if self.choose(seen, t):
                self.compile()
            skin = Skin(self.watch(), self.choices, seen, length, stop)
            rest = replace(opts, start_time=t), self.start(), np.append(grid[(grid > t) & (grid < stop)], stop)
            try:
                piece = self.run(self._compiled, *rest, not self.pieces, (skin,), report)
            except (RunError, KeyboardInterrupt) as error:
                partial = getattr(error, "result", None)
                if partial is not None:
                    self.choices = skin.choices
                    self.pieces.append(Piece(partial, _labels(self.choices)))
                if self.pieces:
                    error.result = self.joined()  # type: ignore[union-attr]
                raise
            self.choices, length = skin.choices, skin.length
            if not piece.time[-1] > t:
                if length < _SHORTEST * opts.span:
                    raise self.stuck(t)
                continue
            self.pieces.append(Piece(piece, _labels(self.choices)))
            t = float(piece.time[-1])
            if "terminated" in piece.stats or not t < stop:
                break
            self.keep(piece, -1)
            seen = at_row(skin.watch.read(piece), -1)
        return self.joined()

    def _report(self, share: float, t: float) -> None:
        """Tell how far the whole run is."""
        if self.progress is not None:
            self.progress((t - self.options.start_time) / self.options.span, t)

    @property
    def _compiled(self) -> CompiledModel:
        assert self.compiled is not None
        return self.compiled

    def compile(self) -> None:
        """The equations for the structure as it is now."""
        self.compiled, timings = structure(self.recipe, self.present(), self.choices)
        self.compilations += 1
        for name, seconds in timings.items():
            self.timings[name] = self.timings.get(name, 0.0) + seconds

    def watch(self) -> Watch:
        """The signals by which this structure is chosen."""
        return Watch.of(self._compiled, {path: c.watched() for path, c in self.choices.items()})

    def present(self) -> dict[str, object]:
        """Values of the parameters that are in this structure.

        Numbers of contacts are those among all that may come about: what is the third of these may be the first now.
        """
        if not self.parameters:
            return {}
        lasting, own = lasting_names(self.recipe.model), {kept: name for name, kept in _labels(self.choices).items()}
        found = {}
        for path, value in self.parameters.items():
            kept = renamed(path, lasting)
            here = renamed(kept, own)
            if kept == path or here != kept:
                found[here] = value
        return found

    def choose(self, seen: Mapping[str, Mapping[str, Array]], t: float) -> bool:
        """Choose anew; notes what changed."""
        before, self.choices = self.choices, {path: c.following(seen[path]) for path, c in self.choices.items()}
        changed = [path for path, choice in self.choices.items() if choice.structure() != before[path].structure()]
        for path in changed:
            names = ", ".join(label for _, label in self.choices[path].labels()) or "none"
            self.changes.append(Event(t, f"{path}: contacts in the equations: {names}"))
            _log.debug("t = %g: %s: %s", t, path, names)
        return bool(changed)

    def keep(self, piece: Result, row: int) -> None:
        """Remember the states."""
        names, states = _labels(self.choices), self._compiled.states
        values = Watch.of(self._compiled, {"": states}).read(piece)[""]
        for name, lasting in zip(states, all_renamed(states, names), strict=True):
            self.memory[lasting] = float(values[name][row])

    def start(self) -> Start:
        """States as remembered, or as declared where they are new."""
        compiled = self._compiled
        names = _labels(self.choices)
        x, z = (np.array(v, dtype=float).ravel() for v in compiled.guess(np.array(compiled.parameter_values)))
        for k, lasting in enumerate(all_renamed(compiled.states, names)):
            x[k] = self.memory.get(lasting, x[k])
        return Start(x, z, ())

    def stuck(self, t: float) -> IntegrationError:
        """The error for a skin that is used up in no time."""
        return IntegrationError(
            "AC406",
            f"the structure of {type(self.recipe.model).__name__} would have to change all the time at t = {t:.9g} s",
            evidence=[f"changing: {', '.join(self.choices)}"],
            cause="bodies move further than the skin of their scene in no time",
            help="give ContactScene a larger skin, or keep all pairs: ContactScene(keep=1000)",
        )

    def joined(self) -> Result:
        """One result over all pieces; signals that were not in the equations are nan there."""
        signals = Joined(self.pieces)
        time = np.concatenate([p.result.time for p in self.pieces])
        stats = dict(self.pieces[-1].result.stats)
        each: list[Any] = [p.result.stats for p in self.pieces]
        for key in ("steps", "segments"):
            stats[key] = sum(own.get(key, 0.0) for own in each)
        spent = {k: sum(own["time"].get(k, 0.0) for own in each) for k in ("initialize", "integrate")}
        reports = {path: repr(c.report()) for path, v in self.choices.items() if is_reporting(c := v.applied())}
        stats |= {"reports": reports} if reports else {}
        stats |= {"pieces": len(self.pieces), "structures": self.compilations, "time": {**self.timings, **spent}}
        events = [e for p in self.pieces for e in p.result.events]
        joined = Result(
            model=type(self.recipe.model).__name__,
            time=time,
            trajectories=signals.rows,
            signals=signals,
            events=tuple(sorted((*events, *self.changes), key=lambda e: e.time)),
            stats=stats,
            some=signals.rows,
        )
        stats["notes"] = tuple(dict.fromkeys([n for own in each for n in own.get("notes", ())] + self.remarks(joined)))
        return joined

    def remarks(self, joined: Result) -> list[str]:
        """Messages of the components about the run."""

        def largest(name: str) -> float:
            found = np.asarray(joined[name], dtype=float) if name in joined else np.zeros(1)
            return float(np.nanmax(found, initial=0.0))

        found: list[str] = []
        for path, choice in self.choices.items():
            found += choice.remarks(lambda name, path=path: largest(named(path, name)))  # type: ignore[misc]
        return found
