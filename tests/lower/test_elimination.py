"""Elimination of linear blocks: which pivots are taken, and that the result solves the equations."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, cos, der, fixed, parameter, sin, structural, time, variable
from acausal.analyse.blocks import elimination
from acausal.models.pendulum_chain import PendulumChain


class Turned(Component):
    """A vector resolved in a frame that turns: cos and sin both vanish somewhere, the determinant is 1 everywhere."""

    T: Real = parameter(default=1.0, unit="s")
    q: Real = variable(default=fixed(0.3), unit="rad")
    a: Real = variable(unit="1")
    b: Real = variable(unit="1")

    def equations(self) -> Equations:
        yield der(self.q) * self.T == 1.0 + 0.1 * self.a
        yield cos(self.q) * self.a - sin(self.q) * self.b == 2.0
        yield sin(self.q) * self.a + cos(self.q) * self.b == time / self.T - 1.0


class Degenerate(Component):
    """The same with a determinant of cos(2*q), which changes its sign."""

    T: Real = parameter(default=1.0, unit="s")
    q: Real = variable(default=fixed(0.3), unit="rad")
    a: Real = variable(unit="1")
    b: Real = variable(unit="1")

    def equations(self) -> Equations:
        yield der(self.q) * self.T == 0.01 * self.a
        yield cos(self.q) * self.a + sin(self.q) * self.b == 2.0
        yield sin(self.q) * self.a + cos(self.q) * self.b == 1.0


def test_two_equations_are_solved_for_two_unknowns_at_once() -> None:
    compiled = acausal.compile(Turned())
    assert compiled.algebraic == ()
    run = acausal.simulate(compiled, stop_time=6.0, tolerance=1e-9)
    # the inverse of a rotation is its transpose
    q, t = run["q"], run.time
    np.testing.assert_allclose(run["a"], 2.0 * np.cos(q) + (t - 1.0) * np.sin(q), atol=1e-13)
    np.testing.assert_allclose(run["b"], -2.0 * np.sin(q) + (t - 1.0) * np.cos(q), atol=1e-13)
    assert q[-1] > math.pi  # cos and sin have both gone through zero


def test_a_determinant_that_vanishes_somewhere_leaves_both_to_the_solver() -> None:
    assert len(acausal.compile(Degenerate()).algebraic) == 2


@pytest.mark.parametrize("n", [1, 4, 7, 16])
def test_a_chain_of_bodies_leaves_no_algebraic_variable(n: int) -> None:
    """The equations of motion are solved symbolically, as the mass matrix is positive definite in every position."""
    compiled = acausal.compile(PendulumChain(n=n))
    assert len(compiled.states) == 2 * n
    assert compiled.algebraic == ()


def test_chain_keeps_its_energy() -> None:
    """Released from the horizontal at rest, the energy stays zero: as much kinetic energy as height lost."""
    n = 6
    run = acausal.simulate(PendulumChain(n=n), stop_time=3.0, tolerance=1e-9)
    phi, w = (np.array([run[f"joints[{k}].{name}"] for k in range(n)]) for name in ("phi", "w"))
    angle, rate = np.cumsum(phi, axis=0), np.cumsum(w, axis=0)
    height, vx, vy, energy = 0.0, 0.0, 0.0, 0.0
    for k in range(n):  # links of 1 kg and 0.5 m, centre in the middle, I_33 = 0.02 kg.m2 about it
        mid = height + 0.25 * np.sin(angle[k])
        ux, uy = vx - 0.25 * rate[k] * np.sin(angle[k]), vy + 0.25 * rate[k] * np.cos(angle[k])
        energy = energy + 9.80665 * mid + 0.5 * (ux**2 + uy**2) + 0.01 * rate[k] ** 2
        height, vx, vy = height + 0.5 * np.sin(angle[k]), 2 * ux - vx, 2 * uy - vy
    assert np.abs(energy).max() < 1e-5


class Star(Component):
    """A node that everything is connected to: one equation of n terms, which every pivot shortens by one."""

    n: int = structural(default=10)
    k: Real = parameter(default=2.0)
    x: Real = variable(shape=400)
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.y == sum(self.x[i] for i in range(self.n)) - 1.0
        for i in range(400):
            yield self.k * self.x[i] + self.y * (i < self.n) == float(i)


def test_work_grows_in_proportion_to_a_long_equation(monkeypatch: pytest.MonkeyPatch) -> None:
    offers: list[int] = []
    offer = elimination._Work._offer

    def counted(self: elimination._Work, i: int, v: int, c: int) -> None:
        offers.append(i)
        offer(self, i, v, c)

    monkeypatch.setattr(elimination._Work, "_offer", counted)
    counts = []
    for n in (100, 400):
        offers.clear()
        acausal.compile(Star(n=n), cache=False)
        counts.append(len(offers))
    assert counts[1] < 6 * counts[0]  # 15 times when all of it is looked at again at every step
