"""Recorded states, of which as much is brought together as is read."""

from __future__ import annotations

from functools import cached_property
from types import EllipsisType

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def joined(parts: list[Vector]) -> Vector:
    """All columns of some parts, one after the other in memory, as solvers deliver them."""
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
