"""Linearizations of random mechanisms against matrices by other means: Lagrange's equations, and M, D, K by hand."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.linalg

import acausal
from acausal import Component, Equations, Real, connect, fixed, part, signal_input, structural
from acausal.library.multibody import BodyShape, Prismatic, Revolute, World
from acausal.library.rotational import Fixed, IdealGear, Inertia, SpringDamper, Torque
from acausal.library.translational import SpringDamper as LinearSpringDamper


def links(seed: int) -> list[dict[str, Any]]:
    """Joints and bodies of a tree: each hangs on the end of an earlier body, or on the world."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(int(random.integers(2, 5))):
        root = random.normal(size=(3, 3))
        n = random.normal(size=3)
        found.append(
            {
                "parent": int(random.integers(-1, k)) if k else -1,
                "turns": bool(random.random() < 0.7),
                "n": n / np.linalg.norm(n),
                "r": 0.4 * random.normal(size=3),
                "r_CM": 0.2 * random.normal(size=3),
                "m": random.uniform(0.3, 3.0),
                "I": 0.01 * root @ root.T + 0.01 * np.eye(3),
                "c": random.uniform(0.0, 50.0),
                "d": random.uniform(0.0, 2.0),
                "q": 0.8 * random.normal(),
                "v": 2.0 * random.normal(),
            }
        )
    return found


class Tree(Component):
    """The tree of a seed, with a spring and a damper in each joint, moving."""

    seed: int = structural(default=0)
    world: World = World(n=(0.0, 0.0, -1.0))
    joints: list[Revolute | Prismatic] = part()
    bodies: list[BodyShape] = part()
    springs: list[SpringDamper | LinearSpringDamper] = part()

    def build(self) -> None:
        self.joints, self.bodies, self.springs = [], [], []
        for s in links(self.seed):
            q, v, n, I = fixed(s["q"]), fixed(s["v"]), tuple(s["n"]), s["I"]  # noqa: E741  (the inertia)
            self.joints.append(Revolute(n=n, phi=q, w=v) if s["turns"] else Prismatic(n=n, s=q, v=v))
            inertia = {f"I_{i + 1}{k + 1}": I[i, k] for i in range(3) for k in range(i + 1)}
            self.bodies.append(BodyShape(m=s["m"], r=tuple(s["r"]), r_CM=tuple(s["r_CM"]), **inertia))
            self.springs.append((SpringDamper if s["turns"] else LinearSpringDamper)(c=s["c"], d=s["d"]))

    def equations(self) -> Equations:
        for k, s in enumerate(links(self.seed)):
            joint, spring = self.joints[k], self.springs[k]
            yield connect(self.world.frame_b if s["parent"] < 0 else self.bodies[s["parent"]].frame_b, joint.frame_a)
            yield connect(joint.frame_b, self.bodies[k].frame_a)
            yield connect(joint.support, spring.flange_a)
            yield connect(joint.axis, spring.flange_b)


def lagrange(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rates, shape (2 n,), and their matrix, for coordinates and speeds: d/dt dL/dv = dL/dq - d v."""
    tree = links(seed)
    q, v = ca.SX.sym("q", len(tree)), ca.SX.sym("v", len(tree))
    poses: list[tuple[Any, Any]] = []
    energy, work, power = ca.SX(0), ca.SX(0), ca.SX(0)
    for k, s in enumerate(tree):
        R, p = poses[s["parent"]] if s["parent"] >= 0 else (ca.SX.eye(3), ca.SX(3, 1))
        p = p + R @ ca.DM(tree[s["parent"]]["r"]) if s["parent"] >= 0 else p
        K = ca.skew(ca.DM(s["n"]))
        poses.append(
            (R @ (ca.SX.eye(3) + ca.sin(q[k]) * K + (1 - ca.cos(q[k])) * K @ K), p)  # Rodrigues
            if s["turns"]
            else (R, p + R @ ca.DM(s["n"]) * q[k])
        )
        R, p = poses[-1]
        centre = p + R @ ca.DM(s["r_CM"])
        speed = ca.jtimes(centre, q, v)
        w = ca.inv_skew(R.T @ ca.reshape(ca.jtimes(ca.vec(R), q, v), 3, 3))
        energy += s["m"] / 2 * ca.dot(speed, speed) + ca.dot(w, ca.DM(s["I"]) @ w) / 2
        work += 9.80665 * s["m"] * centre[2] + s["c"] / 2 * q[k] ** 2
        power += s["d"] / 2 * v[k] ** 2
    momentum = ca.gradient(energy, v)
    force = ca.gradient(energy - work, q) - ca.jtimes(momentum, q, v) - ca.gradient(power, v)
    x, rates = ca.vertcat(q, v), ca.vertcat(v, ca.solve(ca.jacobian(momentum, v), force))
    found = ca.Function("f", [x], [rates, ca.jacobian(rates, x)])([*(s["q"] for s in tree), *(s["v"] for s in tree)])
    return np.array(found[0]).ravel(), np.array(found[1])


@pytest.mark.parametrize("seed", [1, 5])
def test_trees_have_the_matrix_of_lagrange(seed: int) -> None:
    linear = acausal.linearize(Tree(seed=seed))
    kinds = [("phi", "w") if s["turns"] else ("s", "v") for s in links(seed)]
    places = [linear.states.index(f"joints[{k}].{kind[level]}") for level in (0, 1) for k, kind in enumerate(kinds)]
    rates, matrix = lagrange(seed)
    np.testing.assert_allclose(linear.rates[places], rates, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(linear.A[np.ix_(places, places)], matrix, rtol=1e-9, atol=1e-9 * np.abs(matrix).max())


class Gears(Component):
    """Inertias in a ring of springs and dampers, one of them held, some coupled by gears; driven at the first."""

    seed: int = structural(default=0)
    u: Real = signal_input(unit="N.m", default=0.0)
    inertias: list[Inertia] = part()
    springs: list[SpringDamper] = part()
    gears: list[IdealGear] = part()
    wall: Fixed = Fixed()
    torque: Torque = Torque()

    def build(self) -> None:
        J, c, d, ratios = self.numbers(self.seed)
        self.inertias = [Inertia(J=float(x)) for x in J]
        self.springs = [SpringDamper(c=float(a), d=float(b)) for a, b in zip(c, d, strict=True)]
        self.gears = [IdealGear(ratio=float(x)) for x in ratios]

    @staticmethod
    def numbers(seed: int) -> tuple[np.ndarray, ...]:
        """Inertias, stiffnesses and dampings of n, and up to n - 1 ratios of neighbours."""
        random = np.random.default_rng(seed)
        n = int(random.integers(2, 6))
        ratios = random.choice([-3.0, -1.5, 0.5, 2.0], int(random.integers(n)))
        return random.uniform(0.1, 3.0, n), random.uniform(1.0, 99.0, n), random.uniform(0.0, 3.0, n), ratios

    def equations(self) -> Equations:
        ends = [*(inertia.flange_a for inertia in self.inertias[1:]), self.wall.flange]
        for k, spring in enumerate(self.springs):
            yield connect(self.inertias[k].flange_b, spring.flange_a)
            yield connect(spring.flange_b, ends[k])
        for k, gear in enumerate(self.gears):
            yield connect(self.inertias[k].flange_b, gear.flange_a)
            yield connect(gear.flange_b, self.inertias[k + 1].flange_b)
        yield connect(self.torque.flange, self.inertias[0].flange_a)
        yield self.torque.u == self.u


@pytest.mark.parametrize("seed", range(4))
def test_trains_of_gears_have_the_transfer_function_of_their_matrices(seed: int) -> None:
    """N (s^2 N'MN + s N'DN + N'KN)^-1 N'b, where N spans the motions that the gears allow."""
    J, c, d, ratios = Gears.numbers(seed)
    n = len(J)
    along = np.eye(n) - np.eye(n, k=1)  # what each spring is wound by
    gears = np.array([np.eye(n)[k] - x * np.eye(n)[k + 1] for k, x in enumerate(ratios)]).reshape(-1, n)
    N = scipy.linalg.null_space(gears) if len(gears) else np.eye(n)
    linear = acausal.linearize(Gears(seed=seed), outputs=[f"inertias[{n - 1}].phi", "inertias[0].a"])
    for s in (0.3j, 2j, 11j):
        stiffness = s * s * np.diag(J) + along.T @ np.diag(c + s * d) @ along
        phi = N @ np.linalg.solve(N.T @ stiffness @ N, N.T @ np.eye(n)[0])
        found = linear.C @ np.linalg.solve(s * np.eye(len(linear.A)) - linear.A, linear.B) + linear.D
        np.testing.assert_allclose(found.ravel(), [phi[-1], s * s * phi[0]], rtol=1e-9)
