"""Equations of a phase for the program: constant parameters inserted, and linear algebraic variables solved for.

Inserting constants simplifies the expressions, whose derivatives are then smaller: most products of the inertias of a
robot are zero or one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector

# Largest number of algebraic variables solved for symbolically; with more of them, unknowns give a sparser program.
_MOST_SOLVED = 8


@dataclass(frozen=True, eq=False)
class Law:
    """Equations of a phase with open parameters w."""

    # `(t, x, z, u, w) -> (ode, alg, y)`: y has the outputs `wanted`; z and alg are empty if they are solved for.
    equations: Any
    algebraic: Any  # `(t, x, u, w) -> z` if the algebraic equations are linear and solved for; else None
    wanted: tuple[int, ...]  # indices of the rows of y among all outputs
    parameters: Any  # `(w) -> p`; `guess` are values of w, shape (nw,)
    guess: Vector
    # Number of selectors of branches at the end of z; y has as many further rows, the quantities that decide them.
    selectors: int = 0

    def algebraic_jacobian(self, at: Sequence[Vector], sizes: Vector) -> Vector:
        """Jacobians of the algebraic equations by scaled z at n instants, shape (nz, nz, n).

        `at`: t, x, z, u, each of shape (rows, n).
        `sizes`: magnitudes of z, shape (nz,).
        """
        n, m = at[0].shape[1], len(sizes)
        # selectors are halfway between the branches, as in the initial guess
        selectors = np.full((self.selectors, n), 0.5)
        columns = [at[0], at[1], np.vstack([at[2], selectors]), at[3], np.repeat(self.guess[:, None], n, axis=1)]
        given = [ca.DM(c) if c.size else ca.DM(c.shape[0], n) for c in columns]
        found = np.array(self._jacobian.map(n)(*given)).reshape(m, m + self.selectors, n, order="F")
        return np.asarray(found[:, :m] * sizes[None, :, None])

    @cached_property
    def _jacobian(self) -> Any:
        """`(t, x, z, u, w) -> d alg / d z`, stacked as a column."""
        point = [ca.SX.sym(self.equations.name_in(k), self.equations.numel_in(k)) for k in range(5)]
        slope = ca.densify(ca.jacobian(self.equations(*point)[1], point[2]))
        return ca.Function("slopes", point, [ca.vec(slope)])


def law_of(dae: Any, p: Vector, places: Sequence[int], wanted: Sequence[int]) -> Law:
    """The equations of `dae` with the parameters at `places` open, and all others at their values in p, shape (np,).

    `dae` may have selectors of branches as a sixth argument, and the quantities that decide them as a fourth result.
    `wanted` are the indices of the outputs to keep.
    """
    t, x, z, u, _ = (ca.SX.sym(dae.name_in(k), dae.numel_in(k)) for k in range(5))
    free = [ca.SX.sym("y", dae.numel_in(5))] if dae.n_in() > 5 else []
    w, full = ca.SX.sym("w", len(places)), ca.SX(ca.DM(p))
    for k, place in enumerate(places):
        full[place] = w[k]
    ode, alg, y, *deciding = dae(t, x, z, u, full, *free)
    y = y[list(wanted)] if len(wanted) else ca.SX(0, 1)
    algebraic = None
    if free:
        z, y = ca.vertcat(z, *free), ca.vertcat(y, *deciding)
    elif 0 < z.numel() <= _MOST_SOLVED:
        slope = ca.jacobian(alg, z)
        if not ca.depends_on(slope, z):
            at_zero = ca.substitute(alg, z, ca.SX.zeros(z.numel()))
            found = ca.densify(-ca.solve(slope, ca.densify(at_zero)))
            algebraic = ca.Function("algebraic", [t, x, u, w], [found])
            ode, y = ca.substitute([ode, y], [z], [found])
            z, alg = ca.SX(0, 1), ca.SX(0, 1)
    names = ["t", "x", "z", "u", "w"], ["ode", "alg", "y"]
    outputs = [ca.densify(v) for v in (ode, alg, y)]
    equations = ca.Function("law", [t, x, z, u, w], outputs, *names)
    parameters = ca.Function("p", [w], [full])
    guess = np.array(p, dtype=float)[list(places)]
    return Law(equations, algebraic, tuple(wanted), parameters, guess, sum(v.numel() for v in free))
