"""Coordinates with angles in place of states that a constraint keeps on a circle, for optimal control.

A model may have more states than degrees of freedom: a rod in x and y is stabilised, so that runs stay on
x**2 + y**2 == L**2. An optimisation over all these states has linearly dependent constraints, and a metric in which the
path over the top is long. Every constraint that describes an ellipse in two linear combinations of states,
a(q)**2 + b(q)**2 == 1, is replaced by a = sin(theta), b = -cos(theta), with theta and its rate as states. These cover
any number of turns; other constraints remain stabilised.

Source: local coordinates, E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), VII.2; invariants in
boundary value problems, V. H. Schulz, H. G. Bock, M. C. Steinbach, SIAM J. Sci. Comput. 19 (1998) 440-467.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.casadi_model import Port, Ports
from acausal.lower.compiled import CompiledModel

_RANK = 1e-9


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Transformation between states x of a model and coordinates c.

    Attributes
    ----------
    ports
        The coordinates: remaining states, then the angles, then their rates.
    kept
        Indices in x of the remaining states.
    expand
        SX function `(c) -> x`; `reduce` is `(x) -> c`, with angles between -pi and pi.
    bound
        Indices in p of the parameters that the circles depend on: the coordinates hold only for their given values.
    complete
        Whether the angles replace all stabilised constraints of the model.
    """

    ports: Ports
    kept: tuple[int, ...]
    angles: int
    expand: Any
    reduce: Any
    functionals: Vector
    rates: tuple[int, ...]
    bound: frozenset[int] = frozenset()
    complete: bool = False

    def of(self, x: Vector) -> Vector:
        """Coordinates, shape (nc, n), of states, shape (nx, n), with angles continuous from column to column."""
        if not self.angles:
            return x
        found = np.array(self.reduce.map(x.shape[1])(x))
        first = len(self.kept)
        found[first : first + self.angles] = np.unwrap(found[first : first + self.angles], axis=1)
        return found

    def states(self, c: Vector) -> Vector:
        """States, shape (nx, n), of coordinates, shape (nc, n)."""
        return np.array(self.expand.map(c.shape[1])(c)) if self.angles and c.size else c

    def equations(self, dae: Any) -> Any:
        """The function `(t, x, z, u, p) -> (ode, alg, y)` with coordinates in place of x."""
        if not self.angles:
            return dae
        arguments = [ca.SX.sym(dae.name_in(k), dae.numel_in(k)) for k in range(5)]
        arguments[1] = c = ca.SX.sym("c", len(self.ports))
        t, _, z, u, p = arguments
        ode, alg, y = dae(t, self.expand(c), z, u, p)
        first, n = len(self.kept), self.angles
        theta, omega = c[first : first + n], c[first + n :]
        second = ca.reshape(ca.DM(self.functionals) @ ode[list(self.rates)], n, 2)
        angular_acceleration = ca.cos(theta) * second[:, 0] + ca.sin(theta) * second[:, 1]
        rates = ca.vertcat(ode[list(self.kept)], omega, angular_acceleration)
        return ca.Function("dae", arguments, [rates, alg, y], dae.name_in(), dae.name_out())

    def inside(self, function: Any) -> Any:
        """A function `(t, x, z, u, p) -> ...` of the model with coordinates in place of x."""
        if not self.angles:
            return function
        arguments = [ca.SX.sym(function.name_in(k), function.numel_in(k)) for k in range(function.n_in())]
        arguments[1] = c = ca.SX.sym("c", len(self.ports))
        found = function.call([arguments[0], self.expand(c), *arguments[2:]])
        return ca.Function(function.name(), arguments, found, function.name_in(), function.name_out())


@dataclass(frozen=True, eq=False)
class _Circle:
    """A constraint |A (q - centre)| == 1: `rows` are the two rows of A over all states, `offset` is A centre."""

    rows: Vector
    offset: Vector
    bound: frozenset[int] = frozenset()


def coordinates_of(compiled: CompiledModel, ports: Ports, x: Vector, p: Vector) -> Coordinates:
    """The coordinates of a model that starts at x, shape (nx,), with parameters p, shape (np,)."""
    nx = len(ports)
    rates = _rates(compiled) if compiled.solution.structure.invariants else {}
    circles = [c for c in _circles(compiled, x, p) if all(k in rates for k in np.flatnonzero(c.rows.any(0)))]
    if circles:
        rows = np.vstack([c.rows[k] for k in range(2) for c in circles])
        offset = np.array([c.offset[k] for k in range(2) for c in circles])
        dependent = _dependent_states(rows)
        if dependent is not None:
            bound = frozenset(k for c in circles for k in c.bound)
            # each circle is a constraint on positions and its derivative, one on velocities
            complete = 2 * len(circles) == len(compiled.solution.structure.invariants)
            return replace(_with_angles(ports, rows, offset, dependent, rates), bound=bound, complete=complete)
    c = ca.SX.sym("x", nx)
    same = ca.Function("same", [c], [c])
    return Coordinates(ports, tuple(range(nx)), 0, same, same, np.zeros((0, 0)), ())


def _rates(compiled: CompiledModel) -> dict[int, int]:
    """Map the index of each state whose rate is another state to the index of that other state."""
    s = Symbols(compiled)
    ode = compiled.rhs(*s.inputs)[0]
    x = ca.vertsplit(s.x)
    found = {}
    for k in range(len(x)):
        for j, other in enumerate(x):
            if ca.is_equal(ode[k], other):
                found[k] = j
    return found


def _circles(compiled: CompiledModel, x: Vector, p: Vector) -> list[_Circle]:
    if not compiled.solution.structure.invariants:
        return []
    s = Symbols(compiled)
    found = []
    for g in ca.vertsplit(compiled.constraints(*s.inputs)[0]):
        others = ca.vertcat(s.t, s.z, s.u, s.m)
        if ca.depends_on(g, others):
            continue
        hessian, slope = ca.hessian(g, s.x)
        if ca.depends_on(hessian, s.x):
            continue
        numbers = ca.Function("g", [s.x, s.p], [hessian, slope, g])
        H, b, constant = (np.array(v, dtype=float) for v in numbers(np.zeros(len(x)), p))
        circle = _circle(H, b.ravel(), float(constant.item()), x)
        if circle is not None:
            bound = frozenset(k for k in range(s.p.numel()) if ca.depends_on(g, s.p[k]))
            found.append(replace(circle, bound=bound))
    return found


def _circle(H: Vector, b: Vector, constant: float, x: Vector) -> _Circle | None:
    """x'Hx/2 + b'x + constant == 0 as an ellipse in two combinations of x; None if it is none. Angle 0 is at the start.

    `H`: shape (nx, nx); `b`, `x`: shape (nx,).
    """
    values, vectors = np.linalg.eigh(H)
    large = np.abs(values) > _RANK * np.abs(values).max(initial=0.0)
    sign = 1.0 if values[large].sum() > 0 else -1.0
    if large.sum() != 2 or (sign * values[large] <= 0.0).any():
        return None
    centre = -np.linalg.pinv(H, rcond=_RANK) @ b
    if np.abs(H @ centre + b).max() > 1e-9 * max(1.0, np.abs(b).max()):
        return None
    square = -2 * sign * (constant + b @ centre / 2)
    if square <= 0.0:
        return None
    rows = np.sqrt(sign * values[large] / square)[:, None] * vectors[:, large].T
    a, c = rows @ (x - centre)
    if np.hypot(a, c) < 0.5:
        return None
    # rotate so that the start is at (0, -1), and mirror so that the last of the dominant states grows with the angle
    turn = np.array([[-c, a], [-a, -c]]) / np.hypot(a, c)
    rows = turn @ rows
    leading = int(np.flatnonzero(np.abs(rows[0]) > 0.999 * np.abs(rows[0]).max())[-1])
    if rows[0, leading] < 0.0:
        rows[0] *= -1
    return _Circle(rows, rows @ centre)


def _dependent_states(rows: Vector) -> list[int] | None:
    """Indices of the states that the angles determine, for `rows` of shape (2 n, nx); None if singular."""
    weight = 1.0 + 1e-6 * np.arange(rows.shape[1])
    factors: Any = scipy.linalg.qr(rows * weight, mode="r", pivoting=True)
    triangle, order = factors
    pivots = np.abs(np.diag(triangle))
    if pivots.min(initial=np.inf) <= _RANK * pivots.max(initial=0.0):
        return None
    return sorted(order[: len(rows)].tolist())


def _with_angles(
    ports: Ports, rows: Vector, offset: Vector, dependent: list[int], rates: dict[int, int]
) -> Coordinates:
    n, nx = len(rows) // 2, len(ports)
    dependent_rates = [rates[k] for k in dependent]
    kept = [k for k in range(nx) if k not in dependent and k not in dependent_rates]
    first = len(kept)
    c, x = ca.SX.sym("c", first + 2 * n), ca.SX.sym("x", nx)
    theta, omega = c[first : first + n], c[first + n :]
    point, velocity = (
        ca.vertcat(ca.sin(theta), -ca.cos(theta)),
        ca.vertcat(ca.cos(theta) * omega, ca.sin(theta) * omega),
    )
    inverse = np.linalg.inv(rows[:, dependent])
    free = [k for k in np.flatnonzero(rows.any(0)).tolist() if k not in dependent]
    full: Any = ca.SX(nx, 1)
    full[kept] = c[:first]
    full[dependent] = ca.DM(inverse) @ (point + ca.DM(offset) - ca.DM(rows[:, free]) @ full[free])
    free_rates = [rates[k] for k in free]
    full[dependent_rates] = ca.DM(inverse) @ (velocity - ca.DM(rows[:, free]) @ full[free_rates])
    places = np.flatnonzero(rows.any(0)).tolist()
    functionals, speeds = rows[:, places], [rates[k] for k in places]
    point_of_x = ca.DM(functionals) @ x[places] - ca.DM(offset)
    velocity_of_x = ca.DM(functionals) @ x[speeds]
    angle = ca.atan2(point_of_x[:n], -point_of_x[n:])
    rate = ca.cos(angle) * velocity_of_x[:n] + ca.sin(angle) * velocity_of_x[n:]
    names = [", ".join(ports[k].name for k in np.flatnonzero(np.abs(rows[[j, n + j]]).any(0))) for j in range(n)]
    angles = [Port(f"angle({name})", "rad", "Angle on the circle of a constraint, 0 at the start") for name in names]
    angular_rates = [Port(f"der(angle({name}))", "rad/s", "Rate of the angle") for name in names]
    return Coordinates(
        Ports([*(ports[k] for k in kept), *angles, *angular_rates]),
        tuple(kept),
        n,
        ca.Function("expand", [c], [full]),
        ca.Function("reduce", [x], [ca.vertcat(x[kept], angle, rate)]),
        functionals,
        tuple(speeds),
    )
