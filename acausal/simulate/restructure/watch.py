"""Signals that the choices of a structure look at, read at once: thousands by name would take longer than the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acausal.flatten.flat import suffixes
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result

Array = NDArray[np.float64]
Names = Mapping[str, Sequence[str]]


def named(path: str, name: str) -> str:
    """A name within a component, from outside."""
    return f"{path}.{name}" if path else name


@dataclass(frozen=True, eq=False)
class Watch:
    """Signals by path of a component and name within it, with their entries in row-major order."""

    names: Mapping[str, Mapping[str, tuple[tuple[int, ...], tuple[str, ...]]]]

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
        entries = [e for own in self.names.values() for _, elements in own.values() for e in elements]
        signals = [result.signals[e] for e in entries]
        columns = list(dict.fromkeys(s.column for s in signals if s.column is not None))
        values = result.matrix[:, columns] if result.some is None else result.some(columns)
        place = {column: k for k, column in enumerate(columns)}
        whole = np.tile(np.array([s.value for s in signals]), (len(result.time), 1))
        moving = [(k, place[s.column], float(s.sign)) for k, s in enumerate(signals) if s.column is not None]
        if moving:
            there, at_column, signs = (list(v) for v in zip(*moving, strict=True))
            whole[:, there] = values[:, at_column] * np.array(signs) + 0.0
        found: dict[str, dict[str, Array]] = {}
        at = 0
        for path, own in self.names.items():
            found[path] = {}
            for name, (shape, elements) in own.items():
                found[path][name] = whole[:, at : at + len(elements)].reshape(-1, *shape)
                at += len(elements)
        return found


_MADE: WeakKeyDictionary[CompiledModel, dict[tuple[tuple[str, ...], ...], Watch]] = WeakKeyDictionary()
