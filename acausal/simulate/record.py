"""What a run has computed so far, and the result made of it."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acausal.flatten.flat import suffixes
from acausal.lower.compiled import CompiledModel
from acausal.result import Event, Result, Signal
from acausal.simulate.direct import rows
from acausal.simulate.guards import Cause
from acausal.simulate.kept import kept
from acausal.simulate.project import projection
from acausal.simulate.solvers.base import Piece

Vector = NDArray[np.float64]


class Recorder:
    """Rows of time, states, algebraic variables and modes, in order; observed variables are computed at the end."""

    def __init__(self, compiled: CompiledModel, p: Vector, u: Vector) -> None:
        self.compiled = compiled
        self.p, self.u = p, u
        self.counters: dict[str, float] = {}
        self.boundaries: list[tuple[float, tuple[Cause, ...], tuple[str, ...]]] = []
        self.segments = 0
        self.count = 0  # rows so far
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

    def withdraw(self) -> None:
        """Take back the start of a segment in which nothing has followed."""
        self.segments -= 1
        self.count -= 1
        if self.count:
            del self.boundaries[-1]
        for part in (self._x, self._z, self._m):
            part[-1] = part[-1][:, :-1]
        self._times[-1] = self._times[-1][:-1]

    def add(self, times: Vector, piece: Piece, m: Vector) -> Piece:
        """Rows from a solver, projected onto the constraints; returns them as they are recorded."""
        x, drift = projection(self.compiled, times, piece.x, piece.z, self.u, self.p, m)
        self._append(times, x, piece.z, m)
        if drift is not None:
            self.counters["drift"] = max(self.counters.get("drift", 0.0), drift)
        self._count(piece.counters)
        return Piece(x, piece.z, piece.counters)

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
        self._count(counters)

    def _append(self, times: Vector, x: Vector, z: Vector, m: Vector) -> None:
        if not len(times):
            return
        self._starts.append(self.count)
        self.count += len(times)
        self._times.append(times)
        self._x.append(x)
        self._z.append(z)
        self._m.append(m if m.ndim == 2 else np.tile(m[:, None], (1, len(times))))

    def hide(self, row: int, boundary: int | None = None) -> None:
        """Leave a row out of the result, and a boundary at which nothing has happened."""
        self._hidden.append(row)
        if boundary is not None:
            del self.boundaries[boundary]

    def explain(self, boundary: int, causes: tuple[Cause, ...]) -> None:
        """Further causes of what happened at a boundary."""
        t, known, changed = self.boundaries[boundary]
        self.boundaries[boundary] = t, (*causes, *known), changed

    def shown(self) -> tuple[Vector, Vector, Vector, Vector]:
        """The rows of the result, as `rows` gives them."""
        times, *columns = self.rows()
        if not self._hidden:
            return times, *columns  # type: ignore[return-value]
        keep = np.ones(len(times), dtype=bool)
        keep[self._hidden] = False
        return times[keep], *(a[:, keep] for a in columns)  # type: ignore[return-value]

    def _count(self, counters: dict[str, float]) -> None:
        for name, count in counters.items():
            self.counters[name] = self.counters.get(name, 0.0) + count

    def rows(self) -> tuple[Vector, Vector, Vector, Vector]:
        """(times, x, z, modes) of all rows; columns are instants."""
        return np.concatenate(self._times), *(np.hstack(a) for a in (self._x, self._z, self._m))  # type: ignore[return-value]

    def before(self, t: float) -> int:
        """The last row not after `t`."""
        times = np.concatenate(self._times)
        return int(np.searchsorted(times, t, side="right")) - 1

    def point(self, k: int) -> tuple[float, Vector, Vector, Vector]:
        """Time, states, algebraic variables and modes of one row."""
        part = bisect_right(self._starts, k) - 1
        j = k - self._starts[part]
        return float(self._times[part][j]), self._x[part][:, j], self._z[part][:, j], self._m[part][:, j]

    def observe(self, times: Vector, x: Vector, z: Vector, m: Vector) -> Vector:
        """All trajectories, shape (rows, columns).

        The points lie on the constraints, so nothing is stabilised here: over a very short run the square of the rate
        would make forces of rounding errors.
        """
        p = self.p.copy()
        if self.compiled.solution.structure.rate is not None:
            p[-1] = 0.0
        first = len(m) - len(self.compiled.state_events.relations)
        slides = bool(((m[first:] > 0.0) & (m[first:] < 1.0)).any())
        observe = self.compiled.blended_observe if slides else self.compiled.observe
        return rows(observe, (times[:, None], x.T, z.T, self.u, p, m.T))


def make_result(
    recorder: Recorder,
    events: tuple[Event, ...],
    stats: dict[str, object],
    dense: Callable[[float], Vector],
) -> Result:
    """The result of what was recorded."""
    times, x, z, m = recorder.shown()
    return Result(
        model=recorder.compiled.name,
        time=times,
        trajectories=lambda: recorder.observe(times, x, z, m),
        signals=Described(recorder.compiled, recorder.p),
        events=events,
        stats=stats,
        dense=dense,
    )


class Described(Mapping[str, Signal]):
    """The signals of a run by name, made when the first of them is asked for: that takes longer than a short run."""

    def __init__(self, compiled: CompiledModel, p: Vector) -> None:
        self._compiled, self._p = compiled, p

    @cached_property
    def _made(self) -> dict[str, Signal]:
        return signals(self._compiled, self._p)

    def __getitem__(self, name: str) -> Signal:
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._made)

    def __len__(self) -> int:
        return len(self._made)


def signals(compiled: CompiledModel, p: Vector) -> dict[str, Signal]:
    """Where every variable and parameter of the model is found, by path."""
    if compiled not in _described:
        _described[compiled] = _variables(compiled)
    moving, fixed = _described[compiled]
    found = dict(moving)
    constants = dict(zip(compiled.constant_nodes, kept(compiled).constants(p)[0].tolist(), strict=True))
    for name, node in fixed:
        found[name] = Signal(name, found[name].unit, found[name].doc, value=constants[node])
    for parameter in compiled.flat.parameters:
        values = compiled_parameters(compiled, parameter.nodes, p)
        for suffix, value in zip(suffixes(parameter.declaration.shape), values, strict=True):
            name = parameter.path + suffix
            d = parameter.declaration
            found[name] = Signal(name, d.unit, d.doc, value=value, parameter=True)
    return found


_Variables = tuple[dict[str, Signal], list[tuple[str, int]]]
# The same for every run of a compiled model; a sweep would make thousands of signals anew for each.
_described: WeakKeyDictionary[CompiledModel, _Variables] = WeakKeyDictionary()


def _variables(compiled: CompiledModel) -> _Variables:
    """Signals of all variables, and (name, node) of those that are constant, whose values are still missing."""
    reduced = compiled.solution.structure.reduced
    nodes = reduced.pool.nodes
    column = {node: k for k, node in enumerate(compiled.columns)}
    found: dict[str, Signal] = {}
    fixed: list[tuple[str, int]] = []
    for variable in reduced.flat.variables:
        d = variable.declaration
        for k, suffix in enumerate(suffixes(d.shape)):
            name, node = variable.path + suffix, reduced.image[variable.first + k]
            if variable.first + k in reduced.left_out:
                continue
            if node in column:
                found[name] = Signal(name, d.unit, d.doc, column=column[node])
            elif nodes[node][0] == "neg" and nodes[node][1] in column:
                found[name] = Signal(name, d.unit, d.doc, column=column[nodes[node][1]], sign=-1)
            else:
                found[name] = Signal(name, d.unit, d.doc)
                fixed.append((name, node))
    return found, fixed


def compiled_parameters(compiled: CompiledModel, nodes: tuple[int, ...], p: Vector) -> list[float]:
    """Values of parameter expressions of the flat pool."""
    pool = compiled.flat.pool
    simple = [pool.nodes[n] for n in nodes]
    if all(s[0] == "par" for s in simple):
        return [float(p[s[1]]) for s in simple]
    from acausal.lower.evaluate import values

    found = values(pool, nodes, {"par": p.__getitem__, "time": lambda _: 0.0})
    return [float(found[n]) for n in nodes]
