"""Newton's method for the algebraic variables of a model, and for states that its start leaves free."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import BufferedFunction

# Steps, relative to the unknowns, and residuals, relative to those at the guesses and what unknowns can make of them,
# that end the search.
_CONVERGED, _SATISFIED = 1e-11, 1e-8


@dataclass(frozen=True, eq=False)
class Newton:
    """Functions of `(t, x, z, u, p, m)` for the unknowns y, the states at the places `free` and then z."""

    free: tuple[int, ...]
    scale: Vector
    # `-> d residual / d y` of the start conditions (where states are free) and the algebraic equations, y in its
    # nominal magnitudes.
    slope: Any
    step: Any  # `-> (y - root, residual, size of the rows of the slope)`, the first to first order

    @cached_property
    def buffered_slope(self) -> BufferedFunction:
        """`slope`, dense."""
        return BufferedFunction(self.slope)

    @classmethod
    def of(cls, compiled: CompiledModel, free: tuple[int, ...]) -> Newton | None:
        """Made of a model; None where the equations cannot be solved for these unknowns."""
        s = Symbols(compiled)
        places = list(free)
        residual = compiled.rhs(*s.inputs)[1]
        if free:
            residual = ca.vertcat(compiled.conditions(*s.inputs)[0], residual)
        scale = np.concatenate([compiled.nominal_x[places], compiled.nominal_z])
        unknowns = ca.vertcat(*(s.x[k] for k in free), s.z)
        if residual.numel() != unknowns.numel():
            return None
        slope = ca.jacobian(residual, unknowns) @ ca.diag(ca.DM(scale))
        parts = ca.Function("parts", s.inputs, [ca.densify(residual), slope])
        arguments = [ca.MX.sym(f"a{k}", symbol.numel()) for k, symbol in enumerate(s.inputs)]
        value, matrix = parts(*arguments)
        try:
            change = ca.DM(scale) * ca.solve(matrix, value, "qr")
            sizes = ca.fabs(matrix) @ ca.DM.ones(len(scale))
            step = ca.Function("newton_step", arguments, [ca.densify(change), value, ca.densify(sizes)])
        except RuntimeError:  # structurally singular
            return None
        return cls(free, scale, ca.Function("slope", s.inputs, [slope]), step)

    @cached_property
    def _buffered(self) -> BufferedFunction:
        return BufferedFunction(self.step)

    def solve(
        self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, most: int
    ) -> tuple[Vector, Vector] | None:
        """States and algebraic variables, from those given; None when that takes more than so many steps."""
        x, z, places = x.copy(), z.copy(), list(self.free)
        first: Vector | None = None
        for _ in range(most):
            change, residual, _ = self._buffered(t, x, z, u, p, m)
            first = np.abs(residual) if first is None else first
            x[places] -= change[: len(places)]
            z -= change[len(places) :]
            here = np.abs(np.concatenate([x[places], z]))
            if not np.isfinite(here).all():
                return None
            if (np.abs(change) <= _CONVERGED * (self.scale + here)).all():
                # a singular matrix makes steps that are so long that any other is short beside them
                _, left, sizes = self._buffered(t, x, z, u, p, m)
                return (x, z) if (np.abs(left) <= _SATISFIED * (first + sizes)).all() else None
        return None
