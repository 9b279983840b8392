"""A run in pieces as one result, and the names that its parts have in all of it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.result.result import Result, Signal

Array = NDArray[np.float64]
_BOUNDARY = re.compile(r"[.\[]|$")
_RATE = "der("


def renamed(name: str, names: Mapping[str, str]) -> str:
    """A path, or the name of a rate, with its beginning exchanged; beginnings end with a name or an index."""
    if not names:
        return name
    rate = name.startswith(_RATE)
    path = name[len(_RATE) :] if rate else name
    for boundary in _BOUNDARY.finditer(path):
        lasting = names.get(path[: boundary.start()])
        if lasting is not None:
            return (_RATE if rate else "") + lasting + path[boundary.start() :]
    return name


def all_renamed(names: Iterable[str], of: Mapping[str, str]) -> list[str]:
    """The same for many names, most of which have no such beginning."""
    heads = tuple({_BOUNDARY.split(own, maxsplit=1)[0] for own in of})
    return [renamed(name, of) if name.removeprefix(_RATE).startswith(heads) else name for name in names]


@dataclass(frozen=True, eq=False)
class Piece:
    """The run of one structure, and its names in the whole result by its own."""

    result: Result
    names: Mapping[str, str]

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Its signals by their names in the whole."""
        return dict(zip(all_renamed(self.result.signals, self.names), self.result.signals.values(), strict=True))

    def values(self, names: Sequence[str]) -> Array:
        """Values of signals of the whole, shape (n, their number); nan for those it does not have."""
        found = np.full((len(self.result.time), len(names)), np.nan)
        own = [(k, s) for k, name in enumerate(names) if (s := self.signals.get(name)) is not None]
        for k, signal in own:
            if signal.column is None:
                found[:, k] = signal.value
        moving = [(k, s.column, s.sign) for k, s in own if s.column is not None]
        if moving:
            places, columns, signs = (list(v) for v in zip(*moving, strict=True))
            found[:, places] = self.result.columns(columns) * np.array(signs, dtype=float) + 0.0
        return found


class Joined(Mapping[str, Signal]):
    """Signals of pieces that follow one another, made when the first of them is asked for.

    What is the same number in all pieces is that number; all else has a column.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)

    @cached_property
    def _made(self) -> dict[str, Signal]:
        found: dict[str, Signal] = {}
        column = 0
        for name, signal in self._first().items():
            if self._is_number(name, signal):
                found[name] = replace(signal, name=name)
                continue
            found[name] = replace(signal, name=name, column=column, sign=1, value=0.0)
            column += 1
        return found

    def _first(self) -> dict[str, Signal]:
        """Each signal as it is in the first piece that has it."""
        found: dict[str, Signal] = {}
        for piece in self.pieces:
            for name, signal in piece.signals.items():
                found.setdefault(name, signal)
        return found

    def _is_number(self, name: str, signal: Signal) -> bool:
        own = (piece.signals.get(name) for piece in self.pieces)
        return all(s is not None and s.column is None and s.value == signal.value for s in own)

    @cached_property
    def _moving(self) -> list[str]:
        """Names of the columns."""
        return [name for name, signal in self._made.items() if signal.column is not None]

    def rows(self, columns: Sequence[int] | None = None) -> Array:
        """All columns over the run, or some."""
        names = self._moving if columns is None else [self._moving[k] for k in columns]
        return np.vstack([piece.values(names) for piece in self.pieces])

    def __getitem__(self, name: str) -> Signal:
        return self._made[name]

    def __contains__(self, name: object) -> bool:
        return any(name in piece.signals for piece in self.pieces)

    def __iter__(self) -> Iterator[str]:
        return iter(self._made)

    def __len__(self) -> int:
        return len(self._made)
