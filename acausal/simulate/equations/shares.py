"""Loads that statics leave open: elements of dry friction that are stuck on one shaft share its torque somehow.

Two brakes that hold one shaft say twice that it does not accelerate, and how much of the load each takes nothing says:
the algebraic equations r(z) = 0 of this mode have a singular slope J and are consistent. What stuck elements creep by,
`infinitesimal()` times their load, is the other equation: along the left null space L of J the limit of r/eps for eps
to zero, so that z solves r + P r_eps = 0, where P projects onto L and r_eps is the derivative by eps. Of consistent
equations this is an exact solution: L^T (r + P r_eps) = 0 leaves r = 0 and L^T r_eps = 0, the loads of least squares.
It stays exact where L turns with the motion, as long as the sum of both slopes is regular.

Equations that contradict each other hold in none of their modes. With a small creep instead of an infinitesimal one
they have a solution that is far out on the side on which an element gives way, which is how the modes go on from there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import BufferedFunction

# Singular values, by the largest one, that are zero; what is left of a bordered slope at least.
_ZERO, _REGULAR = 1e-10, 1e-7
# Creep by the scale of the equations, where it has to be a number.
_SMALL = 1e-8
# What contradicting equations leave, by the size of their terms, and at nominal magnitudes.
_CONTRADICTED, _ABSOLUTE = 1e-7, 1e-9
_MOST_KEPT = 64


@dataclass(frozen=True, eq=False)
class Border:
    """What is added to singular equations."""

    projector: Vector  # p, shape (nz, nz), of rank `rank`
    rank: int
    place: int  # of what is infinitesimal among the modes
    compiled: CompiledModel  # the model with these equations

    def added(self, alg: Any, m: Any) -> Any:
        """The algebraic equations of these, and modes, as symbols."""
        return _bordered(alg, m[self.place], self.projector)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Residuals and slopes at a point, rows and columns scaled: r, J, and the derivatives of both by the creep."""

    rows: Vector
    residual: Vector
    slope: Vector
    creep: Vector


@dataclass(eq=False)
class Shares:
    """Statically undetermined loads of one model, and the equations that were made for them."""

    place: int
    rhs: Any
    scale: Vector
    slopes: BufferedFunction
    names: tuple[str, ...]
    loads: Any
    _borders: list[Border] = field(default_factory=list)

    @classmethod
    def of(cls, compiled: CompiledModel) -> Shares | None:
        """Made of a model; None where no algebraic equations depend on anything infinitesimal."""
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
        """What the equations need at this point; None where they are regular, or singular for another reason."""
        at = self._at(t, x, z, u, p, m)
        if at is None:
            return None
        left, values, right = np.linalg.svd(at.slope)
        rank = int(np.count_nonzero(values <= _ZERO * max(float(values[0]), 1.0)))
        if not rank:
            return None
        for known in self._borders:
            if known.rank == rank and _is_regular(at.slope + _scaled(known.projector, at.rows) @ at.creep):
                return known
        null = left[:, -rank:]
        size = float(np.abs(null.T @ at.creep @ right[-rank:].T).max())
        if size == 0.0:
            return None
        own = null @ null.T / size
        if not _is_regular(at.slope + own @ at.creep):
            return None
        projector = own * at.rows[None, :] / at.rows[:, None]
        found = Border(projector, rank, self.place, _with_border(compiled, self.place, projector))
        if len(self._borders) == _MOST_KEPT:
            del self._borders[0]
        self._borders.append(found)
        return found

    def contradicts(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> bool:
        """Whether the equations do not hold where they were bordered."""
        at = self._at(t, x, z, u, p, m)
        if at is None:
            return True
        reach = np.abs(at.slope) @ np.abs(z / self.scale)
        return bool((np.abs(at.residual) > _CONTRADICTED * reach + _ABSOLUTE).any())

    def creep(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> float:
        """A small number for what is infinitesimal, 0 where nothing depends on it."""
        at = self._at(t, x, z, u, p, m)
        size = 0.0 if at is None else float(np.abs(at.creep).max())
        return _SMALL / size if size > 0.0 else 0.0

    def open(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> tuple[str, ...]:
        """The loads that the equations leave open, by name."""
        at = self._at(t, x, z, u, p, m)
        if at is None:
            return ()
        _, values, right = np.linalg.svd(at.slope)
        ways = right[values <= _ZERO * max(float(values[0]), 1.0)]
        (slope,) = self.loads(t, x, z, u, p, m)
        moved = np.abs(slope.reshape(len(self.names), -1) @ ways.T).max(axis=1, initial=0.0)
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
    """Place among the modes of what is infinitesimal, if there is such a thing."""
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
    """Names of what is multiplied by something infinitesimal, and `(t, x, z, u, p, m) -> ` its slope by scaled z."""
    reduced = compiled.solution.structure.reduced
    nodes = reduced.pool.nodes
    tiny = {n for n in compiled.state_events.flags if nodes[n][0] == "infinitesimal"}
    factors = [set(n[1:]) - tiny for n in nodes if n[0] == "mul" and tiny & set(n[1:])]
    found = dict.fromkeys(k for own in factors for k in own if nodes[k][0] == "var")
    columns = {node: k for k, node in enumerate(compiled.columns)}
    places = {node: columns[node] for node in found if node in columns}
    s = Symbols(compiled)
    values = compiled.observe(*s.inputs)[list(places.values())]
    slope = ca.jacobian(values, s.z) @ ca.diag(ca.DM(compiled.nominal_z))
    names = tuple(reduced.name(nodes[n][1]) for n in places)
    return names, BufferedFunction(ca.Function("loads", s.inputs, [ca.densify(slope)]))
