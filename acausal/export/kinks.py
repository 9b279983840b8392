"""Detection of points without first derivatives, where rates or outputs have a kink or jump.

At a kink CasADi returns the derivative of one side (the mean of both sides for `fabs`, zero for a root). Such a point
is recognised by comparing slopes on its two sides: for a smooth function they differ far less across a displacement of
the variables by 1e-12 of their magnitude than across one by 1e-9.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.minimal.manifold import Minimal
from acausal.lower.compiled import CompiledModel

# Relative displacements, and the number of random directions in which all variables are displaced together.
_CLOSE, _FAR, _DIRECTIONS = 1e-12, 1e-9, 2
# Relative difference up to which a jump counts as rounding error, and ratio of the close to the far difference up to
# which a function counts as smooth.
_ROUNDING, _SHRINKS = 1e-9, 0.5
# Displacements on each side, in units of _CLOSE, at which the scatter due to rounding is measured. A jump counts only
# if the scatter is below this fraction of it.
_SCATTER_POINTS, _SCATTER = (0.6, 0.7, 0.9, 1.1, 1.3, 1.6, 1.9, 2.2), 0.1
# Rows whose magnitude is below this fraction of the largest one consist of rounding errors.
_NOTHING = 1e-15


@dataclass(frozen=True, eq=False)
class Slopes:
    """Rates (nx,), outputs (ny,), matrices A, B, C, D for all states, and dz/dx (nz, nx), dz/du (nz, nu)."""

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
    coordinates: Minimal,
    outputs: Sequence[str],
) -> Slopes:
    """The `slopes` at a point `(x, z, u)`, shapes (nx,), (nz,), (nu,), checked for kinks and jumps.

    The checks displace the minimal `coordinates`, so that all states stay on the constraints.

    Raises ExportError: AC604 when values or slopes differ between the two sides of the point.
    """
    x, z, u = point
    sizes = np.maximum(np.abs(x), compiled.nominal_x), np.maximum(np.abs(u), 1.0)
    here = slopes(*point)
    names = [*(f"der({n})" for n in compiled.states), *outputs]
    for dx, du in _displacements(compiled, coordinates, *sizes):
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
            help="linearise slightly before or after it, or at other states",
        )
    return here


def two_sides(at: Callable[[float], Vector]) -> tuple[int, int, float, float] | None:
    """(Row, column, value below, value above) of the first entry that differs between the sides of a point, or None.

    `at(s)` returns a table, shape (n, k), of values and slopes for variables displaced by the relative amount `s`. The
    entries of a row are comparable in magnitude.
    """
    table, sides = at(0.0), [at(-_CLOSE), at(_CLOSE)]
    with np.errstate(invalid="ignore"):
        jump = np.max([np.abs(side - table) for side in sides], axis=0)
        largest = np.max([np.abs(side).sum(axis=1) for side in (table, *sides)], axis=0)[:, None]
        differs = ~((jump <= _ROUNDING * largest) | (largest <= _NOTHING * largest.max(initial=0.0)))
        if differs.any():
            far_difference = np.max([np.abs(at(s) - table) for s in (-_FAR, _FAR)], axis=0)
            differs &= ~(jump <= _SHRINKS * far_difference)
        if differs.any() and np.isfinite(jump[differs]).all():
            differs &= ~(_scatter(at) >= _SCATTER * jump)
    if not differs.any():
        return None
    row, column = np.argwhere(differs)[0].tolist()
    return row, column, float(sides[0][row, column]), float(sides[1][row, column])


def _scatter(at: Callable[[float], Vector]) -> Vector:
    """How far the entries of `at(s)` go back and forth on one side of the point, in the shape of the table.

    A function that is smooth on each side is monotone so close to the point, even if its slope is infinite. Rounding
    errors are not monotone, such as those of the accelerations of an arm in its elongated pose.
    """
    steps = (np.diff([at(side * _CLOSE * s) for s in _SCATTER_POINTS], axis=0) for side in (-1.0, 1.0))
    return np.asarray(np.max([np.abs(d).sum(axis=0) - np.abs(d.sum(axis=0)) for d in steps], axis=0))


def _displacements(
    compiled: CompiledModel, coordinates: Minimal, size_x: Vector, size_u: Vector
) -> Iterator[tuple[Vector, Vector]]:
    """Displacements of x, shape (nx,), and u, shape (nu,), of about their magnitude and tangential to constraints."""
    rng = np.random.default_rng(0)
    places = np.array(coordinates.places, dtype=int)
    for _ in range(_DIRECTIONS):
        dx, du = (
            size * rng.uniform(0.5, 1.0, len(size)) * rng.choice([-1.0, 1.0], len(size))
            for size in (size_x[places], size_u)
        )
        dx[places >= len(size_x) - compiled.discretes] = 0.0
        yield coordinates.of_coordinates @ dx + coordinates.of_inputs @ du, du
