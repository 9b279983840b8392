"""The balance of impulses after a `reset` of velocities that constraints bind.

The impact acts in the only equation that contains the derivative of the velocity, its equation of motion. With an
unknown force phi added there, the equations of the instant are solved for all derivatives and constraint forces. The
slope of the rates by phi is the direction in which velocities jump, M dv = J^T p + e phi, J dv = 0 (the same as in
`acausal.lower.events.impulses`, where the model names the force).

The model does not state whether that equation is a balance of forces, but its numbers show it: in a mechanical system,
velocity j responds to an impulse on k as k does to one on j (J. C. Maxwell's reciprocity; the inverse of a mass matrix
under constraints is symmetric), up to the factors by which the equations were multiplied. A single constraint shows no
contradiction at one point, so the factors must be the same at some distance as well. If they are not, or if several
equations contain the derivative, nothing is computed.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner

_Point = tuple[float, Vector, Vector, Vector, Vector, Vector]
# Relative limits for responses that count as zero, and for factors that count as equal.
_ROUNDING, _SAME = 1e-8, 1e-6
# Relative displacements of the states for other points.
_ELSEWHERE = (0.07, -0.11)


def directions(compiled: CompiledModel, resets: Sequence[int], slopes: Vector, at: _Point) -> Vector | None:
    """The directions in which states jump by an impulse on each of these velocities, shape (nx, resets).

    None if an equation of motion is not a balance of forces.

    `resets`: Indices of the velocities.
    `slopes`: Derivatives of the stabilised constraints by the states, shape (constraints, nx).
    `at`: Time, x, z, u, p and m.
    """
    balance = _balance(compiled)
    found = balance.response(resets, at)
    if found is None:
        return None
    moved = np.flatnonzero(np.abs(found).max(axis=1) > _ROUNDING * np.abs(found).max()).tolist()
    if not set(resets) <= set(moved):
        return None
    size = np.abs(slopes) @ np.abs(found)
    if (
        np.abs(slopes @ found) > _ROUNDING * size
    ).any():  # the reset state is a position, or the constraints would be violated
        return None
    factors = [_factors(balance, moved, at, shift) for shift in (0.0, *_ELSEWHERE)]
    if any(f is None or not np.allclose(f, factors[0], rtol=_SAME) for f in factors):  # type: ignore[arg-type]
        return None
    return found


def _factors(balance: _Balance, moved: Sequence[int], at: _Point, shift: float) -> Vector | None:
    """`reciprocity` at a displaced point, which need not satisfy the constraints."""
    t, x, *numbers = at
    n = balance.compiled.n_dynamic
    x = x.copy()
    direction = np.cos(1.0 + 2.0 * np.arange(n))
    x[:n] += shift * direction * (np.abs(x[:n]) + balance.compiled.nominal_x[:n])
    response = balance.response(moved, (t, x, *numbers))  # type: ignore[arg-type]
    return None if response is None else reciprocity(response[moved])


def reciprocity(response: Vector) -> Vector | None:
    """Factors of the columns that make a matrix symmetric with a positive diagonal; None if there are none.

    The first column of each connected group has the factor one.
    """
    diagonal = np.diag(response)
    if not np.isfinite(response).all() or (diagonal == 0.0).any():
        return None
    scaled = response / diagonal  # entry (j, k) is the jump of j if k jumps by one
    # columns that respond to each other are scaled along a spanning tree
    factor, first = np.zeros(len(diagonal)), np.zeros(len(diagonal), dtype=int)
    for root in range(len(diagonal)):
        if factor[root]:
            continue
        factor[root], first[root], stack = 1.0, root, [root]
        while stack:
            k = stack.pop()
            for j in np.flatnonzero((np.abs(scaled[:, k] * scaled[k, :]) > _ROUNDING**2) & (factor == 0.0)).tolist():
                factor[j], first[j] = factor[k] * scaled[j, k] / scaled[k, j], root
                stack.append(j)
    balanced = scaled * factor
    size = np.sqrt(np.outer(np.abs(factor), np.abs(factor)))
    holds = (factor > 0.0).all() and (np.abs(balanced - balanced.T) <= _SAME * size).all()
    return factor * diagonal[first] / diagonal if holds else None


@once_per_owner
def _balance(compiled: CompiledModel) -> _Balance:
    return _Balance(compiled)


class _Balance:
    """All equations of one instant, and the unknowns for which they are solved."""

    def __init__(self, compiled: CompiledModel) -> None:
        structure = compiled.solution.structure
        pool, self.compiled = structure.reduced.pool, compiled
        self.rows = [e for block in structure.blocks for e in block.rows]
        unknowns = [v for block in structure.blocks for v in block.columns]
        s, y = Symbols(compiled), ca.SX.sym("y", len(unknowns))
        builder = s.defined(compiled)
        values = builder.column(pool.vars(unknowns))
        open_ = Symbols.builder(s, compiled)
        open_.define([], compiled.rewritten)
        open_.assign(unknowns, y)
        residuals = open_.column(open_.replaced(structure.residuals[e] for e in self.rows))
        rates = open_.column(structure.rates(compiled.state_variables))
        self.values = ca.Function("values", s.inputs, [ca.densify(values)])
        self.slopes = ca.Function("slopes", [*s.inputs, y], [ca.jacobian(residuals, y), ca.jacobian(rates, y)])
        self.row_of = {e: k for k, e in enumerate(self.rows)}

    def response(self, velocities: Sequence[int], at: _Point) -> Vector | None:
        """The response of the rates of all states to a force on each of these velocities, shape (nx, velocities)."""
        rows = [self._equation(k) for k in velocities]
        if any(row is None for row in rows):
            return None
        matrix, rates = self.slopes(*at, self.values(*at))
        right = np.zeros((matrix.shape[0], len(rows)))
        right[rows, range(len(rows))] = 1.0  # type: ignore[index]
        try:
            found = np.array(rates @ ca.solve(matrix, ca.DM(right), "csparse"))
        except RuntimeError:  # singular
            return None
        return found if np.isfinite(found).all() else None

    def _equation(self, velocity: int) -> int | None:
        """The row of the only equation that contains its derivative, if that equation is solved as it was written."""
        structure = self.compiled.solution.structure
        reduced = structure.reduced
        rate = structure.derivative(self.compiled.state_variables[velocity])
        holding = [e for e, node in enumerate(reduced.residuals) if rate in reduced.pool.variables_in(node)]
        if len(holding) != 1 or structure.residuals[holding[0]] != reduced.residuals[holding[0]]:
            return None
        return None if holding[0] in structure.integral.values() else self.row_of.get(holding[0])
