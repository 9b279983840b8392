"""Heights of steep functions over the range of their arguments, and levels, which count changes by a factor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.steep import Base, Kind
from acausal.arrays import Vector

# Beyond these levels a step function equals one of its end values up to rounding.
_STEP_LEVELS = 37.0
# Below the lowest level a function is 1e-40 of one, or of its largest value, which only matters if a factor that is
# steep itself multiplies it. The highest level is that of the largest number.
_LOWEST_LEVEL, _HIGHEST_LEVEL = -92.0, 709.0
# Heights are clipped to this value, which leaves room for differences.
_LARGEST_HEIGHT = 1e100
# Smaller exponents count as this one: `u/sqrt(1 + u**2)` makes all of its change while the root changes by three.
_LEAST_EXPONENT = 4.0


class Levels:
    """Levels of k functions: the logarithm of the distance of a function from the nearer one of its end values.

    `kinds` are those of `acausal.analyse.events.steep`.
    """

    def __init__(self, kinds: Sequence[Kind]) -> None:
        self.count = len(kinds)
        self._kinds = kinds

    def _indices_of(self, name: str) -> NDArray[np.intp]:
        return np.flatnonzero([kind == name for kind in self._kinds])

    @cached_property
    def _tanh(self) -> NDArray[np.intp]:
        return self._indices_of("tanh")

    @cached_property
    def _atan(self) -> NDArray[np.intp]:
        return self._indices_of("atan")

    @cached_property
    def _cosh(self) -> NDArray[np.intp]:
        return self._indices_of("cosh")

    @cached_property
    def is_step(self) -> NDArray[np.bool_]:
        """Which functions go from one end value to another, shape (k,)."""
        return np.isin(np.arange(self.count), [*self._tanh, *self._atan])

    @cached_property
    def _exponentials(self) -> tuple[NDArray[np.intp], Vector]:
        """Indices of the exponentials, and the logarithms of their bases."""
        rates = {k: kind.rate for k, kind in enumerate(self._kinds) if isinstance(kind, Base)}
        rates |= {k: 1.0 for k, kind in enumerate(self._kinds) if kind == "exp"}
        return np.array([*rates], dtype=np.intp), np.array([*rates.values()])

    @cached_property
    def _powers(self) -> tuple[NDArray[np.intp], Vector]:
        """Indices of the powers, and their exponents."""
        exponents = {k: kind for k, kind in enumerate(self._kinds) if isinstance(kind, float)}
        return np.array([*exponents], dtype=np.intp), np.array([*exponents.values()])

    @cached_property
    def _scales(self) -> tuple[Vector, Vector]:
        """Factors on the logarithm of each power's argument, and the levels below which the powers are negligible."""
        exponents = np.abs(self._powers[1])
        scales = np.maximum(exponents, _LEAST_EXPONENT)
        return scales, _LOWEST_LEVEL * scales / exponents

    @cached_property
    def may_turn(self) -> NDArray[np.bool_]:
        """Which functions may have another value where their argument is zero than on both sides, shape (k,)."""
        return np.isin(np.arange(self.count), [*self._powers[0], *self._cosh])

    def heights(self, values: Vector) -> Vector:
        """Distances of the functions from both of their end values, shape (n, 2, k).

        `values` are arguments at n instants, shape (n, k); further columns are ignored.
        """
        heights = np.zeros((len(values), 2, self.count))
        (bases, rates), (powers, exponents) = self._exponentials, self._powers
        with np.errstate(all="ignore"):
            for end, sign in enumerate((1.0, -1.0)):
                heights[:, end, self._tanh] = 1.0 / (1.0 + np.exp(-2.0 * sign * values[:, self._tanh]))
                heights[:, end, self._atan] = 0.5 + np.arctan(sign * values[:, self._atan]) / np.pi
            heights[:, 0, self._cosh] = np.cosh(values[:, self._cosh])
            heights[:, 0, bases] = np.exp(rates * values[:, bases])
            heights[:, 0, powers] = np.abs(values[:, powers]) ** exponents
        return np.nan_to_num(np.minimum(heights, _LARGEST_HEIGHT))

    def of(self, values: Vector, largest: Vector) -> Vector:
        """Levels at n instants, shape (n, k), monotone in the arguments.

        `largest` are the largest magnitudes of the arguments, shape (k,); a power that is 1e-40 of its value there is
        negligible.
        """
        levels = np.zeros((len(values), self.count))
        (bases, rates), powers, (scales, lowest) = self._exponentials, self._powers[0], self._scales
        levels[:, self._tanh] = np.clip(2.0 * values[:, self._tanh], -_STEP_LEVELS, _STEP_LEVELS)
        levels[:, self._atan] = np.clip(np.arcsinh(values[:, self._atan]), -_STEP_LEVELS, _STEP_LEVELS)
        levels[:, self._cosh] = np.clip(values[:, self._cosh], -_HIGHEST_LEVEL, _HIGHEST_LEVEL)
        levels[:, bases] = np.clip(rates * values[:, bases], _LOWEST_LEVEL, _HIGHEST_LEVEL)
        with np.errstate(divide="ignore", invalid="ignore"):
            size = scales * np.log(np.abs(values[:, powers]) / largest[powers]) - lowest
        levels[:, powers] = np.sign(values[:, powers]) * np.maximum(np.nan_to_num(size), 0.0)
        return levels

    def arguments(self, levels: Vector, columns: NDArray[np.intp], largest: Vector) -> Vector:
        """Inverse of `inverse`: the arguments at which the functions `columns` have these levels, all of shape (n,)."""
        values = np.zeros(len(levels))
        for indices, inverse in ((self._tanh, lambda v: 0.5 * v), (self._atan, np.sinh), (self._cosh, lambda v: v)):
            here = np.isin(columns, indices)
            values[here] = inverse(levels[here])
        (bases, rates), powers = self._exponentials, self._powers[0]
        rate, scale, lowest = np.ones(self.count), np.ones(self.count), np.zeros(self.count)
        rate[bases], (scale[powers], lowest[powers]) = rates, self._scales
        here = np.isin(columns, bases)
        values[here] = levels[here] / rate[columns[here]]
        here = np.isin(columns, powers)
        j = columns[here]
        size = np.exp((np.abs(levels[here]) + lowest[j]) / scale[j]) * largest[j]
        values[here] = np.sign(levels[here]) * size
        return values
