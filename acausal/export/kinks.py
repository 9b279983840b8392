"""Points at which equations have no first derivatives: where rates or outputs have a kink, or jump.

What CasADi says there is that of one side, of `fabs` the mean of both, of a root zero. A point is told by its two
sides: slopes that differ across a thousandth of a billionth of the variables as much as across a billionth belong to no
smooth function.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.minimal.manifold import Minimal
from acausal.lower.compiled import CompiledModel

# Displacements, as shares of what variables are, and ways along which all of them are displaced at once.
_CLOSE, _FAR, _WAYS = 1e-12, 1e-9, 2
# What differs by less, as a share of a row, is rounding; what shrinks by more than this on the way is smooth.
_ROUNDING, _SHRINKS = 1e-9, 0.5
# Rows that are this small beside others are rounding altogether.
_NOTHING = 1e-15


@dataclass(frozen=True, eq=False)
class Slopes:
    """Rates [nx], outputs [ny], A, B, C, D of all states, and how algebraic variables follow x and u."""

    rates: Vector
    y: Vector
    matrices: tuple[Vector, ...]
    z_of_x: Vector
    z_of_u: Vector

    def table(self, x: Vector, u: Vector) -> Vector:
        """A row of each rate and output: what it is, and its slopes by states and inputs, in sizes `x` and `u`."""
        A, B, C, D = self.matrices
        rates = np.column_stack([self.rates, A * x, B * u]) / x[:, None]
        return np.vstack([rates, np.column_stack([self.y, C * x, D * u])])


def slopes_of_both_sides(
    compiled: CompiledModel,
    t: float,
    slopes: Callable[[Vector, Vector, Vector], Slopes],
    point: tuple[Vector, Vector, Vector],
    least: Minimal,
    outputs: Sequence[str],
) -> Slopes:
    """The `slopes` at a point `(x, z, u)`; motions beside it keep to the coordinates in `least`.

    Raises ExportError: AC604 when both sides of the point have different slopes, or values.
    """
    x, z, u = point
    sizes = np.maximum(np.abs(x), compiled.nominal_x), np.maximum(np.abs(u), 1.0)
    here = slopes(*point)
    names = [*(f"der({n})" for n in compiled.states), *outputs]
    for dx, du in _ways(compiled, least, *sizes):
        dz = here.z_of_x @ dx + here.z_of_u @ du
        found = two_sides(lambda s: slopes(x + s * dx, z + s * dz, u + s * du).table(*sizes))  # noqa: B023
        if found is None:
            continue
        row, column, below, above = found
        by = ["", *(f" by {n}" for n in (*compiled.states, *compiled.inputs))][column]
        size = np.concatenate([sizes[0], np.ones(len(outputs))])[row] / np.concatenate([[1.0], *sizes])[column]
        raise ExportError(
            "AC604",
            f"{compiled.name} has no linearization at t = {t:g} s: its rates or outputs have a kink or a jump there",
            evidence=[f"{names[row]}{by} is {size * below:.6g} on one side and {size * above:.6g} on the other"],
            cause="a relation, minimum, maximum or fabs changes sides exactly at this point",
            help="linearize at a time or states beside it",
        )
    return here


def two_sides(at: Callable[[float], Vector]) -> tuple[int, int, float, float] | None:
    """The first entry that is another one on both sides of a point, and what it is there; None where none is.

    `at(share)` is a table of values and slopes, in rows of one size, where variables are displaced by such a share.
    """
    table, sides = at(0.0), [at(-_CLOSE), at(_CLOSE)]
    with np.errstate(invalid="ignore"):
        jump = np.max([np.abs(side - table) for side in sides], axis=0)
        largest = np.max([np.abs(side).sum(axis=1) for side in (table, *sides)], axis=0)[:, None]
        off = ~(jump <= _ROUNDING * np.maximum(largest, _NOTHING * largest.max(initial=0.0)))
        if off.any():
            bend = np.max([np.abs(at(share) - table) for share in (-_FAR, _FAR)], axis=0)
            off &= ~(jump <= _SHRINKS * bend)
    if not off.any():
        return None
    row, column = np.argwhere(off)[0].tolist()
    return row, column, float(sides[0][row, column]), float(sides[1][row, column])


def _ways(compiled: CompiledModel, least: Minimal, size_x: Vector, size_u: Vector) -> Iterator[tuple[Vector, Vector]]:
    """Displacements of states and inputs, of about their sizes, that keep to the constraints; discrete ones stay."""
    rng = np.random.default_rng(0)
    places = np.array(least.places, dtype=int)
    for _ in range(_WAYS):
        dx, du = (
            size * rng.uniform(0.5, 1.0, len(size)) * rng.choice([-1.0, 1.0], len(size))
            for size in (size_x[places], size_u)
        )
        dx[places >= len(size_x) - compiled.discretes] = 0.0
        yield least.of_coordinates @ dx + least.of_inputs @ du, du
