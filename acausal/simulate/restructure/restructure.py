"""Runs of models whose structure follows their state: contacts that are in the equations only while they can touch.

The components concerned have a choice of structures (`acausal.language.choices`), such as
`library/contact/scene/scene.py`. The model itself does not change: a run goes from one frozen choice to the next, and
compiles the model with each.

A run of one structure has the contacts as a source of stops, at which the recorded rows are checked. The checks become
less frequent as long as the skin of the contacts is not used up, and the run continues. Where the skin is used up, the
rows after that are cut, the run ends, and the next one begins there with a new choice. This is the neighbour list of
molecular dynamics (L. Verlet, Physical Review 159 (1967) 98-103): a thicker skin needs fewer checks, and no bound of
the velocity has to be known. States keep their values by name over all structures, also while they are not in the
equations.
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
from acausal.language.review import Reviewing
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
from acausal.simulate.review import reviews
from acausal.simulate.start.initialize import Start

Array = NDArray[np.float64]
RunPiece = Callable[
    [CompiledModel, Options, "Start | None", Array, bool, "tuple[Source, ...]", Progress | None], Result
]
"""One run: `(compiled, options, start, outputs, whether initial() is true at its start, sources, progress)`."""
Watched = Mapping[str, Mapping[str, Array]]
"""Values of the signals that the components watch, by path and by name within the component."""
_log = logging.getLogger(__name__)
# Time to the first check, as a fraction of the run.
_FIRST_CHECK = 0.1
# Increase of the used fraction of the skin from row to row above which the true maximum between them is uncertain.
_MOST_INCREASE = 0.5
# If more of the skin than this is used at a check, the structure is chosen again.
_RENEWED = 0.25
# The next check is when this fraction of the remaining skin will be used at the present rate.
_USED_UNTIL_CHECK = 0.3
# The time to the next check grows at most by this factor. With 4, a drill that approaches a plate is integrated without
# it for so long that its run slows down (200 s instead of 1.4 s).
_GROWTH = 2.0
# Most rows that are examined between two checks: events of one body add rows for all others.
_MOST_ROWS = 64
# Fraction of the run below which the time to the next check counts as zero.
_SHORTEST = 1e-9


def lasting_names(model: Component) -> dict[str, str]:
    """Beginnings of paths in the model with all parts it may ever need, and the ones that replace them in results."""
    return _labels({path: part.whole() for path, part in changing(model).items()})


def opening(model: Component) -> dict[str, Choice]:
    """The choices with which a run begins, by path; empty for a model whose structure never changes."""
    return {path: part.least(False) for path, part in changing(model).items()}


def _labels(choices: Mapping[str, Choice]) -> dict[str, str]:
    """Beginnings of paths with these choices, and the ones that replace them in results."""
    return {named(path, name): named(path, kept) for path, c in choices.items() for name, kept in c.labels()}


@dataclass
class Skin:
    """The contacts of one structure, as a source of stops.

    `watch` reads the signals that the components watch. `reference` holds their values when the structures were chosen.
    `length` is the time to the next check, and `stop` the end of the run [s].
    """

    watch: Watch
    choices: dict[str, Choice]
    reference: Mapping[str, Mapping[str, Array]]
    length: float
    stop: float
    _start: float = -np.inf
    _rows: int = 0

    def next_stop(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """The next check of the skin, which is no event."""
        self._start = here
        end = until if here + 1.2 * self.length >= self.stop else here + self.length
        return min(end, until), ()

    def set_modes(self, modes: Array) -> None:
        """Do nothing: contacts have no modes of time."""

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Whether the structure is still valid; otherwise cuts the rows from where it was not."""
        first, self._rows = self._rows, record.count
        rows = evenly_spread(record.count - first, _MOST_ROWS)
        recorded = record.since(first, rows)
        watched, times = self.watch.read(recorded), recorded.time
        used = self._used(watched, len(times))
        # if the used fraction jumps between two rows, more may have been used in between
        is_invalid = (used > 1.0) | (np.diff(used, prepend=used[0]) > _MOST_INCREASE)
        span = record.time - self._start
        if is_invalid.any():
            valid = _before_event(record.times(first), int(rows[max(int(np.argmax(is_invalid)) - 1, 0)]))
            # if no row is valid, keep the one before this stop, and repeat any event there
            record.cut(first + valid if valid > 0 else max(first - 1, 0))
            self.length = max(record.time - self._start, self.length / 4)
            return False
        last = float(used[-1])
        holds = last <= _RENEWED or self._choose_again(watched)
        remaining = 1.0 - last if last <= _RENEWED else 1.0
        rate = max(last - float(used[0]), 1e-9) / span
        self.length = min(_GROWTH * max(self.length, span), _USED_UNTIL_CHECK * remaining / rate)
        return holds

    def _choose_again(self, watched: Watched) -> bool:
        """Choose structures at the last row, and adopt them if the equations stay the same; whether they do."""
        now = at_row(watched, -1)
        following = {path: c.following(now[path]) for path, c in self.choices.items()}
        if any(c.structure() != self.choices[path].structure() for path, c in following.items()):
            return False
        self.choices, self.reference = following, now
        return True

    def _used(self, watched: Watched, rows: int) -> Array:
        """The fraction of the skin that is used up at each row, shape (rows,)."""
        used = np.zeros(rows)
        for path, choice in self.choices.items():
            used = np.maximum(used, choice.moved(self.reference[path], watched[path]))
        return used


def at_row(watched: Watched, row: int) -> dict[str, dict[str, Array]]:
    """Values of the watched signals at a row."""
    return {path: {name: values[row] for name, values in values_of.items()} for path, values_of in watched.items()}


def evenly_spread(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most `most` out of `count` rows, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _before_event(times: Array, row: int) -> int:
    """The last row up to this one that is not at an event, where two rows have the same time."""
    while row > 0 and times[row] in (times[row - 1], times[row + 1]):
        row -= 1
    return row


@dataclass
class Pieces:
    """A run as a sequence of pieces, one for each structure."""

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
    reviewing: dict[str, type[Reviewing]] = field(default_factory=dict)
    scalars: dict[str, int] = field(default_factory=dict)  # numbers of variables, equal for connected potentials

    def result(self) -> Result:
        """Run, and join the pieces to one result."""
        opts = self.options
        self.choices = opening(self.recipe.model)
        if self.parameters:
            whole = {kept: own for own, kept in lasting_names(self.recipe.model).items()}
            check_overrides({renamed(p, whole): v for p, v in self.parameters.items()}, placed(self.recipe.model)[0])
        self.compile()
        t, stop = opts.start_time, opts.stop_time
        # The start problem of the model without contacts gives the poses at the start.
        first = self.run(self._compiled, opts, None, np.zeros(0), False, (), None)
        self.keep(first, 0)
        watched, grid, length = at_row(self.watch().read(first), 0), opts.grid(), _FIRST_CHECK * opts.span
        report = None if self.progress is None else self._report
        while t < stop:
            if self.choose(watched, t):
                self.compile()
            skin = Skin(self.watch(), self.choices, watched, length, stop)
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
            watched = at_row(skin.watch.read(piece), -1)
        return self.joined()

    def _report(self, fraction: float, t: float) -> None:
        """Report the progress of the whole run, not of the piece."""
        if self.progress is not None:
            self.progress((t - self.options.start_time) / self.options.span, t)

    @property
    def _compiled(self) -> CompiledModel:
        assert self.compiled is not None
        return self.compiled

    def compile(self) -> None:
        """Compile the model with the current choices."""
        self.compiled, timings = structure(self.recipe, self.present(), self.choices)
        self.compilations += 1
        names = _labels(self.choices)
        flat = self.compiled.flat
        self.reviewing |= {renamed(path, names): cls for path, cls in flat.reviewing.items()}
        if flat.reviewing:
            self._number(all_renamed([v.path for v in flat.variables], names), [v.first for v in flat.variables])
        for name, seconds in timings.items():
            self.timings[name] = self.timings.get(name, 0.0) + seconds

    def _number(self, paths: Sequence[str], own: Sequence[int]) -> None:
        """Enter the variables of a structure, with its `own` numbers, in the numbers common to all structures."""
        common = {k: self.scalars[path] for path, k in zip(paths, own, strict=True) if path in self.scalars}
        for path, k in zip(paths, own, strict=True):
            self.scalars.setdefault(path, common.setdefault(k, len(self.scalars)))

    def watch(self) -> Watch:
        """The signals that decide about the current structure."""
        return Watch.of(self._compiled, {path: c.watched() for path, c in self.choices.items()})

    def present(self) -> dict[str, object]:
        """Values of the parameters that exist in the current structure, by their names in it.

        The caller numbers contacts among all possible ones: the third of these may be the first in this structure.
        """
        if not self.parameters:
            return {}
        lasting, own = lasting_names(self.recipe.model), {kept: name for name, kept in _labels(self.choices).items()}
        values = {}
        for path, value in self.parameters.items():
            kept = renamed(path, lasting)
            here = renamed(kept, own)
            if kept == path or here != kept:
                values[here] = value
        return values

    def choose(self, watched: Mapping[str, Mapping[str, Array]], t: float) -> bool:
        """Choose structures again, and record the changes as events; whether there are any."""
        before, self.choices = self.choices, {path: c.following(watched[path]) for path, c in self.choices.items()}
        changed = [path for path, choice in self.choices.items() if choice.structure() != before[path].structure()]
        for path in changed:
            names = ", ".join(label for _, label in self.choices[path].labels()) or "none"
            self.changes.append(Event(t, f"{path}: contacts in the equations: {names}"))
            _log.debug("t = %g: %s: %s", t, path, names)
        return bool(changed)

    def keep(self, piece: Result, row: int) -> None:
        """Store the states at a row of a piece."""
        names, states = _labels(self.choices), self._compiled.states
        values = Watch.of(self._compiled, {"": states}).read(piece)[""]
        for name, lasting in zip(states, all_renamed(states, names), strict=True):
            self.memory[lasting] = float(values[name][row])

    def start(self) -> Start:
        """The stored states, and the declared start values of new ones."""
        compiled = self._compiled
        names = _labels(self.choices)
        x, z = (np.array(v, dtype=float).ravel() for v in compiled.guess(np.array(compiled.parameter_values)))
        for k, lasting in enumerate(all_renamed(compiled.states, names)):
            x[k] = self.memory.get(lasting, x[k])
        return Start(x, z, ())

    def stuck(self, t: float) -> IntegrationError:
        """The error for a skin that is used up immediately after each change."""
        return IntegrationError(
            "AC406",
            f"the structure of {type(self.recipe.model).__name__} would have to change continually at t = {t:.9g} s",
            evidence=[f"changing: {', '.join(self.choices)}"],
            cause="bodies instantly move further than the skin of their scene",
            help="give ContactScene a larger skin, or keep all pairs: ContactScene(keep=1000)",
        )

    def joined(self) -> Result:
        """Join the pieces; signals are nan where they were not in the equations."""
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
        notes = [n for own in each for n in own.get("notes", ())]
        stats["notes"] = tuple(dict.fromkeys([*notes, *reviews(self.reviewing, joined, self.scalars)]))
        return joined
