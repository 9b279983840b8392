"""Joins the pieces of a run into one result, and renames their variables to the names that these have in it."""

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
    """Replace the beginning of a path, or of the path in a rate `der(...)`, by its name in `names`.

    A beginning ends before a dot, before a bracket, or at the end of the path.
    """
    if not names:
        return name
    rate = name.startswith(_RATE)
    path = name[len(_RATE) :] if rate else name
    for boundary in _BOUNDARY.finditer(path):
        replacement = names.get(path[: boundary.start()])
        if replacement is not None:
            return (_RATE if rate else "") + replacement + path[boundary.start() :]
    return name


def all_renamed(names: Iterable[str], of: Mapping[str, str]) -> list[str]:
    """The same for many names, most of which need no replacement."""
    heads = tuple({_BOUNDARY.split(old, maxsplit=1)[0] for old in of})
    return [renamed(name, of) if name.removeprefix(_RATE).startswith(heads) else name for name in names]


@dataclass(frozen=True, eq=False)
class Piece:
    """The result of one structure, and the names in the joined result by those in this structure."""

    result: Result
    names: Mapping[str, str]

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Its signals by their names in the joined result."""
        return dict(zip(all_renamed(self.result.signals, self.names), self.result.signals.values(), strict=True))

    def values(self, names: Sequence[str]) -> Array:
        """Values of these signals of the joined result, shape (n, len(names)); nan for those that are missing here."""
        values = np.full((len(self.result.time), len(names)), np.nan)
        present = [(k, s) for k, name in enumerate(names) if (s := self.signals.get(name)) is not None]
        for k, signal in present:
            if signal.column is None:
                values[:, k] = signal.value
        moving = [(k, s.column, s.sign) for k, s in present if s.column is not None]
        if moving:
            positions, columns, signs = (list(v) for v in zip(*moving, strict=True))
            values[:, positions] = self.result.columns(columns) * np.array(signs, dtype=float) + 0.0
        return values


class Joined(Mapping[str, Signal]):
    """Signals of consecutive pieces, created when the first of them is requested.

    A signal with the same constant value in all pieces keeps that value; all others get a column.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)

    @cached_property
    def _signals(self) -> dict[str, Signal]:
        joined: dict[str, Signal] = {}
        column = 0
        for name, signal in self._first_occurrences().items():
            if self._is_constant(name, signal):
                joined[name] = replace(signal, name=name)
                continue
            joined[name] = replace(signal, name=name, column=column, sign=1, value=0.0)
            column += 1
        return joined

    def _first_occurrences(self) -> dict[str, Signal]:
        """Each signal, as in the first piece that has it."""
        signals: dict[str, Signal] = {}
        for piece in self.pieces:
            for name, signal in piece.signals.items():
                signals.setdefault(name, signal)
        return signals

    def _is_constant(self, name: str, signal: Signal) -> bool:
        signals = (piece.signals.get(name) for piece in self.pieces)
        return all(s is not None and s.column is None and s.value == signal.value for s in signals)

    @cached_property
    def _column_names(self) -> list[str]:
        """Names of the signals that have columns, in their order."""
        return [name for name, signal in self._signals.items() if signal.column is not None]

    def rows(self, columns: Sequence[int] | None = None) -> Array:
        """Values over the run, shape (n, columns), of all columns or only of these."""
        names = self._column_names if columns is None else [self._column_names[k] for k in columns]
        return np.vstack([piece.values(names) for piece in self.pieces])

    def __getitem__(self, name: str) -> Signal:
        return self._signals[name]

    def __contains__(self, name: object) -> bool:
        return any(name in piece.signals for piece in self.pieces)

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    def __len__(self) -> int:
        return len(self._signals)
