"""Detection of points without first derivatives, where rates or outputs have a kink or jump.

There CasADi returns the derivative of one side, for `fabs` the mean of both, for a root zero. Such a point is
recognised by its two sides: for a smooth function, slopes differ far less across 1e-12 of the variables than across
1e-9.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.minimal.manifold import Minimal
from acausal.lower.compiled import CompiledModel

# Relative displacements, and number of directions in which all variables are displaced at once.
_CLOSE, _FAR, _WAYS = 1e-12, 1e-9, 2
# Relative difference that counts as rounding, and ratio of differences (close to far) of a smooth function.
_ROUNDING, _SHRINKS = 1e-9, 0.5
# Displacements on each side, by _CLOSE, at which rounding errors go up and down, and how much of a difference they are.
_BESIDE, _SCATTER = (0.6, 0.7, 0.9, 1.1, 1.3, 1.6, 1.9, 2.2), 0.1
# Rows smaller than this, relative to the largest, consist of rounding errors.
_NOTHING = 1e-15


@dataclass(frozen=True, eq=False)
class Slopes:
    """Rates (nx,), outputs (ny,), matrices A, B, C, D of all states, and dz/dx (nz, nx), dz/du (nz, nu)."""

    rates: Vector
    y: Vector
    matrices: tuple[Vector, ...]
    z_of_x: Vector
    z_of_u: Vector

    def table(self, x: Vector, u: Vector) -> Vector:
        """Table of shape (nx + ny, 1 + nx + nu): value and derivatives of each rate and output, scaled.

        `x`, shape (nx,), and `u`, shape (nu,), are the magnitudes by which states and inputs are scaled.
        """
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
    """The `slopes` at a point `(x, z, u)`, shapes (nx,), (nz,), (nu,), checked along motions of coordinates `least`.

    Raises ExportError: AC604 when both sides of the point have different slopes, or values.
    """
    x, z, u = point
    sizes = np.maximum(np.abs(x), compiled.nominal_x), np.maximum(np.abs(u), 1.0)
    here = slopes(*point)
    names = [*(f"der({n})" for n in compiled.states), *outputs]
    for dx, du in _displacements(compiled, least, *sizes):
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
    """(Row, column, value below, value above) of the first entry that differs on both sides of a point; None without.

    `at(share)` returns a table, shape (n, k), of values and slopes for variables displaced by that relative amount;
    each row has one scale.
    """
    table, sides = at(0.0), [at(-_CLOSE), at(_CLOSE)]
    with np.errstate(invalid="ignore"):
        jump = np.max([np.abs(side - table) for side in sides], axis=0)
        largest = np.max([np.abs(side).sum(axis=1) for side in (table, *sides)], axis=0)[:, None]
        differs = ~((jump <= _ROUNDING * largest) | (largest <= _NOTHING * largest.max(initial=0.0)))
        if differs.any():
            far_difference = np.max([np.abs(at(share) - table) for share in (-_FAR, _FAR)], axis=0)
            differs &= ~(jump <= _SHRINKS * far_difference)
        if differs.any() and np.isfinite(jump[differs]).all():
            differs &= ~(_scatter(at) >= _SCATTER * jump)
    if not differs.any():
        return None
    row, column = np.argwhere(differs)[0].tolist()
    return row, column, float(sides[0][row, column]), float(sides[1][row, column])


def _scatter(at: Callable[[float], Vector]) -> Vector:
    """How far the entries of `at(share)` go back and forth on one side of the point, of the table's shape.

    What is smooth on each side, be its slope infinite, is monotone that close; rounding errors are not, such as those
    of accelerations in the elongated pose of an arm.
    """
    steps = (np.diff([at(side * _CLOSE * share) for share in _BESIDE], axis=0) for side in (-1.0, 1.0))
    return np.asarray(np.max([np.abs(d).sum(axis=0) - np.abs(d.sum(axis=0)) for d in steps], axis=0))


def _displacements(
    compiled: CompiledModel, least: Minimal, size_x: Vector, size_u: Vector
) -> Iterator[tuple[Vector, Vector]]:
    """Displacements of x, shape (nx,), and u, shape (nu,), of about their magnitude and tangential to constraints."""
    rng = np.random.default_rng(0)
    places = np.array(least.places, dtype=int)
    for _ in range(_WAYS):
        dx, du = (
            size * rng.uniform(0.5, 1.0, len(size)) * rng.choice([-1.0, 1.0], len(size))
            for size in (size_x[places], size_u)
        )
        dx[places >= len(size_x) - compiled.discretes] = 0.0
        yield least.of_coordinates @ dx + least.of_inputs @ du, du
