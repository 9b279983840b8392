"""Linearizations of models with stabilised constraints: minimal coordinates, without the stabilisation's poles."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, discrete, fixed, guess, quantity, variable
from acausal.errors import ExportError
from acausal.models.double_pendulum import DoublePendulum


class Swing(Component):
    """A point mass on a circle of radius 2, in x and y: no fixed choice of two states is safe."""

    x: Real = variable(default=fixed(0.5))
    y: Real = variable(default=guess(-1.0))
    vx: Real = variable(default=fixed(0.0))
    vy: Real = variable()
    f: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.x * self.f
        yield der(self.vy) == -self.y * self.f - 9.81
        yield self.x**2 + self.y**2 == 4.0


def test_only_the_modes_of_the_motion_are_left() -> None:
    """At rest below: omega**2 = g / l."""
    linear = acausal.linearize(Swing(), x={"x": 0.0, "vx": 0.0}, outputs=["y", "f"])
    assert linear.states == ("x", "vx")
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [-9.81 / 2.0, 0.0]], atol=1e-12)
    # y has its lowest value there, and the force depends on the square of the velocity
    np.testing.assert_allclose(linear.C, 0.0, atol=1e-12)
    np.testing.assert_allclose(linear.y, [-2.0, 9.81 / 2.0], rtol=1e-12)
    np.testing.assert_allclose(linear.rates, 0.0, atol=1e-12)


def test_the_coordinates_are_those_that_determine_the_others_best_at_the_point() -> None:
    """At the height of the pivot, y moves and x stands still: x'' = -v**2/l, y'' = -g."""
    linear = acausal.linearize(Swing(), x={"x": 2.0, "y": 0.0, "vy": 0.0})
    assert linear.states == ("y", "vy")
    np.testing.assert_allclose(linear.rates, [0.0, -9.81], atol=1e-12)


def test_states_off_the_constraints_are_refused() -> None:
    with pytest.raises(ExportError, match="AC609"):
        acausal.linearize(Swing(), x={"x": 1.0, "y": 1.0})


def test_states_that_are_not_named_follow() -> None:
    linear = acausal.linearize(Swing(), x={"x": 1.2}, outputs=["y"])
    assert linear.y[0] == pytest.approx(-1.6)


def test_chosen_and_stabilised_states_have_the_same_modes() -> None:
    """Both hang straight down, where the modes of a system do not depend on its coordinates."""
    down = {"revolute1.phi": -math.pi / 2, "revolute1.w": 0.0, "revolute2.phi": 0.0, "revolute2.w": 0.0}
    found = []
    for formulation in ("torn", "projected"):
        compiled = acausal.compile(DoublePendulum(), formulation=formulation)
        linear = acausal.linearize(compiled, x=down)
        np.testing.assert_allclose(linear.rates, 0.0, atol=1e-10)
        np.testing.assert_allclose(linear.eigenvalues.real, 0.0, atol=1e-7)
        found.append(np.sort(linear.eigenvalues.imag))
    assert len(found[0]) == len(found[1]) == 4
    np.testing.assert_allclose(found[1], found[0], atol=1e-7)


class Telescope(Component):
    """A pendulum in x and y, whose length only events change."""

    length: Real = discrete(unit="m", default=fixed(1.0))
    x: Real = variable(unit="m", default=guess(0.6))
    y: Real = variable(unit="m", default=guess(-0.8))
    vx: Real = variable(unit="m/s")
    vy: Real = variable(unit="m/s")
    f: Real = variable(unit="1/s2")

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.x * self.f
        yield der(self.vy) == -self.y * self.f - quantity(9.81, "m/s2")
        yield self.x**2 + self.y**2 == self.length**2


def test_no_constraint_changes_a_discrete_variable() -> None:
    """omega**2 = g / l; a place off the circle of the present length is refused, not a reason for another length."""
    linear = acausal.linearize(Telescope(), x={"length": 1.2, "x": 0.0, "vx": 0.0})
    assert linear.states == ("x", "vx")
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [-9.81 / 1.2, 0.0]], atol=1e-12)
    with pytest.raises(ExportError, match="AC609"):
        acausal.linearize(Telescope(), x={"x": 0.0, "y": -1.2})
