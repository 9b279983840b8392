"""The recorder of a run, the list of its events, and the construction of its result."""

from __future__ import annotations

import logging
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.flatten.flat import FlatParameter, suffixes
from acausal.language.declarations.declaration import Declaration
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.recent import once_per_owner
from acausal.result.result import Event, Result, Signal
from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.equations.calls.columns import MOST_OPERATIONS
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.events.guards import Cause
from acausal.simulate.record.boundaries import Boundaries, EventLog, Happening
from acausal.simulate.record.project import off_constraints, projected, projection
from acausal.simulate.solvers.segment import Piece, add_counters

# From this many rows on, all signals are computed together with `BufferedFunction.many`.
_FEWEST_ROWS = 1024


class Recorder:
    """Records rows of time, states, algebraic variables and modes; all other variables are computed at the end."""

    def __init__(self, compiled: CompiledModel, p: Vector, u: Vector, most_moved: float = np.inf) -> None:
        self.compiled, self.most_moved = compiled, most_moved
        self.p, self.u = p, u
        self.is_constrained = bool(compiled.solution.structure.invariants)
        self.counters: dict[str, float] = {}
        self.boundaries = Boundaries()
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
        """The time of the last row [s]."""
        return float(self._times[-1][-1])

    def begin(
        self, t: float, x: Vector, z: Vector, m: Vector, causes: tuple[Cause, ...] = (), changed: tuple[str, ...] = ()
    ) -> None:
        """Add the first row of a segment: values at the start of the run or after an event, with its causes."""
        if self._times:
            self.boundaries.add((t,), ((causes, changed),))
        self.segments += 1
        self._append(np.array([t]), x[:, None], z[:, None], m)

    def add(self, times: Vector, piece: Piece, m: Vector) -> Piece:
        """Add rows from a solver, projected onto the constraints; returns them as they are recorded.

        Raises IntegrationError: AC407 if that moves a row too far; the rows before it are recorded.
        """
        if piece.x.shape[1] != len(times):
            raise AssertionError(f"{piece.x.shape[1]} rows at {len(times)} instants: they would be shifted in time")
        add_counters(self.counters, piece.counters)
        nearest = None
        if self.is_constrained:
            nearest = projection(self.compiled, times, piece.x, piece.z, self.u, self.p, m)
        if nearest is None:
            self._append(times, piece.x, piece.z, m)
            return piece
        self.counters["drift"] = max(self.counters.get("drift", 0.0), nearest.drift)
        self._size = np.maximum(self._size, np.abs(nearest.x).max(axis=1, initial=0.0, where=np.isfinite(nearest.x)))
        moved = nearest.moved / (self.compiled.nominal_x + self._size)[:, None]
        is_too_far = moved.max(axis=0) > self.most_moved
        count = int(np.argmax(is_too_far)) if is_too_far.any() else len(times)
        modes = m if m.ndim == 1 else m[:, :count]
        self._append(times[:count], nearest.x[:, :count], piece.z[:, :count], modes)
        if count < len(times):
            states = piece.x[:, count], nearest.x[:, count], moved[:, count]
            raise off_constraints(self.compiled, float(times[count]), *states, self.most_moved)
        return Piece(nearest.x, piece.z, piece.counters)

    def extend(
        self,
        times: Vector,
        x: Vector,
        m: Vector,
        instants: Sequence[float],
        happenings: Sequence[Happening],
        counters: dict[str, float],
    ) -> None:
        """Add rows of many segments of a model without algebraic variables or constraints, and their events."""
        self.boundaries.add(instants, happenings)
        self.segments += len(instants)
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
        """Remove all rows after this one, and all events from its time on; this row becomes visible."""
        part = bisect_right(self._starts, row) - 1
        keep = row - self._starts[part] + 1
        for rows_ in (self._starts, self._times, self._x, self._z, self._m):
            del rows_[part + 1 :]
        self._times[part] = self._times[part][:keep]
        for columns in (self._x, self._z, self._m):
            columns[part] = columns[part][:, :keep]
        self.count = row + 1
        self.boundaries.cut(self.time)
        self._hidden = [k for k in self._hidden if k < row]

    def since(self, row: int, which: NDArray[np.int64] | slice = slice(None)) -> Result:
        """The result of the rows from `row` on, or of those among them that `which` selects."""
        chosen = np.arange(row, self.count)[which]
        owner = np.searchsorted(self._starts, chosen, side="right") - 1
        selected = [(k, chosen[owner == k] - self._starts[k]) for k in np.unique(owner).tolist()]
        x, z, m = ([columns[k][:, rows_] for k, rows_ in selected] for columns in (self._x, self._z, self._m))
        times = np.concatenate([self._times[k][rows_] for k, rows_ in selected])
        return _table(self, (times, States(x, None), joined(z), joined(m)))

    def times(self, first: int) -> Vector:
        """Times of all rows from `first` on [s]."""
        part = bisect_right(self._starts, first) - 1
        return np.concatenate(self._times[part:])[first - self._starts[part] :]

    def hide(self, row: int, boundary: int | None = None) -> None:
        """Leave a row out of the result, and remove a boundary without an event."""
        self._hidden.append(row)
        if boundary is not None:
            self.boundaries.remove(boundary)

    def hide_at(self, instants: Vector, shown: Vector) -> None:
        """Leave rows at these instants out of the result, except those in `shown`, at events, and at both ends."""
        if not self.count:
            return
        times = np.concatenate(self._times)
        events = [t for t, causes, changed in self.boundaries if changed or any(c.text for c in causes)]
        hidden = np.setdiff1d(instants, np.concatenate([shown, events, times[[0, -1]]]))
        self._hidden += np.flatnonzero(np.isin(times, hidden)).tolist()

    def explain(self, boundary: int, causes: tuple[Cause, ...]) -> None:
        """Add causes to the event at a boundary."""
        earlier, changed = self.boundaries.happenings[boundary]
        self.boundaries.happenings[boundary] = (*causes, *earlier), changed

    def shown(self) -> tuple[Vector, States, Vector, Vector]:
        """The rows of the result: times, states, algebraic variables, modes."""
        times, z, m = np.concatenate(self._times), joined(self._z), joined(self._m)
        if not self._hidden:
            return times, States(self._x, None), z, m
        keep = np.ones(len(times), dtype=bool)
        keep[self._hidden] = False
        return times[keep], States(self._x, keep), z[:, keep], m[:, keep]

    def rows(self, first: int = 0) -> tuple[Vector, Vector, Vector, Vector]:
        """(times, x, z, modes) of all rows from `first` on, with a column for each; they must not be modified."""
        if first == 0:
            self._join()
        part = bisect_right(self._starts, first) - 1
        skip = first - self._starts[part]
        x, z, m = (joined(columns[part:])[:, skip:] for columns in (self._x, self._z, self._m))
        return self.times(first), x, z, m

    def _join(self) -> None:
        """Join all rows to one part, as the end of a run needs them several times."""
        if len(self._starts) > 1:
            self._x, self._z, self._m = ([joined(parts)] for parts in (self._x, self._z, self._m))
            self._times, self._starts = [np.concatenate(self._times)], [0]

    def magnitudes(self, n: int) -> Vector:
        """The largest magnitude of each of the first n states, without an array of all rows."""
        return np.asarray(np.maximum.reduce([np.maximum(*_extremes(x[:n])) for x in self._x]))

    def before(self, t: float) -> int:
        """Index of the last row that is not after `t`."""
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

        The stabilisation rate is zero here, because the points lie on the constraints: in a very short run the rate is
        large, and its square would turn rounding errors into forces.
        """
        p = self.p.copy()
        if self.compiled.solution.structure.rate is not None:
            p[-1] = 0.0
        first = len(m) - len(self.compiled.state_events.relations)
        is_blended = bool(((m[first:] > 0.0) & (m[first:] < 1.0)).any())
        if columns is None:
            all_states = x.whole if isinstance(x, States) else x
            arguments = times[:, None], all_states.T, z.T, self.u, p, m.T
            if is_blended:
                return rows(self.compiled.blended_observe, arguments)
            if len(times) < _FEWEST_ROWS or self.compiled.observe.n_instructions() > MOST_OPERATIONS:
                return rows(self.compiled.observe, arguments)
            return functions_of(self.compiled).observe.many(*arguments)
        states, n = (x, x.count) if isinstance(x, States) else (x.T, len(x))
        indices, values = np.array(columns, dtype=np.int64), np.empty((len(times), len(columns)))
        is_state, is_other = indices < n, indices >= n + len(z)
        values[:, is_state] = states[..., indices[is_state]]
        values[:, ~is_state & ~is_other] = z.T[:, indices[~is_state & ~is_other] - n]
        if is_other.any():
            function = functions_of(self.compiled).observing(tuple(indices[is_other].tolist()), is_blended)
            values[:, is_other] = function.many(times[:, None], states, z.T, self.u, p, m.T)
        return values


def _extremes(x: Vector) -> tuple[Vector, Vector]:
    """The largest value of each row of x, and of each row of -x; shapes (n,).

    Row by row if rows are long: solvers return one instant after the other, and NumPy goes through these.
    """
    if x.shape[1] > len(x):
        return np.array([row.max() for row in x]), np.array([-row.min() for row in x])
    return x.max(axis=1), -x.min(axis=1)


def make_result(
    recorder: Recorder,
    events: tuple[Event, ...] | EventLog,
    stats: dict[str, object],
    dense: Callable[[Vector], Vector] | None,
) -> Result:
    """The result of the recorded rows; `dense` gives all values at other times."""
    return _table(recorder, recorder.shown(), events=events, stats=stats, dense=dense)


def _table(recorder: Recorder, recorded: tuple[Vector, Vector | States, Vector, Vector], **more: Any) -> Result:
    """The result of some rows, with the other attributes of a result in `more`."""
    return Result(
        model=recorder.compiled.name,
        time=recorded[0],
        trajectories=lambda: recorder.observe(*recorded),
        signals=Described(recorder.compiled, recorder.p),
        some=lambda columns: recorder.observe(*recorded, columns),
        **more,
    )


class Described(Mapping[str, Signal]):
    """The signals of a run by name, created on demand, as creating all of them takes longer than a short run."""

    def __init__(self, compiled: CompiledModel, p: Vector) -> None:
        self._compiled, self._p = compiled, p

    @cached_property
    def _signals(self) -> dict[str, Signal]:
        return signals(self._compiled, self._p)

    @cached_property
    def _variables_only(self) -> _Variables:
        """Signals of variables, which are the same for all runs; those of constant ones have no values."""
        return described(self._compiled)

    def __getitem__(self, name: str) -> Signal:
        signal = self._variables_only.get(name)
        if signal is not None and signal.column is not None:
            return signal
        if "_signals" in self.__dict__:
            return self._signals[name]
        # only this one: a scene reads a few at each check of its contacts, and creating all takes as long as the run
        # between two checks
        if signal is not None:
            return replace(signal, value=float(self._constants[self._variables_only.constant(self._compiled, name)]))
        parameter, entry = self._variables_only.parameters[name]
        (value,) = compiled_parameters(self._compiled, parameter.nodes[entry : entry + 1], self._p)
        return Signal(name, parameter.declaration.unit, parameter.declaration.doc, value=value, parameter=True)

    @cached_property
    def _constants(self) -> Vector:
        """Values of the constant variables, in the order of the model's `constant_nodes`."""
        return functions_of(self._compiled).constants(self._p)[0]

    def __contains__(self, name: object) -> bool:
        return name in self._variables_only or name in self._variables_only.parameters

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    def __len__(self) -> int:
        return len(self._signals)


def signals(compiled: CompiledModel, p: Vector) -> dict[str, Signal]:
    """The signals of all variables and parameters of the model, by path."""
    variables = described(compiled)
    result = {name: variables[name] for name in variables}
    constants = dict(zip(compiled.constant_nodes, functions_of(compiled).constants(p)[0].tolist(), strict=True))
    for name, signal in result.items():
        if signal.column is None:
            result[name] = replace(signal, value=constants[variables.node(name)])
    for parameter in compiled.flat.parameters:
        values = compiled_parameters(compiled, parameter.nodes, p)
        for suffix, value in zip(suffixes(parameter.declaration.shape), values, strict=True):
            name = parameter.path + suffix
            d = parameter.declaration
            result[name] = Signal(name, d.unit, d.doc, value=value, parameter=True)
    return result


@once_per_owner
def described(compiled: CompiledModel) -> _Variables:
    """The signals of the variables of a model, created once: a sweep would create thousands of them in each run."""
    return _Variables(compiled)


class _Variables(Mapping[str, Signal]):
    """Signals of all variables, created one by one; those of constant variables have no values.

    A large model has a hundred thousand, of which only a few are read. At first only the position of each name is
    stored.
    """

    def __init__(self, compiled: CompiledModel) -> None:
        reduced = compiled.solution.structure.reduced
        self._image, self._nodes, self._variables = reduced.image, reduced.pool.nodes, reduced.flat.variables
        self._column = {node: k for k, node in enumerate(compiled.columns)}
        self._position: dict[str, int] = {}  # entries counted over all variables
        self._first_position: list[int] = []
        left_out, position = reduced.left_out, 0
        self._parameters, self._constants = reduced.flat.parameters, dict[int, int]()
        for variable in self._variables:
            self._first_position.append(position)
            for k, suffix in enumerate(suffixes(variable.declaration.shape)):
                if variable.first + k not in left_out:
                    self._position[variable.path + suffix] = position + k
            position += variable.size

    def __iter__(self) -> Iterator[str]:
        return iter(self._position)

    def __len__(self) -> int:
        return len(self._position)

    def __contains__(self, name: object) -> bool:
        return name in self._position

    def __getitem__(self, name: str) -> Signal:
        d, node = self._entry(name)
        if node in self._column:
            return Signal(name, d.unit, d.doc, column=self._column[node])
        op, *operands = self._nodes[node]
        if op == "neg" and operands[0] in self._column:
            return Signal(name, d.unit, d.doc, column=self._column[operands[0]], sign=-1)
        return Signal(name, d.unit, d.doc)

    @cached_property
    def parameters(self) -> dict[str, tuple[FlatParameter, int]]:
        """The parameter and the index of the entry, for the name of each entry of a parameter."""
        return {
            parameter.path + suffix: (parameter, k)
            for parameter in self._parameters
            for k, suffix in enumerate(suffixes(parameter.declaration.shape))
        }

    def constant(self, compiled: CompiledModel, name: str) -> int:
        """Index of a constant variable among the `constant_nodes` of the model."""
        if not self._constants:
            self._constants = {node: k for k, node in enumerate(compiled.constant_nodes)}
        return self._constants[self.node(name)]

    def node(self, name: str) -> int:
        """The node of a variable in the reduced pool."""
        return self._entry(name)[1]

    def _entry(self, name: str) -> tuple[Declaration, int]:
        position = self._position[name]
        number = bisect_right(self._first_position, position) - 1
        variable = self._variables[number]
        return variable.declaration, self._image[variable.first + position - self._first_position[number]]


def compiled_parameters(compiled: CompiledModel, nodes: tuple[int, ...], p: Vector) -> list[float]:
    """Values [SI] of expressions of the flat pool that depend only on the parameters `p`."""
    pool = compiled.flat.pool
    simple = [pool.nodes[n] for n in nodes]
    if all(s[0] == "par" for s in simple):
        return [float(p[s[1]]) for s in simple]

    values_of = values(pool, nodes, {"par": p.__getitem__, "time": lambda _: 0.0})
    return [float(values_of[n]) for n in nodes]


def joined(parts: list[Vector]) -> Vector:
    """Join parts of shape (k, rows of the part); columns stay contiguous in memory, as solvers return them."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate([part.T for part in parts]).T


class States:
    """States at n instants, indexed like an array of shape (n, nx), in parts of shape (nx, rows of the part).

    A signal of a model with 10 000 states needs two or three of them at 500 instants. Joining all states to one array
    would take as long as their integration.
    """

    def __init__(self, parts: list[Vector], shown: NDArray[np.bool_] | None) -> None:
        """Of all rows, or of those selected by `shown`."""
        self._parts, self._shown = list(parts), shown
        self.count = len(parts[0])
        """Number of states."""

    @cached_property
    def whole(self) -> Vector:
        """All states, shape (nx, n)."""
        states = joined(self._parts)
        return states if self._shown is None else states[:, self._shown]

    def __getitem__(self, key: tuple[EllipsisType, NDArray[np.int64]]) -> Vector:
        """Some states at all instants: `states[..., indices]`, shape (n, len(indices))."""
        values = np.concatenate([part[key[1]].T for part in self._parts])
        return values if self._shown is None else values[self._shown]


IntegrateFrom = Callable[[int, Vector], tuple[Piece, Vector]]
"""`(row, times) -> (piece, modes)`: integrates the solution again from a recorded row."""
_log = logging.getLogger(__name__)


class Dense:
    """Values at any times, integrated again from the recorded row before them, once for all times between two rows.

    Rows are nan where the solver fails, for example if the time is too close to the row before.
    """

    def __init__(self, recorder: Recorder, again: IntegrateFrom, equations: Callable[[float], CompiledModel]) -> None:
        self._recorder, self._integrate_from, self._equations = recorder, again, equations
        # signals of a result are requested one by one, usually at the same times
        self._last: tuple[Vector, Vector] | None = None

    def __call__(self, requested: Vector) -> Vector:
        """All trajectories at `requested` [s], shape (times, columns)."""
        if self._last is not None and np.array_equal(self._last[0], requested):
            return self._last[1]
        recorder = self._recorder
        times, position = np.unique(requested, return_inverse=True)
        values = np.full((len(times), len(recorder.compiled.columns)), np.nan)
        before = np.array([recorder.before(t) for t in times])
        for k in np.unique(before):
            inside = np.flatnonzero(before == k)
            for group in (inside, *inside[:, None]):
                missing = group[np.isnan(values[group]).all(axis=1)]
                if missing.size:
                    try:
                        values[missing] = self._between(int(k), times[missing])
                    except RuntimeError as error:
                        _log.debug("no values at %s s: %s", times[missing], error)
        self._last = requested.copy(), values[position]
        return self._last[1]

    def held(self, t: float) -> tuple[CompiledModel, Vector] | None:
        """(Equations, modes) just after `t` if relations are held at their switch there (a sliding mode), else None."""
        recorder = self._recorder
        k = recorder.before(t)
        here, _, _, m = recorder.point(k)
        if k + 1 < recorder.count:
            later, _, _, m_later = recorder.point(k + 1)
            m = m_later if later > here else m  # the first row of a stretch has the modes before it slides
        held = m[len(m) - len(recorder.compiled.state_events.relations) :]
        return (self._equations(t), m) if ((held > 0.0) & (held < 1.0)).any() else None

    def _between(self, k: int, times: Vector) -> Vector:
        """Rows between row k and the next one, shape (times, columns)."""
        recorder = self._recorder
        piece, m = self._integrate_from(k, times)
        on_constraints = projected(recorder.compiled, times, piece.x, piece.z, recorder.u, recorder.p, m)
        modes = m if m.ndim == 2 else np.repeat(m[:, None], len(times), axis=1)
        return np.asarray(recorder.observe(times, on_constraints, piece.z, modes))
