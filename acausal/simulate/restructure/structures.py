"""Equations for each structure that runs of a model have had: a run that comes to one again finds it compiled.

A model is a recipe that does not change, and a choice says which structure it has (`Choice.structure`), so the two and
the values of parameters decide the equations. Of another model with equal components nothing is known here: its
equations are flattened, and recalled as those of any model are (`acausal.lower.cache.cache`). Where they turn out to
be the same to the last value and place, the compiled model of the first serves both, with all that was made for its
runs. Without flattening nobody would know: classes may read what is outside of them.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acausal.flatten.flat import FlatSystem, suffixes
from acausal.language.choices import Choice
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.lower.lowered import Recipe
from acausal.recent import Recent
from acausal.result.result import Result
from acausal.result.signals import Signal

_MOST, _MOST_NODES = 32, 1_000_000


def _nodes(entry: tuple[Component, CompiledModel]) -> int:
    return len(entry[1].solution.structure.reduced.pool.nodes)


# The models are held, so that no other can be taken for them.
_structures: Recent[tuple[Component, CompiledModel]] = Recent(_MOST, _nodes, _MOST_NODES)


def structure(
    recipe: Recipe, parameters: Mapping[str, object], choices: Mapping[str, Choice]
) -> tuple[CompiledModel, Mapping[str, float]]:
    """The compiled model for these choices, and how long each stage took, if it had to be compiled [s].

    `parameters` are those that are in it, by their names there.
    """
    key = _key(recipe, parameters, choices)
    known = None if key is None else _structures.get(key)
    if known is not None:
        return known[1], {}
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
        compiled = _equal(key, compiled) or compiled
        _structures.put(key, (recipe.model, compiled))
    return compiled, timings


def _equal(key: tuple[Hashable, ...], compiled: CompiledModel) -> CompiledModel | None:
    """What is known under another model, and is the same as this."""
    known = (own for other, (_, own) in tuple(_structures.entries.items()) if other[1:] == key[1:])  # type: ignore[index]
    return next((own for own in known if is_same(own.flat, compiled.flat)), None)


def is_same(one: FlatSystem, other: FlatSystem) -> bool:
    """Whether two systems have the same equations, values and places.

    The pool of a system that was recalled is that of the first: then only values and places can differ.
    """
    return one.pool is other.pool and all(_told(a) == _told(b) for a, b in zip(_rest(one), _rest(other), strict=True))


def _rest(flat: FlatSystem) -> Iterator[object]:
    """What a recalled system does not share with the first."""
    return (getattr(flat, f.name) for f in fields(flat) if f.name != "pool")


def _told(value: object) -> object:
    """What a field of a flat system says; the written form of a statement follows from its place."""
    if isinstance(value, Mapping):
        return [(k, _told(v)) for k, v in value.items()]
    named = getattr(value, "_asdict", None) if isinstance(value, tuple) else None
    if named is not None:
        return [_told(v) for name, v in named().items() if name != "source"]
    return [_told(v) for v in value] if isinstance(value, tuple | list) else value


def _key(
    recipe: Recipe, parameters: Mapping[str, object], choices: Mapping[str, Choice]
) -> tuple[Hashable, ...] | None:
    """The key of a structure: all that determines its equations; None where that is uncertain."""
    if not recipe.cache or not all(type(v) in (int, float, str) for v in parameters.values()):
        return None
    wishes = recipe.formulation, recipe.freeze, recipe.quasi_static, tuple(parameters.items())
    return id(recipe.model), wishes, tuple((path, c.structure()) for path, c in choices.items())


Array = NDArray[np.float64]
Names = Mapping[str, Sequence[str]]


def named(path: str, name: str) -> str:
    """A name within a component, from outside."""
    return f"{path}.{name}" if path else name


@dataclass(frozen=True, eq=False)
class _Places:
    """Where the entries of a watch are: those that move, by columns of a result; and names of the others.

    Attributes
    ----------
    columns
        Columns of the result, each once.
    moving, at, signs
        Of each entry that moves: its place, its column among those, and the sign with which it is there.
    others
        Places and names of the others.
    """

    columns: list[int]
    moving: NDArray[np.int64]
    at: NDArray[np.int64]
    signs: Array
    others: list[tuple[int, str]]

    @classmethod
    def of(cls, entries: Sequence[str], signals: Sequence[Signal]) -> _Places:
        """Of entries with these signals."""
        moving = [(k, s.column, s.sign) for k, s in enumerate(signals) if s.column is not None]
        columns = list(dict.fromkeys(column for _, column, _ in moving))
        place = {column: k for k, column in enumerate(columns)}
        there, at = (np.array(v, dtype=np.int64) for v in ([k for k, *_ in moving], [place[c] for _, c, _ in moving]))
        others = [(k, entries[k]) for k, s in enumerate(signals) if s.column is None]
        return cls(columns, there, at, np.array([float(sign) for *_, sign in moving]), others)


@dataclass(frozen=True, eq=False)
class Watch:
    """Signals by path of a component and name within it, with their entries in row-major order."""

    names: Mapping[str, Mapping[str, tuple[tuple[int, ...], tuple[str, ...]]]]
    _known: list[_Places] = field(default_factory=list)
    """Where they are, once it was asked for: the same in all results of a compiled model."""

    @classmethod
    def of(cls, compiled: CompiledModel, names: Names) -> Watch:
        """For runs of a compiled model; kept for the next."""
        made = _MADE.setdefault(compiled, {})
        key = tuple((path, *own) for path, own in names.items())
        if key not in made:
            shapes = {v.path: v.declaration.shape for v in compiled.flat.variables}
            found: dict[str, dict[str, tuple[tuple[int, ...], tuple[str, ...]]]] = {}
            for path, own in names.items():
                found[path] = {}
                for name in own:
                    whole = named(path, name)
                    shape = shapes.get(whole, ())
                    found[path][name] = shape, tuple(whole + suffix for suffix in suffixes(shape))
            made[key] = cls(found)
        return made[key]

    def read(self, result: Result) -> dict[str, dict[str, Array]]:
        """Values by path and name, shape (n, *shape)."""
        places, constants = self._places(result)
        values = result.matrix[:, places.columns] if result.some is None else result.some(places.columns)
        whole = np.empty((len(result.time), len(places.moving) + len(constants)))
        whole[:, places.moving] = values[:, places.at] * places.signs + 0.0
        for (place, _), value in zip(places.others, constants, strict=True):
            whole[:, place] = value
        found: dict[str, dict[str, Array]] = {}
        at = 0
        for path, own in self.names.items():
            found[path] = {}
            for name, (shape, elements) in own.items():
                found[path][name] = whole[:, at : at + len(elements)].reshape(-1, *shape)
                at += len(elements)
        return found

    def _places(self, result: Result) -> tuple[_Places, list[float]]:
        """Where the entries are, and the values of those that do not move, which each result has its own of."""
        for known in self._known:
            others = [result.signals[name] for _, name in known.others]
            if all(s.column is None for s in others):
                return known, [s.value for s in others]
        entries = [e for own in self.names.values() for _, elements in own.values() for e in elements]
        signals = [result.signals[e] for e in entries]
        places = _Places.of(entries, signals)
        self._known[:] = [places]
        return places, [signals[k].value for k, _ in places.others]


_MADE: WeakKeyDictionary[CompiledModel, dict[tuple[tuple[str, ...], ...], Watch]] = WeakKeyDictionary()
