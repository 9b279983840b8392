"""Cache of the compiled models for each structure, for runs that return to an earlier structure.

A model is a recipe that does not change, and a choice says which structure it has (`Choice.structure`), so that these
two and the values of parameters determine the equations. For a different model with equal components this key says
nothing: its equations are flattened, and looked up like those of any model (`acausal.lower.cache.cache`). If they agree
with those of a cached model in every value and source location, the cached model serves both, with everything that was
built for its runs. Flattening is necessary, because classes may read data from outside themselves.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from acausal.flatten.flat import FlatSystem, suffixes
from acausal.language.choices import Choice
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.lower.lowered import Recipe
from acausal.recent import Recent, once_per_owner
from acausal.result.result import Result
from acausal.result.signals import Signal

_MOST, _MOST_NODES = 32, 1_000_000


def _nodes(entry: tuple[Component, CompiledModel]) -> int:
    return len(entry[1].solution.structure.reduced.pool.nodes)


# The models are kept alive, so that no other model can get the same id.
_structures: Recent[tuple[Component, CompiledModel]] = Recent(_MOST, _nodes, _MOST_NODES)


def structure(
    recipe: Recipe, parameters: Mapping[str, object], choices: Mapping[str, Choice]
) -> tuple[CompiledModel, Mapping[str, float]]:
    """Return the compiled model for these choices, and the duration of each stage if it had to be compiled [s].

    `parameters` are those of this structure, by their names in it.
    """
    key = _key(recipe, parameters, choices)
    cached = None if key is None else _structures.get(key)
    if cached is not None:
        return cached[1], {}
    compiled = compile(
        recipe.model,
        parameters=parameters,
        formulation=recipe.formulation,
        freeze=recipe.freeze,
        quasi_static=recipe.quasi_static,
        cache=recipe.cache,
        choices=choices,
    )
    timings = dict(compiled.timings)
    if key is not None:
        compiled = _same_as(key, compiled) or compiled
        _structures.put(key, (recipe.model, compiled))
    return compiled, timings


def _same_as(key: tuple[Hashable, ...], compiled: CompiledModel) -> CompiledModel | None:
    """A cached model of another component that agrees with this one; None if there is none."""
    candidates = (cached for other, (_, cached) in tuple(_structures.entries.items()) if other[1:] == key[1:])  # type: ignore[index]
    return next((cached for cached in candidates if is_same(cached.flat, compiled.flat)), None)


def is_same(one: FlatSystem, other: FlatSystem) -> bool:
    """Whether two systems have the same equations, values and source locations.

    A system from the cache shares the pool of the first one; then only values and locations can differ.
    """
    return one.pool is other.pool and all(
        _contents(a) == _contents(b) for a, b in zip(_own_fields(one), _own_fields(other), strict=True)
    )


def _own_fields(flat: FlatSystem) -> Iterator[object]:
    """The fields that a system from the cache does not share with the first one."""
    return (getattr(flat, f.name) for f in fields(flat) if f.name != "pool")


def _contents(value: object) -> object:
    """The contents of a field of a flat system, without the text of statements, which their location determines."""
    if isinstance(value, Mapping):
        return [(k, _contents(v)) for k, v in value.items()]
    named = getattr(value, "_asdict", None) if isinstance(value, tuple) else None
    if named is not None:
        return [_contents(v) for name, v in named().items() if name != "source"]
    return [_contents(v) for v in value] if isinstance(value, tuple | list) else value


def _key(
    recipe: Recipe, parameters: Mapping[str, object], choices: Mapping[str, Choice]
) -> tuple[Hashable, ...] | None:
    """The key of a structure: everything that determines its equations; None where that is uncertain."""
    if not recipe.cache or not all(type(v) in (int, float, str) for v in parameters.values()):
        return None
    compile_options = recipe.formulation, recipe.freeze, recipe.quasi_static, tuple(parameters.items())
    return id(recipe.model), compile_options, tuple((path, c.structure()) for path, c in choices.items())


Array = NDArray[np.float64]
Names = Mapping[str, Sequence[str]]


def named(path: str, name: str) -> str:
    """The full name of a variable of a component."""
    return f"{path}.{name}" if path else name


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where a result holds the entries of a watch: columns for those that vary, and names for the constant ones.

    Attributes
    ----------
    columns
        Columns of the result, each once.
    moving, at, signs
        For each varying entry: its position in the watch, the index of its column in `columns`, and its sign.
    others
        Positions and names of the constant entries.
    """

    columns: list[int]
    moving: NDArray[np.int64]
    at: NDArray[np.int64]
    signs: Array
    others: list[tuple[int, str]]

    @classmethod
    def of(cls, entries: Sequence[str], signals: Sequence[Signal]) -> _Layout:
        """The layout of entries with these signals."""
        moving = [(k, s.column, s.sign) for k, s in enumerate(signals) if s.column is not None]
        columns = list(dict.fromkeys(column for _, column, _ in moving))
        place = {column: k for k, column in enumerate(columns)}
        positions, at = (
            np.array(v, dtype=np.int64) for v in ([k for k, *_ in moving], [place[c] for _, c, _ in moving])
        )
        others = [(k, entries[k]) for k, s in enumerate(signals) if s.column is None]
        return cls(columns, positions, at, np.array([float(sign) for *_, sign in moving]), others)


@dataclass(frozen=True, eq=False)
class Watch:
    """Signals by path of a component and name within it, with their entries in row-major order."""

    names: Mapping[str, Mapping[str, tuple[tuple[int, ...], tuple[str, ...]]]]
    _layouts: list[_Layout] = field(default_factory=list)
    """The layout found at the first reading, which is the same in all results of a compiled model."""

    @classmethod
    def of(cls, compiled: CompiledModel, names: Names) -> Watch:
        """The watch for runs of a compiled model, cached for later runs."""
        return _watch(compiled, tuple((path, *own) for path, own in names.items()))

    def read(self, result: Result) -> dict[str, dict[str, Array]]:
        """Values by path and name, shape (n, *shape)."""
        layout, constants = self._layout(result)
        values = result.matrix[:, layout.columns] if result.some is None else result.some(layout.columns)
        whole = np.empty((len(result.time), len(layout.moving) + len(constants)))
        whole[:, layout.moving] = values[:, layout.at] * layout.signs + 0.0
        for (position, _), value in zip(layout.others, constants, strict=True):
            whole[:, position] = value
        found: dict[str, dict[str, Array]] = {}
        at = 0
        for path, own in self.names.items():
            found[path] = {}
            for name, (shape, elements) in own.items():
                found[path][name] = whole[:, at : at + len(elements)].reshape(-1, *shape)
                at += len(elements)
        return found

    def _layout(self, result: Result) -> tuple[_Layout, list[float]]:
        """The layout of the entries, and the values of the constant ones, which differ from result to result."""
        for layout in self._layouts:
            others = [result.signals[name] for _, name in layout.others]
            if all(s.column is None for s in others):
                return layout, [s.value for s in others]
        entries = [e for own in self.names.values() for _, elements in own.values() for e in elements]
        signals = [result.signals[e] for e in entries]
        places = _Layout.of(entries, signals)
        self._layouts[:] = [places]
        return places, [signals[k].value for k, _ in places.others]


@once_per_owner
def _watch(compiled: CompiledModel, paths: tuple[tuple[str, ...], ...]) -> Watch:
    """The watch for signals of these components; each path is followed by names within it."""
    shapes = {v.path: v.declaration.shape for v in compiled.flat.variables}
    found: dict[str, dict[str, tuple[tuple[int, ...], tuple[str, ...]]]] = {}
    for path, *own in paths:
        found[path] = {}
        for name in own:
            whole = named(path, name)
            shape = shapes.get(whole, ())
            found[path][name] = shape, tuple(whole + suffix for suffix in suffixes(shape))
    return Watch(found)
