"""Angles in place of constraints: the same problems as with angles written by hand."""

from __future__ import annotations

import numpy as np
import pytest

from acausal import (
    Component,
    Equations,
    Real,
    cos,
    der,
    fixed,
    guess,
    parameter,
    pre,
    quantity,
    reset,
    signal_input,
    sin,
    variable,
    when,
)
from acausal.errors import UsageError
from acausal.models.optimal_control.cart_pole import CartPole, swing_up
from acausal.optimal_control import Optimum, Problem
from tests.expected import fails_with


class CartPoleByAngle(Component):
    """The cart and the pendulum of `CartPole` by Lagrange's equations in the angle from hanging; numbers in SI."""

    f: Real = signal_input(min=-20.0, max=20.0, doc="Push on the cart")
    s: Real = variable(default=fixed(0.0), doc="Position of the cart")
    v: Real = variable(default=fixed(0.0), doc="Velocity of the cart")
    phi: Real = variable(default=fixed(0.0), doc="Angle")
    w: Real = variable(default=fixed(0.0), doc="Its rate")

    def equations(self) -> Equations:
        m_c, m, L, g = 1.0, 0.3, 0.5, 9.81
        yield der(self.s) == self.v
        yield der(self.phi) == self.w
        push = self.f + m * L * sin(self.phi) * self.w**2
        yield (m_c + m) * der(self.v) + m * L * cos(self.phi) * der(self.w) == push
        yield cos(self.phi) * der(self.v) + L * der(self.w) == -g * sin(self.phi)


def by_angle(intervals: int) -> Optimum:
    problem = Problem(CartPoleByAngle())
    problem.phase(duration=2.0, intervals=intervals)
    for name, value in {"s": 1.0, "v": 0.0, "phi": np.pi, "w": 0.0}.items():
        problem.subject_to(problem.end(name) == value)
    problem.minimize(problem.integral(problem["f"] ** 2))
    problem.guess(lines={"s": (0.0, 1.0), "phi": (0.0, np.pi)})
    return problem.solve()


def test_small_errors_that_grow_are_told() -> None:
    """Upright a pendulum leaves its way: what is told before is how far IDAS goes elsewhere with the inputs alone."""
    problem = Problem(CartPole(m=0.58, m_c=1.1, length=0.77, y=guess(-0.77)))
    problem.phase(duration=2.54, intervals=25)
    for name, value in {"s": 1.19, "v": 0.0, "x": 1.19, "v_x": 0.0}.items():
        problem.subject_to(problem.end(name) == value)
    problem.subject_to(problem.end("y") >= 0.0)
    problem.minimize(problem.integral(problem["f"] ** 2))
    problem.guess(lines={"s": (0.0, 1.19), "angle(s, x, y)": (0.0, np.pi)})
    best = problem.solve()
    interval, told = best.stats["interval_error"], best.stats["replay_error"]
    assert isinstance(interval, float)
    assert isinstance(told, float)
    assert interval < 1e-3 < 1e-2 < told
    assert told == pytest.approx(max(best.error(best.replay()).values()), rel=0.3)
    notes = best.stats["notes"]
    assert isinstance(notes, tuple)
    assert any("these inputs deviates" in note for note in notes)


def test_pendulum_in_x_and_y_is_searched_in_its_angle() -> None:
    """As many iterations, and the same optimum, as Lagrange's equations; every point lies on the rod."""
    best, hand = swing_up().solve(), by_angle(20)
    assert best.objective == pytest.approx(hand.objective, rel=1e-7)
    iterations = best.stats["iterations"], hand.stats["iterations"]
    assert isinstance(iterations[0], int)
    assert isinstance(iterations[1], int)
    assert iterations[0] <= iterations[1] + 1
    t = np.linspace(0.0, 2.0, 77)
    x, y, s = (np.asarray(best.at(t, n)) for n in ("x", "y", "s"))
    np.testing.assert_allclose((x - s) ** 2 + y**2, 0.25, rtol=1e-12)
    np.testing.assert_allclose(y, -0.5 * np.cos(np.asarray(hand.at(t, "phi"))), atol=1e-6)


def test_swing_up_on_a_refined_mesh_is_replayed() -> None:
    best = swing_up().solve(accuracy=1e-6)
    assert max(best.error(best.replay()).values()) < 2e-4


class TwoRods(Component):
    """Two masses on rods below each other in x and y, pushed sideways at the lower one; numbers in SI."""

    f: Real = signal_input(default=0.0, doc="Push")
    L: Real = parameter(default=1.0, doc="Length of the lower rod")
    x: Real = variable(shape=2, default=fixed((0.6, 1.4)), doc="To the side")
    y: Real = variable(shape=2, default=guess((-0.8, -1.4)), doc="Heights")
    v: Real = variable(shape=2, default=fixed((0.0, 0.0)), doc="Velocities to the side")
    w: Real = variable(shape=2, doc="Velocities upward")
    pull: Real = variable(shape=2, doc="Pulls of the rods by their lengths")

    def equations(self) -> Equations:
        dx, dy = self.x[1] - self.x[0], self.y[1] - self.y[0]
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v[0]) == -self.pull[0] * self.x[0] + self.pull[1] * dx
        yield der(self.w[0]) == -self.pull[0] * self.y[0] + self.pull[1] * dy - 9.81
        yield der(self.v[1]) == self.f - self.pull[1] * dx
        yield der(self.w[1]) == -self.pull[1] * dy - 9.81
        yield self.x[0] ** 2 + self.y[0] ** 2 == 1.0
        yield dx**2 + dy**2 == self.L**2


def test_a_chain_of_rods_has_an_angle_for_each() -> None:
    """Four coordinates for eight states; brought to rest hanging down, where x is 0 and y is -1 and -2."""
    problem = Problem(TwoRods())
    problem.phase(duration=3.0, intervals=30)
    names = problem.quantities.x.names
    assert len(problem.compiled.states) == 8
    assert len(names) == 4
    for k in range(2):
        problem.subject_to(problem.end(f"x[{k}]") == 0.0)
        problem.subject_to(problem.end(f"v[{k}]") == 0.0)
    problem.minimize(problem.integral(problem["f"] ** 2))
    best = problem.solve()
    np.testing.assert_allclose(best.final("y"), [-1.0, -2.0], atol=1e-9)
    assert max(best.error(best.replay()).values()) < 1e-3


def test_the_length_of_a_circle_is_no_decision() -> None:
    with fails_with(UsageError, "AC053", match="angle"):
        Problem(CartPole()).decide("length", min=0.3, max=0.6)
    assert Problem(CartPole()).decide("m", min=0.1, max=1.0) is not None


class Clapper(Component):
    """A mass on a rod in x and y, hanging to the right of a wall that gives back the share `e` of its speed."""

    length: Real = parameter(default=0.8, unit="m", min=0.0, doc="Length of the rod")
    e: Real = parameter(default=0.6, unit="1", doc="Coefficient of restitution")
    x: Real = variable(unit="m", default=fixed(0.8 * 0.6), doc="Distance from the wall")
    y: Real = variable(unit="m", default=guess(-0.8 * 0.8), doc="Height above the pivot")
    v_x: Real = variable(unit="m/s", default=fixed(0.0), doc="Velocity")
    v_y: Real = variable(unit="m/s", default=guess(0.0), doc="Velocity, upward")
    pull: Real = variable(unit="1/s2", nominal=10.0, doc="Pull of the rod by its length and the mass")

    def equations(self) -> Equations:
        yield der(self.x) == self.v_x
        yield der(self.y) == self.v_y
        yield der(self.v_x) == -self.pull * self.x
        yield der(self.v_y) == -self.pull * self.y - quantity(9.81, "m/s2")
        yield self.x**2 + self.y**2 == self.length**2
        yield when(self.x < 0.0, reset(self.v_x, -self.e * pre(self.v_x)), reset(self.v_y, -self.e * pre(self.v_y)))


@pytest.mark.parametrize("height", [0.3, 0.5])
def test_events_end_phases_of_models_with_angles(height: float) -> None:
    """Let go with the least speed so that it gets `height` above its lowest point after the blow: by energy."""
    problem = Problem(Clapper(), free_start=["der(angle(x, y))"])
    problem.phase("falling", until="x < 0", duration=(0.05, 3.0), intervals=6, expected=0.6)
    rising = problem.phase("rising", duration=(0.05, 0.8), intervals=6, expected=0.2)
    problem.subject_to(rising.end("y") == height - 0.8)
    problem.minimize(problem.start("v_x") ** 2 + problem.start("v_y") ** 2)
    best = problem.solve(accuracy=1e-6)
    g, first = 9.81, 0.8 - 0.64
    assert best.objective == pytest.approx(2 * g * (height / 0.6**2 - first), rel=1e-5)
    replay = best.replay(tolerance=1e-10)
    assert replay.events[0].time == pytest.approx(best.phases[0][2], rel=1e-5)
    assert replay.final("y") == pytest.approx(height - 0.8, abs=1e-4)
