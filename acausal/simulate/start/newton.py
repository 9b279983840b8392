"""Newton's method for the algebraic variables of a model, and for states that are free at its start."""

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

# Limits of convergence for steps, relative to the unknowns, and for residuals, relative to those at the guesses and to
# the sizes of their terms.
_CONVERGED, _SATISFIED = 1e-11, 1e-8


@dataclass(frozen=True, eq=False)
class Newton:
    """Functions of `(t, x, z, u, p, m)` for the unknowns y: the states at the indices `free`, and then z."""

    free: tuple[int, ...]
    scale: Vector
    # `-> d residual / d y` of the start conditions (if states are free) and the algebraic equations, with y in units of
    # its nominal magnitudes.
    slope: Any
    step: Any  # `-> (Newton step, residual, size of the rows of the slope)`

    @cached_property
    def buffered_slope(self) -> BufferedFunction:
        """`slope`, dense."""
        return BufferedFunction(self.slope)

    @classmethod
    def of(cls, compiled: CompiledModel, free: tuple[int, ...]) -> Newton | None:
        """The functions of a model; None if the equations cannot be solved for these unknowns."""
        s = Symbols(compiled)
        indices = list(free)
        residual = compiled.rhs(*s.inputs)[1]
        if free:
            residual = ca.vertcat(compiled.conditions(*s.inputs)[0], residual)
        scale = np.concatenate([compiled.nominal_x[indices], compiled.nominal_z])
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
        self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, most_steps: int
    ) -> tuple[Vector, Vector] | None:
        """States and algebraic variables, starting from those given; None if it takes more than `most_steps`."""
        x, z, indices = x.copy(), z.copy(), list(self.free)
        first: Vector | None = None
        for _ in range(most_steps):
            change, residual, _ = self._buffered(t, x, z, u, p, m)
            first = np.abs(residual) if first is None else first
            x[indices] -= change[: len(indices)]
            z -= change[len(indices) :]
            here = np.abs(np.concatenate([x[indices], z]))
            if not np.isfinite(here).all():
                return None
            if (np.abs(change) <= _CONVERGED * (self.scale + here)).all():
                # with a singular matrix, unknowns become so large that steps seem small: check the residuals as well
                _, final, sizes = self._buffered(t, x, z, u, p, m)
                return (x, z) if (np.abs(final) <= _SATISFIED * (first + sizes)).all() else None
        return None
