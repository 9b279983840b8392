"""Claim: a problem stated on a model builds and solves in at most 1.2 times the time of CasADi written by hand.

Three examples of docs/optimal-control.md are compared with programs written for each problem, with equations derived by
hand: the swing-up in the angle, an arm by the recursion of Newton and Euler, drilling in four phases. Both use Radau
IIA with three points, the same meshes, the same inputs and ipopt. Steps that the program by hand does not do are listed
separately: the compilation of the model, the run for the guess, and the check of the answer by IDAS.

    python benchmarks/optimal_control_by_hand.py [swing-up] [arm] [drilling]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.models.optimal_control import cart_pole, plate_drilling, robot_arm
from acausal.optimal_control import Problem

QUIET = {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8}, "print_time": False, "detect_simple_bounds": True}
TAU = ca.collocation_points(3, "radau")
SLOPES, _, WEIGHTS = ca.collocation_coeff(TAU)
# Inputs are parabolas, given by their Bernstein coefficients, as in acausal.
BERNSTEIN = np.array([[(1 - t) ** 2 for t in TAU], [2 * t * (1 - t) for t in TAU], [t * t for t in TAU]])


@dataclass
class Measured:
    """Seconds and results of one side."""

    build: float
    solve: float
    objective: float
    iterations: int


@dataclass
class Phase:
    """Unknowns of one phase of a program by hand, in SI; columns are points."""

    x: Any
    u: Any
    at: Any
    T: Any
    z: Any


def phase(
    opti: Any, ode: Any, n: int, T: Any, x_size: Sequence[float], u_size: Sequence[float], z_size: Sequence[float] = ()
) -> Phase:
    """Collocation of x' = ode(x, u) over a time T in n intervals; of x', 0 = ode(x, u, z) with algebraic variables."""
    sx, su = ca.DM(x_size), ca.DM(u_size)
    X, U = opti.variable(len(x_size), 3 * n + 1), opti.variable(len(u_size), 3 * n)
    x, u = sx * X, su * U
    at = u @ ca.kron(ca.DM.eye(n), BERNSTEIN)
    z = ca.DM(z_size) * opti.variable(len(z_size), 3 * n) if z_size else None
    if z is None:
        rate = ode.map(3 * n)(x[:, 1:], at)
    else:
        rate, residual = ode.map(3 * n)(x[:, 1:], at, z)
        opti.subject_to(ca.vec(residual) == 0)
    for k in range(n):
        inside = slice(3 * k, 3 * k + 3)
        opti.subject_to(ca.vec(X[:, 3 * k : 3 * k + 4] @ SLOPES - T / n * rate[:, inside] / sx) == 0)
    opti.subject_to(opti.bounded(-1, ca.vec(U), 1))
    return Phase(x, u, at, T, z)


def finished(opti: Any, began: float) -> Measured:
    opti.solver("ipopt", QUIET)
    built = time.process_time()
    found = opti.solve()
    ended = time.process_time()
    return Measured(built - began, ended - built, float(found.value(opti.f)), int(found.stats()["iter_count"]))


def swing_up_by_hand() -> Measured:
    """Lagrange's equations in the angle from hanging."""
    began = time.process_time()
    m_c, m, L, g, n, T = 1.0, 0.3, 0.5, 9.81, 20, 2.0
    x, f = ca.SX.sym("x", 4), ca.SX.sym("f")
    _, v, phi, w = ca.vertsplit(x)
    a = (f + m * L * ca.sin(phi) * w**2 + m * g * ca.sin(phi) * ca.cos(phi)) / (m_c + m * ca.sin(phi) ** 2)
    ode = ca.Function("ode", [x, f], [ca.vertcat(v, a, w, -(g * ca.sin(phi) + ca.cos(phi) * a) / L)])
    opti = ca.Opti()
    one = phase(opti, ode, n, T, [1, 1, np.pi, 1], [20])
    opti.subject_to(one.x[:, 0] == 0)
    opti.subject_to(one.x[:, -1] == ca.DM([1, 0, np.pi, 0]))
    opti.minimize(T / n * (one.at**2) @ ca.repmat(WEIGHTS, n, 1))
    line = np.linspace(0, 1, 3 * n + 1)
    opti.set_initial(one.x[0, :], line)
    opti.set_initial(one.x[2, :], np.pi * line)
    return finished(opti, began)


def arm_dynamics(joints: int) -> Any:
    """x' of angles and rates: mass matrix and bias by the recursion of Newton and Euler (Luh, Walker, Paul 1980)."""
    q, w, tau = (ca.SX.sym(n, joints) for n in ("q", "w", "tau"))

    def rotation(axis: Sequence[float], angle: Any) -> Any:
        e = ca.DM(axis)
        return ca.SX.eye(3) * ca.cos(angle) + (1 - ca.cos(angle)) * (e @ e.T) + ca.sin(angle) * ca.skew(e)

    bodies = []  # in the frame of joint k: mass, centre, inertia
    for k in range(joints):
        bodies.append([(robot_arm.MASSES[k], ca.DM(robot_arm.CENTRES[k]), ca.diag(ca.DM(robot_arm.INERTIAS[k])))])
    centre = ca.DM(robot_arm.WAYS[joints - 1]) + ca.DM(robot_arm.LOAD_CENTRE)
    bodies[-1].append((robot_arm.LOAD, centre, 0.001 * ca.DM.eye(3)))

    def torques(rates: Any, accelerations: Any, gravity: float) -> Any:
        omega, alpha, acc = ca.SX(3, 1), ca.SX(3, 1), ca.SX([0, gravity, 0])
        forward = []
        for k in range(joints):
            R, e = rotation(robot_arm.AXES[k], q[k]), ca.DM(robot_arm.AXES[k])
            omega, alpha, acc = R.T @ omega, R.T @ alpha, R.T @ acc
            alpha = alpha + e * accelerations[k] + ca.cross(omega, e * rates[k])
            omega = omega + e * rates[k]
            force, moment = ca.SX(3, 1), ca.SX(3, 1)
            for m, c, inertia in bodies[k]:
                f = m * (acc + ca.cross(alpha, c) + ca.cross(omega, ca.cross(omega, c)))
                force += f
                moment += ca.cross(c, f) + inertia @ alpha + ca.cross(omega, inertia @ omega)
            way = ca.DM(robot_arm.WAYS[k])
            forward.append((R, e, way, force, moment))
            acc = acc + ca.cross(alpha, way) + ca.cross(omega, ca.cross(omega, way))
        found = [ca.SX(0)] * joints
        force, moment = ca.SX(3, 1), ca.SX(3, 1)
        for k in reversed(range(joints)):
            R, e, way, own, turning = forward[k]
            # The loads of the next joint are already resolved in the frame of this one.
            moment = turning + moment + ca.cross(way, force)
            force = own + force
            found[k] = ca.dot(e, moment) + robot_arm.ROTORS[k] * accelerations[k]
            force, moment = R @ force, R @ moment
        return ca.vertcat(*found)

    bias = torques(w, ca.SX(joints, 1), 9.80665)
    columns = [torques(ca.SX(joints, 1), ca.SX(ca.DM.eye(joints)[:, k]), 0.0) for k in range(joints)]
    mass = ca.horzcat(*columns)
    return ca.Function("ode", [ca.vertcat(q, w), tau], [ca.vertcat(w, ca.solve(mass, tau - bias))])


def arm_by_hand(joints: int = 3, intervals: int = 12, price: float = 0.01) -> Measured:
    began = time.process_time()
    goal, limits = [1.2, -0.8, 1.0][:joints], robot_arm.LIMITS[:joints]
    opti = ca.Opti()
    T = opti.variable()
    one = phase(opti, arm_dynamics(joints), intervals, T, [1.0] * (2 * joints), limits)
    opti.subject_to(opti.bounded(0.1, T, 5.0))
    opti.subject_to(one.x[:, 0] == 0)
    opti.subject_to(one.x[:, -1] == ca.DM([*goal, *[0.0] * joints]))
    effort = ca.sum1((one.at / ca.DM(limits)) ** 2)
    opti.minimize(T + price * T / intervals * effort @ ca.repmat(WEIGHTS, intervals, 1))
    line = np.linspace(0, 1, 3 * intervals + 1)
    for k in range(joints):
        opti.set_initial(one.x[k, :], goal[k] * line)
    opti.set_initial(T, 1.0)
    return finished(opti, began)


def drilling_by_hand(intervals: int = 5) -> Measured:
    """States: depth, feed rate, bottom of the hole, angular velocity; the feed per edge is algebraic."""
    began = time.process_time()
    d, kappa, z_E, k_c11, z, t, m = 16e-3, np.radians(59.0), 2, 2240e6, 0.21, 20e-3, 50.0
    k, d_c, slope = 1e8, 2e4, 2 * np.tan(np.radians(59.0))
    h_c = d / slope
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    s, v, ground, w = ca.vertsplit(x)
    n = w / (2 * np.pi)
    f = ca.SX.sym("f")
    laws = {}
    diameters = {
        "air": (ca.SX(0), ca.SX(0)),
        "entering": (slope * s, ca.SX(0)),
        "full": (ca.SX(d), ca.SX(0)),
        "leaving": (ca.SX(d), slope * (s - t)),
    }
    for name, (outer, inner) in diameters.items():
        cuts = 0.0 if name == "air" else 1.0
        cutting = cuts * z_E / 2 * k_c11 * (np.sin(kappa) / 1e-3) ** -z * (outer - inner) * f ** (1 - z)
        thrust, torque = np.sin(2 * kappa) * cutting, cutting * (outer + inner) / 4
        pressing = k * (s - ground) + d_c * v - thrust - d_c * z_E * n * f
        rates = ca.vertcat(v, (u[0] - thrust) / m, cuts * z_E * n * f, (2 * np.pi * u[1] - w) / 0.05)
        residual = pressing / 1e3 if name != "air" else f / 1e-4 - 1
        laws[name] = (
            ca.Function("ode", [x, u, f], [rates, residual]),
            ca.Function("y", [x, u, f], [ca.vertcat(thrust, torque, torque * w)]),
        )
    opti = ca.Opti()
    sizes = [1e-2, 1e-3, 1e-3, 60.0]
    begin, before, total = ca.DM([-1e-3, 5e-3, 0.0, 20 * np.pi]), None, 0
    edges, feeds = [-1e-3, 0.0, h_c, t, t + h_c], [5e-3, 1.5e-3, 0.54e-3, 1e-3]
    for j, (name, (ode, outputs)) in enumerate(laws.items()):
        expected = (edges[j + 1] - edges[j]) / feeds[j]
        scaled = opti.variable()
        opti.subject_to(scaled >= 1e-6)
        opti.set_initial(scaled, 1.0)
        one = phase(opti, ode, intervals, expected * scaled, sizes, [6e3, 20.0], [1e-4])
        opti.subject_to(ca.vec(one.z) / 1e-4 >= 1e-4)
        opti.set_initial(one.z, 5e-5)
        opti.subject_to(ca.vec(one.u[0, :]) / 6e3 >= 0)
        opti.subject_to(ca.vec(one.u[1, :]) / 20 >= 1 / 20)
        opti.subject_to((one.x[:, 0] - (begin if before is None else before)) / ca.DM(sizes) == 0)
        opti.subject_to((one.x[0, -1] - edges[j + 1]) / 1e-2 == 0)
        y = outputs.map(3 * intervals)(one.x[:, 1:], one.at, one.z)
        opti.subject_to(ca.vec(y / ca.DM([4e3, 20.0, 1e3])) <= 1)
        opti.subject_to(ca.vec(one.x[1, 1:]) / 1e-3 <= (5 if name == "leaving" else 20))
        shares = np.linspace(0, 1, 3 * intervals + 1)
        depth = edges[j] + (edges[j + 1] - edges[j]) * shares
        ground = np.maximum(depth - 2e-5, 0.0)
        guess = [depth, np.full_like(depth, feeds[j]), ground, np.full_like(depth, 2 * np.pi * 9.28)]
        opti.set_initial(one.x, np.array(guess))
        opti.set_initial(one.u[0, :], 2e3)
        opti.set_initial(one.u[1, :], 9.28)
        before, total = one.x[:, -1], total + one.T
    opti.minimize(total)
    return finished(opti, began)


def on_the_model(stated: Callable[[], Problem]) -> tuple[Measured, float, float, float]:
    """The same on a model; processor seconds of its compilation, of the guess, and of the check."""
    began = time.process_time()
    problem = stated()
    compiled = time.process_time()
    best = problem.solve()
    stats: Any = best.stats
    measured = Measured(stats["build"], stats["solve"], best.objective, stats["iterations"])
    return measured, compiled - began, stats["guess"], stats["check"]


EXAMPLES: dict[str, tuple[Callable[[], Problem], Callable[[], Measured]]] = {
    "swing-up": (cart_pole.swing_up, swing_up_by_hand),
    "arm": (lambda: robot_arm.point_to_point(3), arm_by_hand),
    "drilling": (plate_drilling.least_time, drilling_by_hand),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", nargs="*", choices=[*EXAMPLES, []], default=[], help="all by default")
    chosen = parser.parse_args().examples or list(EXAMPLES)
    print("            objective        iterations    build and solve s   ratio   a step ms    compile, guess, check s")
    for name in chosen:
        stated, by_hand = EXAMPLES[name]
        on_the_model(stated)  # libraries are loaded once
        ours, *others = on_the_model(stated)
        hand = by_hand()
        both = ours.build + ours.solve, hand.build + hand.solve
        steps = 1e3 * ours.solve / ours.iterations, 1e3 * hand.solve / hand.iterations
        print(
            f"{name:10s} {ours.objective:10.6f} {hand.objective:10.6f}  {ours.iterations:3d} {hand.iterations:3d}"
            f"    {both[0]:7.3f} {both[1]:7.3f}   {both[0] / both[1]:6.2f}   {steps[0]:5.1f} {steps[1]:5.1f}"
            f"   {others[0]:6.3f} {others[1]:6.3f} {others[2]:6.3f}"
        )


if __name__ == "__main__":
    main()
