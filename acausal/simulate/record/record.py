"""What a run has computed so far, its events as the result lists them, and the result made of it."""

from __future__ import annotations

import logging
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from types import EllipsisType
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import Span
from acausal.flatten.flat import FlatParameter, suffixes
from acausal.language.declarations.declaration import Declaration
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.result.result import Event, Result, Signal
from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.equations.calls.columns import MOST_OPERATIONS
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.events.guards import Cause
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.record.project import off_constraints, projected, projection
from acausal.simulate.solvers.segment import Piece, add_counters

# All signals of so many rows are computed column by column.
_LONG = 1024


class Recorder:
    """Rows of time, states, algebraic variables and modes, in order; observed variables are computed at the end."""

    def __init__(self, compiled: CompiledModel, p: Vector, u: Vector, most_moved: float = np.inf) -> None:
        self.compiled, self.most_moved = compiled, most_moved
        self.p, self.u = p, u
        self.is_constrained = bool(compiled.solution.structure.invariants)
        self.counters: dict[str, float] = {}
        self.boundaries: list[tuple[float, tuple[Cause, ...], tuple[str, ...]]] = []
        self.segments = 0
        self.count = 0  # rows so far
        self._size = np.zeros(len(compiled.states))  # largest magnitude of each state
        self._hidden: list[int] = []
        self._starts: list[int] = []
        self._times: list[Vector] = []
        self._x: list[Vector] = []
        self._z: list[Vector] = []
        self._m: list[Vector] = []

    @property
    def time(self) -> float:
        """The time reached."""
        return float(self._times[-1][-1])

    def begin(
        self, t: float, x: Vector, z: Vector, m: Vector, causes: tuple[Cause, ...] = (), changed: tuple[str, ...] = ()
    ) -> None:
        """The first row of a segment: the values after the event, what happened in it, or the values at the start."""
        if self._times:
            self.boundaries.append((t, causes, changed))
        self.segments += 1
        self._append(np.array([t]), x[:, None], z[:, None], m)

    def add(self, times: Vector, piece: Piece, m: Vector) -> Piece:
        """Rows from a solver, projected onto the constraints; returns them as they are recorded.

        Raises IntegrationError: AC407 where that moves them too far; the rows before are recorded.
        """
        if piece.x.shape[1] != len(times):
            raise AssertionError(f"{piece.x.shape[1]} rows at {len(times)} instants: they would be shifted in time")
        add_counters(self.counters, piece.counters)
        found = None
        if self.is_constrained:
            found = projection(self.compiled, times, piece.x, piece.z, self.u, self.p, m)
        if found is None:
            self._append(times, piece.x, piece.z, m)
            return piece
        self.counters["drift"] = max(self.counters.get("drift", 0.0), found.drift)
        self._size = np.maximum(self._size, np.abs(found.x).max(axis=1, initial=0.0, where=np.isfinite(found.x)))
        moved = found.moved / (self.compiled.nominal_x + self._size)[:, None]
        far = moved.max(axis=0) > self.most_moved
        good = int(np.argmax(far)) if far.any() else len(times)
        own = m if m.ndim == 1 else m[:, :good]
        self._append(times[:good], found.x[:, :good], piece.z[:, :good], own)
        if good < len(times):
            states = piece.x[:, good], found.x[:, good], moved[:, good]
            raise off_constraints(self.compiled, float(times[good]), *states, self.most_moved)
        return Piece(found.x, piece.z, piece.counters)

    def extend(
        self,
        times: Vector,
        x: Vector,
        m: Vector,
        boundaries: list[tuple[float, tuple[Cause, ...], tuple[str, ...]]],
        counters: dict[str, float],
    ) -> None:
        """Rows of many segments of a model without algebraic variables or constraints, and the events in them."""
        self.boundaries += boundaries
        self.segments += len(boundaries)
        self._append(times, x, np.zeros((0, len(times))), m)
        add_counters(self.counters, counters)

    def _append(self, times: Vector, x: Vector, z: Vector, m: Vector) -> None:
        if not len(times):
            return
        self._starts.append(self.count)
        self.count += len(times)
        self._times.append(times)
        self._x.append(x)
        self._z.append(z)
        self._m.append(m if m.ndim == 2 else np.tile(m[:, None], (1, len(times))))

    def cut(self, row: int) -> None:
        """Forget all rows behind one, and what has happened from its instant on; that row is shown."""
        part = bisect_right(self._starts, row) - 1
        keep = row - self._starts[part] + 1
        for rows_ in (self._starts, self._times, self._x, self._z, self._m):
            del rows_[part + 1 :]
        self._times[part] = self._times[part][:keep]
        for columns in (self._x, self._z, self._m):
            columns[part] = columns[part][:, :keep]
        self.count = row + 1
        self.boundaries = [b for b in self.boundaries if b[0] < self.time]
        self._hidden = [k for k in self._hidden if k < row]

    def since(self, row: int, which: NDArray[np.int64] | slice = slice(None)) -> Result:
        """What was recorded from one row on; of these rows, counted from there, those that are `which`."""
        chosen = np.arange(row, self.count)[which]
        owner = np.searchsorted(self._starts, chosen, side="right") - 1
        own = [(k, chosen[owner == k] - self._starts[k]) for k in np.unique(owner).tolist()]
        x, z, m = ([columns[k][:, rows_] for k, rows_ in own] for columns in (self._x, self._z, self._m))
        times = np.concatenate([self._times[k][rows_] for k, rows_ in own])
        return _table(self, (times, States(x, None), joined(z), joined(m)))

    def times(self, first: int) -> Vector:
        """Times of all rows from one on."""
        part = bisect_right(self._starts, first) - 1
        return np.concatenate(self._times[part:])[first - self._starts[part] :]

    def hide(self, row: int, boundary: int | None = None) -> None:
        """Leave a row out of the result, and a boundary at which nothing has happened."""
        self._hidden.append(row)
        if boundary is not None:
            del self.boundaries[boundary]

    def hide_at(self, instants: Vector, shown: Vector) -> None:
        """Leave rows at these instants out of the result, but those of something that happens, and those in `shown`."""
        if not len(instants) or not self.count:
            return
        times = np.concatenate(self._times)
        happened = [t for t, causes, changed in self.boundaries if changed or any(c.text for c in causes)]
        away = np.setdiff1d(instants, np.concatenate([shown, happened, times[[0, -1]]]))
        self._hidden += np.flatnonzero(np.isin(times, away)).tolist()

    def explain(self, boundary: int, causes: tuple[Cause, ...]) -> None:
        """Further causes of what happened at a boundary."""
        t, known, changed = self.boundaries[boundary]
        self.boundaries[boundary] = t, (*causes, *known), changed

    def shown(self) -> tuple[Vector, States, Vector, Vector]:
        """The rows of the result: times, states, algebraic variables, modes."""
        times, z, m = np.concatenate(self._times), joined(self._z), joined(self._m)
        if not self._hidden:
            return times, States(self._x, None), z, m
        keep = np.ones(len(times), dtype=bool)
        keep[self._hidden] = False
        return times[keep], States(self._x, keep), z[:, keep], m[:, keep]

    def rows(self, first: int = 0) -> tuple[Vector, Vector, Vector, Vector]:
        """(times, x, z, modes) of all rows from one on; columns are instants. They are not for changing."""
        if first == 0:
            self._join()
        part = bisect_right(self._starts, first) - 1
        skip = first - self._starts[part]
        x, z, m = (joined(columns[part:])[:, skip:] for columns in (self._x, self._z, self._m))
        return self.times(first), x, z, m

    def _join(self) -> None:
        """Keep all rows as one part: the end of a run asks for them several times."""
        if len(self._starts) > 1:
            self._x, self._z, self._m = ([joined(parts)] for parts in (self._x, self._z, self._m))
            self._times, self._starts = [np.concatenate(self._times)], [0]

    def magnitudes(self, n: int) -> Vector:
        """The largest magnitude of each of the first n states, without an array of all rows."""
        return np.asarray(np.maximum.reduce([np.maximum(x[:n].max(axis=1), -x[:n].min(axis=1)) for x in self._x]))

    def before(self, t: float) -> int:
        """The last row not after `t`."""
        times = np.concatenate(self._times)
        return int(np.searchsorted(times, t, side="right")) - 1

    def point(self, k: int) -> tuple[float, Vector, Vector, Vector]:
        """Time, states, algebraic variables and modes of one row."""
        part = bisect_right(self._starts, k) - 1
        j = k - self._starts[part]
        return float(self._times[part][j]), self._x[part][:, j], self._z[part][:, j], self._m[part][:, j]

    def observe(
        self, times: Vector, x: Vector | States, z: Vector, m: Vector, columns: Sequence[int] | None = None
    ) -> Vector:
        """All trajectories, or those of some columns, shape (rows, columns).

        The points lie on the constraints, so nothing is stabilised here: over a very short run the square of the rate
        would make forces of rounding errors.
        """
        p = self.p.copy()
        if self.compiled.solution.structure.rate is not None:
            p[-1] = 0.0
        first = len(m) - len(self.compiled.state_events.relations)
        slides = bool(((m[first:] > 0.0) & (m[first:] < 1.0)).any())
        if columns is None:
            whole = x.whole if isinstance(x, States) else x
            arguments = times[:, None], whole.T, z.T, self.u, p, m.T
            if slides:
                return rows(self.compiled.blended_observe, arguments)
            if len(times) < _LONG or self.compiled.observe.n_instructions() > MOST_OPERATIONS:
                return rows(self.compiled.observe, arguments)
            return functions_of(self.compiled).observe.many(*arguments)
        states, n = (x, x.count) if isinstance(x, States) else (x.T, len(x))
        places, found = np.array(columns, dtype=np.int64), np.empty((len(times), len(columns)))
        own, other = places < n, places >= n + len(z)
        found[:, own] = states[..., places[own]]
        found[:, ~own & ~other] = z.T[:, places[~own & ~other] - n]
        if other.any():
            function = functions_of(self.compiled).observing(tuple(places[other].tolist()), slides)
            found[:, other] = function.many(times[:, None], states, z.T, self.u, p, m.T)
        return found


def make_result(
    recorder: Recorder,
    events: tuple[Event, ...],
    stats: dict[str, object],
    dense: Callable[[Vector], Vector] | None,
) -> Result:
    """The result of what was recorded; `dense` gives all values at further times."""
    return _table(recorder, recorder.shown(), events=events, stats=stats, dense=dense)


def _table(recorder: Recorder, recorded: tuple[Vector, Vector | States, Vector, Vector], **more: Any) -> Result:
    """The values of some rows, and what else a result has."""
    return Result(
        model=recorder.compiled.name,
        time=recorded[0],
        trajectories=lambda: recorder.observe(*recorded),
        signals=Described(recorder.compiled, recorder.p),
        some=lambda columns: recorder.observe(*recorded, columns),
        **more,
    )


class Described(Mapping[str, Signal]):
    """The signals of a run by name, made when the first of them is asked for: that takes longer than a short run."""

    def __init__(self, compiled: CompiledModel, p: Vector) -> None:
        self._compiled, self._p = compiled, p

    @cached_property
    def _made(self) -> dict[str, Signal]:
        return signals(self._compiled, self._p)

    @cached_property
    def _moving(self) -> _Variables:
        """Signals of variables, the same for all runs; of those that are constant without their values."""
        return described(self._compiled)

    def __getitem__(self, name: str) -> Signal:
        found = self._moving.get(name)
        if found is not None and found.column is not None:
            return found
        if "_made" in self.__dict__:
            return self._made[name]
        # alone: a scene reads a few at each look at its contacts, and to make all takes as long as the run in between
        if found is not None:
            return replace(found, value=float(self._constants[self._moving.constant(self._compiled, name)]))
        parameter, place = self._moving.parameters[name]
        (value,) = compiled_parameters(self._compiled, parameter.nodes[place : place + 1], self._p)
        return Signal(name, parameter.declaration.unit, parameter.declaration.doc, value=value, parameter=True)

    @cached_property
    def _constants(self) -> Vector:
        """Values of the variables that are constant, as the model counts them."""
        return functions_of(self._compiled).constants(self._p)[0]

    def __contains__(self, name: object) -> bool:
        return name in self._moving or name in self._moving.parameters

    def __iter__(self) -> Iterator[str]:
        return iter(self._made)

    def __len__(self) -> int:
        return len(self._made)


def signals(compiled: CompiledModel, p: Vector) -> dict[str, Signal]:
    """Where every variable and parameter of the model is found, by path."""
    variables = described(compiled)
    found = {name: variables[name] for name in variables}
    constants = dict(zip(compiled.constant_nodes, functions_of(compiled).constants(p)[0].tolist(), strict=True))
    for name, signal in found.items():
        if signal.column is None:
            found[name] = replace(signal, value=constants[variables.node(name)])
    for parameter in compiled.flat.parameters:
        values = compiled_parameters(compiled, parameter.nodes, p)
        for suffix, value in zip(suffixes(parameter.declaration.shape), values, strict=True):
            name = parameter.path + suffix
            d = parameter.declaration
            found[name] = Signal(name, d.unit, d.doc, value=value, parameter=True)
    return found


# The same for every run of a compiled model; a sweep would make thousands of signals anew for each.
_described: WeakKeyDictionary[CompiledModel, _Variables] = WeakKeyDictionary()


def described(compiled: CompiledModel) -> _Variables:
    """What `signals` says of variables, made once for a model."""
    if compiled not in _described:
        _described[compiled] = _Variables(compiled)
    return _described[compiled]


class _Variables(Mapping[str, Signal]):
    """Signals of all variables, without values of those that are constant; made one by one.

    A large model has a hundred thousand, of which a few are read: at first there is only the place of each name.
    """

    def __init__(self, compiled: CompiledModel) -> None:
        reduced = compiled.solution.structure.reduced
        self._image, self._nodes, self._variables = reduced.image, reduced.pool.nodes, reduced.flat.variables
        self._column = {node: k for k, node in enumerate(compiled.columns)}
        self._place: dict[str, int] = {}  # entries counted over all variables
        self._first: list[int] = []
        left_out, place = reduced.left_out, 0
        self._parameters, self._constants = reduced.flat.parameters, dict[int, int]()
        for variable in self._variables:
            self._first.append(place)
            for k, suffix in enumerate(suffixes(variable.declaration.shape)):
                if variable.first + k not in left_out:
                    self._place[variable.path + suffix] = place + k
            place += variable.size

    def __iter__(self) -> Iterator[str]:
        return iter(self._place)

    def __len__(self) -> int:
        return len(self._place)

    def __contains__(self, name: object) -> bool:
        return name in self._place

    def __getitem__(self, name: str) -> Signal:
        d, node = self._found(name)
        if node in self._column:
            return Signal(name, d.unit, d.doc, column=self._column[node])
        op, *operands = self._nodes[node]
        if op == "neg" and operands[0] in self._column:
            return Signal(name, d.unit, d.doc, column=self._column[operands[0]], sign=-1)
        return Signal(name, d.unit, d.doc)

    @cached_property
    def parameters(self) -> dict[str, tuple[FlatParameter, int]]:
        """Of the name of each parameter's entry the parameter, and which entry it is."""
        return {
            parameter.path + suffix: (parameter, k)
            for parameter in self._parameters
            for k, suffix in enumerate(suffixes(parameter.declaration.shape))
        }

    def constant(self, compiled: CompiledModel, name: str) -> int:
        """The place of a constant variable of this model among its `constant_nodes`."""
        if not self._constants:
            self._constants = {node: k for k, node in enumerate(compiled.constant_nodes)}
        return self._constants[self.node(name)]

    def node(self, name: str) -> int:
        """The node of a variable in the reduced pool."""
        return self._found(name)[1]

    def _found(self, name: str) -> tuple[Declaration, int]:
        place = self._place[name]
        number = bisect_right(self._first, place) - 1
        variable = self._variables[number]
        return variable.declaration, self._image[variable.first + place - self._first[number]]


def compiled_parameters(compiled: CompiledModel, nodes: tuple[int, ...], p: Vector) -> list[float]:
    """Values [SI] of these expressions of the flat pool, which depend on the parameters `p` alone."""
    pool = compiled.flat.pool
    simple = [pool.nodes[n] for n in nodes]
    if all(s[0] == "par" for s in simple):
        return [float(p[s[1]]) for s in simple]

    found = values(pool, nodes, {"par": p.__getitem__, "time": lambda _: 0.0})
    return [float(found[n]) for n in nodes]


def joined(parts: list[Vector]) -> Vector:
    """All columns of some parts, one after the other in memory, as solvers deliver them."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate([part.T for part in parts]).T


class States:
    """States at n instants, as of shape (n, nx), from parts of shape (nx, rows of the part).

    One signal of 10 000 states at 500 instants needs two or three of them: to bring all into one array takes as long as
    their integration.
    """

    def __init__(self, parts: list[Vector], shown: NDArray[np.bool_] | None) -> None:
        """Of all rows, or of those that are `shown`."""
        self._parts, self._shown = list(parts), shown
        self.count = len(parts[0])
        """Number of states."""

    @cached_property
    def whole(self) -> Vector:
        """All of them, shape (nx, n)."""
        found = joined(self._parts)
        return found if self._shown is None else found[:, self._shown]

    def __getitem__(self, key: tuple[EllipsisType, NDArray[np.int64]]) -> Vector:
        """Some states at all instants: `states[..., places]`, shape (n, places)."""
        found = np.concatenate([part[key[1]].T for part in self._parts])
        return found if self._shown is None else found[self._shown]


Again = Callable[[int, Vector], tuple[Piece, Vector]]
"""`(row, times) -> (piece, modes)`: the solution integrated again from a recorded row."""
_log = logging.getLogger(__name__)


class Dense:
    """Values at any times: integrated again from the stored points before them, once for all between two of these.

    Rows are nan where the solver does not go, as over less time than it can tell apart.
    """

    def __init__(self, recorder: Recorder, again: Again) -> None:
        self._recorder, self._again = recorder, again
        # the signals of a result are asked for one by one, at the same times
        self._last: tuple[Vector, Vector] | None = None

    def __call__(self, wanted: Vector) -> Vector:
        """All trajectories at `wanted` [s], shape (times, columns)."""
        if self._last is not None and np.array_equal(self._last[0], wanted):
            return self._last[1]
        recorder = self._recorder
        times, place = np.unique(wanted, return_inverse=True)
        found = np.full((len(times), len(recorder.compiled.columns)), np.nan)
        before = np.array([recorder.before(t) for t in times])
        for k in np.unique(before):
            inside = np.flatnonzero(before == k)
            for some in (inside, *inside[:, None]):
                missing = some[np.isnan(found[some]).all(axis=1)]
                if missing.size:
                    try:
                        found[missing] = self._between(int(k), times[missing])
                    except RuntimeError as error:
                        _log.debug("no values at %s s: %s", times[missing], error)
        self._last = wanted.copy(), found[place]
        return self._last[1]

    def _between(self, k: int, times: Vector) -> Vector:
        """Rows behind row k, before the next one."""
        recorder = self._recorder
        piece, m = self._again(k, times)
        on = projected(recorder.compiled, times, piece.x, piece.z, recorder.u, recorder.p, m)
        modes = m if m.ndim == 2 else np.repeat(m[:, None], len(times), axis=1)
        return np.asarray(recorder.observe(times, on, piece.z, modes))


def event_log(
    boundaries: Sequence[tuple[float, tuple[Cause, ...], tuple[str, ...]]],
    instants: Vector,
    inputs: Inputs,
    cuts: Vector,
) -> tuple[Event, ...]:
    """Time, words, place, component and changed variables of each boundary between two segments.

    A boundary without causes is one of the `instants` at which relations of time change, or one at which an input over
    time jumps; where the input goes on with another polynomial nothing happens, nor where a table of time only bends,
    at one of the `cuts`.
    """
    silent = {*inputs.breaks.tolist(), *cuts.tolist()} - set(instants.tolist())
    jumps = set(inputs.jumps.tolist())
    known: dict[int, tuple[str, Span | None, str]] = {}  # by identity: thousands of events share a few tuples
    found = []
    for t, causes, changed in boundaries:
        if causes and not changed and not any(c.text for c in causes):
            continue  # a rate wakes there
        if not causes and not changed and t in silent:
            if t in jumps:
                found.append(Event(t, "an input jumps"))
            continue
        if not causes:
            found.append(Event(t, _of_time(t, instants), changed=changed))
            continue
        if id(causes) not in known:
            known[id(causes)] = _told(causes)
        found.append(Event(t, *known[id(causes)], changed))
    return tuple(found)


@lru_cache(1024)
def _told(causes: tuple[Cause, ...]) -> tuple[str, Span | None, str]:
    """Words, place and component of what happened."""
    where = next((c.where for c in causes if c.where is not None), None)
    component = next((c.component for c in causes if c.component), "")
    return "; ".join(dict.fromkeys(c.text for c in causes if c.text)), where, component


def _of_time(t: float, instants: Vector) -> str:
    """What happens at `t`, given the instants of all relations of time."""
    count = int(np.sum(np.abs(instants - t) <= 1e-12 * max(1.0, abs(t))))
    return f"time >= {t:g}" + (f" ({count} relations)" if count > 1 else "")
