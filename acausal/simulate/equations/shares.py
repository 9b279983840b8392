"""Statically undetermined loads: how the load on a shaft is shared by several elements that are stuck in dry friction.

Two brakes that hold one shaft state twice that it does not accelerate, and no equation says how much of the load each
takes: in this mode the algebraic equations r(z) = 0 are consistent, but their Jacobian J is singular. The missing
equation is the creep of stuck elements, `infinitesimal()` (eps below) times their load. Along the left null space L of
J the limit of r/eps for eps to zero must vanish, so that z solves r + P r_eps = 0, where P projects onto L and r_eps is
the derivative with respect to eps. For consistent equations this solution is exact: L^T (r + P r_eps) = 0 implies r = 0
and L^T r_eps = 0, the loads of least squares. It remains exact where L changes with the motion, as long as the sum of
both Jacobians is regular.

Contradicting equations hold in none of their modes. With a small creep instead of an infinitesimal one they do have a
solution, far on the side on which an element starts to slip. The modes of the next round follow from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import BufferedFunction

# Relative to the largest one: singular values below `_ZERO` count as zero, and a bordered Jacobian is regular above
# `_REGULAR`.
_ZERO, _REGULAR = 1e-10, 1e-7
# Creep relative to the scale of the equations, where it has to be a number.
_CREEP = 1e-8
# Residuals that show a contradiction, relative to the size of the terms, and absolute at nominal magnitudes.
_CONTRADICTED, _ABSOLUTE = 1e-7, 1e-9
_MOST_BORDERS = 64


@dataclass(frozen=True, eq=False)
class Border:
    """The terms that are added to singular equations."""

    projector: Vector  # P, shape (nz, nz), of rank `rank`
    null: Vector  # the orthogonal projector on L, for residuals in scaled rows; shape (nz, nz)
    rank: int
    place: int  # index of the infinitesimal creep among the modes
    compiled: CompiledModel  # the model with the bordered equations

    def added(self, alg: Any, m: Any) -> Any:
        """The bordered form of the algebraic equations, for symbols of these and of the modes."""
        return _bordered(alg, m[self.place], self.projector)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Residual r, Jacobian J, and derivative of J with respect to the creep at a point, with their row scales."""

    rows: Vector
    residual: Vector
    slope: Vector
    creep: Vector


@dataclass(eq=False)
class Shares:
    """Statically undetermined loads of one model, and the bordered equations that were built for them."""

    place: int
    rhs: Any
    scale: Vector
    slopes: BufferedFunction
    names: tuple[str, ...]
    loads: Any
    _borders: list[Border] = field(default_factory=list)

    @classmethod
    def of(cls, compiled: CompiledModel) -> Shares | None:
        """Build for a model; None if no algebraic equation depends on an infinitesimal creep."""
        place = place_of_creep(compiled)
        if place is None or not compiled.algebraic:
            return None
        s = Symbols(compiled)
        alg = compiled.rhs(*s.inputs)[1]
        creep = ca.jacobian(alg, s.m[place])
        if not creep.nnz():
            return None
        scale = ca.diag(ca.DM(compiled.nominal_z))
        parts = alg, ca.jacobian(alg, s.z) @ scale, ca.jacobian(creep, s.z) @ scale
        function = ca.Function("slopes", s.inputs, [ca.densify(part) for part in parts])
        names, loads = _loads(compiled)
        return cls(place, compiled.rhs, compiled.nominal_z, BufferedFunction(function), names, loads)

    def border(
        self, compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
    ) -> Border | None:
        """The border that the equations need here; None if they are regular, or singular for another reason."""
        slopes = self._at(t, x, z, u, p, m)
        if slopes is None:
            return None
        left, values, right = np.linalg.svd(slopes.slope)
        rank = int(np.count_nonzero(values <= _ZERO * max(float(values[0]), 1.0)))
        if not rank:
            return None
        for border in self._borders:
            if border.rank == rank and _is_regular(
                slopes.slope + _scaled(border.projector, slopes.rows) @ slopes.creep
            ):
                return border
        null = left[:, -rank:]
        size = float(np.abs(null.T @ slopes.creep @ right[-rank:].T).max())
        if size == 0.0:
            return None
        orthogonal = null @ null.T
        scaled_projector = orthogonal / size
        if not _is_regular(slopes.slope + scaled_projector @ slopes.creep):
            return None
        projector = scaled_projector * slopes.rows[None, :] / slopes.rows[:, None]
        border = Border(projector, orthogonal, rank, self.place, _with_border(compiled, self.place, projector))
        if len(self._borders) == _MOST_BORDERS:
            del self._borders[0]
        self._borders.append(border)
        return border

    def contradicts(
        self, border: Border, errors: Vector, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
    ) -> bool:
        """Whether the original equations do not hold at a solution of the bordered ones, with these errors of states.

        Velocities on a stabilised constraint are off by the tolerance, and the accelerations that correct them differ
        from those of elements that rest.
        """
        slopes = self._at(t, x, z, u, p, m)
        if slopes is None:
            return True
        reach = np.abs(slopes.slope) @ np.abs(z / self.scale)
        excess = np.abs(slopes.residual) - _CONTRADICTED * reach - _ABSOLUTE
        if not (excess > 0.0).any():
            return False
        (by_x,) = self._by_states(t, x, z, u, p, m)
        moved = border.null @ (slopes.rows[:, None] * by_x.reshape(len(z), len(x)))
        return bool((excess > np.abs(moved) @ errors).any())

    @cached_property
    def _by_states(self) -> BufferedFunction:
        """Derivative of the algebraic equations by the states."""
        arguments = self.rhs.sx_in()
        slope = ca.jacobian(self.rhs(*arguments)[1], arguments[1])
        return BufferedFunction(ca.Function("by_states", arguments, [ca.densify(slope)]))

    def creep(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> float:
        """A small number to replace the infinitesimal creep; 0 if nothing depends on it."""
        slopes = self._at(t, x, z, u, p, m)
        size = 0.0 if slopes is None else float(np.abs(slopes.creep).max())
        return _CREEP / size if size > 0.0 else 0.0

    def open(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> tuple[str, ...]:
        """Names of the loads that the equations do not determine."""
        slopes = self._at(t, x, z, u, p, m)
        if slopes is None:
            return ()
        _, values, right = np.linalg.svd(slopes.slope)
        null_space = right[values <= _ZERO * max(float(values[0]), 1.0)]
        (gradient,) = self.loads(t, x, z, u, p, m)
        moved = np.abs(gradient.reshape(len(self.names), -1) @ null_space.T).max(axis=1, initial=0.0)
        return tuple(n for n, v in zip(self.names, moved, strict=True) if v > 1e-9 * moved.max())

    def _at(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> _Slopes | None:
        residual, slope, creep = self.slopes(t, x, z, u, p, m)
        count = len(z)
        slope, creep = slope.reshape(count, count), creep.reshape(count, count)
        if not (np.isfinite(slope).all() and np.isfinite(creep).all() and np.isfinite(residual).all()):
            return None
        size = np.maximum(np.abs(slope), np.abs(creep)).max(axis=1)
        rows = 1.0 / np.where(size > 0.0, size, 1.0)
        return _Slopes(rows, rows * residual, rows[:, None] * slope, rows[:, None] * creep)


def place_of_creep(compiled: CompiledModel) -> int | None:
    """Index of the infinitesimal creep among the modes; None if the model has none."""
    events, nodes = compiled.state_events, compiled.solution.structure.reduced.pool.nodes
    first = compiled.n_timely + len(events.samples) + len(events.memories)
    return next((first + k for k, n in enumerate(events.flags) if nodes[n][0] == "infinitesimal"), None)


def _bordered(alg: Any, creep: Any, projector: Vector) -> Any:
    return ca.densify(alg + ca.DM(projector) @ ca.densify(ca.jacobian(alg, creep)))


def _with_border(compiled: CompiledModel, place: int, projector: Vector) -> CompiledModel:
    s = Symbols(compiled)
    ode, alg = compiled.rhs(*s.inputs)
    alg = _bordered(alg, s.m[place], projector)
    names = ["t", "x", "z", "u", "p", "m"]
    return replace(compiled, rhs=ca.Function("rhs", s.inputs, [ode, alg], names, ["ode", "alg"]), varied=True)


def _scaled(projector: Vector, rows: Vector) -> Vector:
    return np.asarray(projector * rows[:, None] / rows[None, :])


def _is_regular(slope: Vector) -> bool:
    values = np.linalg.svd(slope, compute_uv=False)
    return bool(values[-1] > _REGULAR * values[0])


def _loads(compiled: CompiledModel) -> tuple[tuple[str, ...], Any]:
    """Names of the variables that an infinitesimal creep multiplies, and their Jacobian with respect to scaled z."""
    reduced = compiled.solution.structure.reduced
    nodes = reduced.pool.nodes
    creeps = {n for n in compiled.state_events.flags if nodes[n][0] == "infinitesimal"}
    factors = [set(n[1:]) - creeps for n in nodes if n[0] == "mul" and creeps & set(n[1:])]
    factors_found = dict.fromkeys(k for operands in factors for k in operands if nodes[k][0] == "var")
    columns = {node: k for k, node in enumerate(compiled.columns)}
    places = {node: columns[node] for node in factors_found if node in columns}
    s = Symbols(compiled)
    values = compiled.observe(*s.inputs)[list(places.values())]
    jacobian = ca.jacobian(values, s.z) @ ca.diag(ca.DM(compiled.nominal_z))
    names = tuple(reduced.name(nodes[n][1]) for n in places)
    return names, BufferedFunction(ca.Function("loads", s.inputs, [ca.densify(jacobian)]))
