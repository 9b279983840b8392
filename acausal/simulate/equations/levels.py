"""How high steep functions are where their arguments go, and where they become another by a factor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.steep import Base, Kind
from acausal.arrays import Vector

# A step is within rounding of its ends beyond these levels.
_ENDS = 37.0
# What is 1e-40 of one, or of the largest there, wakes nothing but by a factor that is steep itself.
_LOWEST, _HIGHEST = -92.0, 709.0
# With room for differences.
_TALLEST = 1e100
# Powers count as this exponent at least: `u/sqrt(1 + u**2)` goes all its way while the root changes by three.
_LEAST_EXPONENT = 4.0


class Levels:
    """Of k functions; a level is the logarithm of what a function is above its nearer end.

    `kinds`: As in `acausal.analyse.events.steep`.
    """

    def __init__(self, kinds: Sequence[Kind]) -> None:
        self.count = len(kinds)
        self._kinds = kinds

    def _of(self, name: str) -> NDArray[np.intp]:
        return np.flatnonzero([kind == name for kind in self._kinds])

    @cached_property
    def _tanh(self) -> NDArray[np.intp]:
        return self._of("tanh")

    @cached_property
    def _atan(self) -> NDArray[np.intp]:
        return self._of("atan")

    @cached_property
    def _cosh(self) -> NDArray[np.intp]:
        return self._of("cosh")

    @cached_property
    def is_step(self) -> NDArray[np.bool_]:
        """Which of them go from one value to another."""
        return np.isin(np.arange(self.count), [*self._tanh, *self._atan])

    @cached_property
    def _exponentials(self) -> tuple[NDArray[np.intp], Vector]:
        """Which of them are exponentials, and the logarithms of their bases."""
        found = {k: kind.rate for k, kind in enumerate(self._kinds) if isinstance(kind, Base)}
        found |= {k: 1.0 for k, kind in enumerate(self._kinds) if kind == "exp"}
        return np.array([*found], dtype=np.intp), np.array([*found.values()])

    @cached_property
    def _powers(self) -> tuple[NDArray[np.intp], Vector]:
        """Which of them are powers, and their exponents."""
        found = {k: kind for k, kind in enumerate(self._kinds) if isinstance(kind, float)}
        return np.array([*found], dtype=np.intp), np.array([*found.values()])

    @cached_property
    def _scales(self) -> tuple[Vector, Vector]:
        """By which the logarithm of each power's argument is multiplied, and the level of what is nothing."""
        exponents = np.abs(self._powers[1])
        scales = np.maximum(exponents, _LEAST_EXPONENT)
        return scales, _LOWEST * scales / exponents

    @cached_property
    def may_turn(self) -> NDArray[np.bool_]:
        """Which of them may be another where their argument is zero than on both of its sides."""
        return np.isin(np.arange(self.count), [*self._powers[0], *self._cosh])

    def heights(self, values: Vector) -> Vector:
        """What the functions are above both of their ends; shape (n, 2, k).

        `values`: Arguments at n instants, shape (n, k); further columns are not used.
        """
        found = np.zeros((len(values), 2, self.count))
        (bases, rates), (powers, exponents) = self._exponentials, self._powers
        with np.errstate(all="ignore"):
            for end, sign in enumerate((1.0, -1.0)):
                found[:, end, self._tanh] = 1.0 / (1.0 + np.exp(-2.0 * sign * values[:, self._tanh]))
                found[:, end, self._atan] = 0.5 + np.arctan(sign * values[:, self._atan]) / np.pi
            found[:, 0, self._cosh] = np.cosh(values[:, self._cosh])
            found[:, 0, bases] = np.exp(rates * values[:, bases])
            found[:, 0, powers] = np.abs(values[:, powers]) ** exponents
        return np.nan_to_num(np.minimum(found, _TALLEST))

    def of(self, values: Vector, largest: Vector) -> Vector:
        """Levels at n instants, shape (n, k), ascending or descending with the arguments.

        `largest`: The largest size of each argument, shape (k,); a power is nothing where it is 1e-40 of that there.
        """
        found = np.zeros((len(values), self.count))
        (bases, rates), powers, (scales, lowest) = self._exponentials, self._powers[0], self._scales
        found[:, self._tanh] = np.clip(2.0 * values[:, self._tanh], -_ENDS, _ENDS)
        found[:, self._atan] = np.clip(np.arcsinh(values[:, self._atan]), -_ENDS, _ENDS)
        found[:, self._cosh] = np.clip(values[:, self._cosh], -_HIGHEST, _HIGHEST)
        found[:, bases] = np.clip(rates * values[:, bases], _LOWEST, _HIGHEST)
        with np.errstate(divide="ignore", invalid="ignore"):
            size = scales * np.log(np.abs(values[:, powers]) / largest[powers]) - lowest
        found[:, powers] = np.sign(values[:, powers]) * np.maximum(np.nan_to_num(size), 0.0)
        return found

    def arguments(self, levels: Vector, columns: NDArray[np.intp], largest: Vector) -> Vector:
        """The arguments at which functions `columns` are on some levels, shape (n,): what `of` goes back to."""
        found = np.zeros(len(levels))
        for own, of in ((self._tanh, lambda v: 0.5 * v), (self._atan, np.sinh), (self._cosh, lambda v: v)):
            here = np.isin(columns, own)
            found[here] = of(levels[here])
        (bases, rates), powers = self._exponentials, self._powers[0]
        rate, scale, lowest = np.ones(self.count), np.ones(self.count), np.zeros(self.count)
        rate[bases], (scale[powers], lowest[powers]) = rates, self._scales
        here = np.isin(columns, bases)
        found[here] = levels[here] / rate[columns[here]]
        here = np.isin(columns, powers)
        j = columns[here]
        size = np.exp((np.abs(levels[here]) + lowest[j]) / scale[j]) * largest[j]
        found[here] = np.sign(levels[here]) * size
        return found
