"""The initial problem: what is fixed, guessed, solved for, left open, or said too often."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, Real, atan, der, fixed, guess, homotopy, parameter, sin, structural, variable
from acausal.errors import InitializationError
from acausal.result.result import Result
from tests.expected import fails_with


def start(model: Component, **parameters: float) -> Result:
    """A run too short for anything to change."""
    return acausal.simulate(model, stop_time=1e-9, parameters=parameters)


class Tank(Component):
    """x' = z - x with z^3 + z = x: one state, one algebraic variable in a nonlinear equation."""

    k: Real = parameter(default=1.0)
    x: Real = variable()
    z: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.z - self.x
        yield self.k * self.z**3 + self.z == self.x


class Steady(Tank):
    """At rest: with k = 1, z = x and z^3 + z = x have z = 0 only; the initial equation is der(x) == -1."""

    def initial_equations(self) -> Equations:
        yield der(self.x) == -1.0


def test_a_fixed_state_is_taken_as_it_is() -> None:
    """z^3 + z = 10 at z = 2."""
    result = start(Tank(x=fixed(10.0)))
    assert result["x"][0] == 10.0
    assert result["z"][0] == pytest.approx(2.0, abs=1e-12)
    assert not result.stats["notes"]


def test_a_bare_number_is_fixed() -> None:
    assert start(Tank(x=10.0))["x"][0] == 10.0


def test_a_fixed_algebraic_variable_determines_the_state() -> None:
    result = start(Tank(z=fixed(2.0)))
    assert result["x"][0] == pytest.approx(10.0, abs=1e-11)


def test_a_guess_is_only_where_the_search_starts() -> None:
    """A state that nothing determines takes its guess, and the user is told."""
    result = start(Tank(x=guess(2.0)))
    assert result["x"][0] == 2.0
    assert any("x = 2" in note for note in result.stats["notes"])  # type: ignore[attr-defined]
    assert start(Tank(x=fixed(2.0), z=guess(-5.0)))["z"][0] == pytest.approx(1.0, abs=1e-12)


def test_an_initial_equation_is_solved_for_the_state() -> None:
    """z - x = -1 and z^3 + z = x: z^3 = 1, hence z = 1 and x = 2."""
    result = start(Steady(x=guess(1.0), z=guess(0.5)))
    assert result["x"][0] == pytest.approx(2.0, abs=1e-10)
    assert result["z"][0] == pytest.approx(1.0, abs=1e-10)


def test_starts_may_hold_parameters() -> None:
    """And follow them without a compilation."""

    class Released(Tank):
        x0: Real = parameter(default=10.0)

        def initial_equations(self) -> Equations:
            yield self.x == 2 * self.x0

    compiled = acausal.compile(Released())
    assert acausal.simulate(compiled, stop_time=1e-9)["x"][0] == pytest.approx(20.0)
    assert acausal.simulate(compiled, stop_time=1e-9, parameters={"x0": 1.0})["x"][0] == pytest.approx(2.0)


@pytest.mark.parametrize("z", [2.0, 2.0 + 1e-11])
def test_surplus_starts_that_agree_are_accepted(z: float) -> None:
    assert start(Tank(x=fixed(10.0), z=fixed(z)))["z"][0] == pytest.approx(2.0)


@pytest.mark.parametrize("model", [Tank(x=fixed(10.0), z=fixed(1.0)), Steady(x=fixed(10.0))])
def test_surplus_starts_that_contradict(model: Component) -> None:
    with fails_with(InitializationError, "AC302"):
        start(model)


class Twin(Component):
    """Two names of one state, both with a start."""

    a: Real = variable()
    b: Real = variable()

    def equations(self) -> Equations:
        yield der(self.a) == -self.a
        yield self.b == -self.a


def test_starts_of_aliases() -> None:
    assert start(Twin(b=fixed(3.0)))["a"][0] == -3.0
    assert start(Twin(a=fixed(-3.0), b=fixed(3.0)))["a"][0] == -3.0
    assert start(Twin(a=fixed(-3.0), b=guess(7.0)))["a"][0] == -3.0
    with pytest.raises(InitializationError, match="AC302"):
        start(Twin(a=fixed(-3.0), b=fixed(4.0)))


class Rod(Component):
    """A pendulum in x and y: of four starts two can be chosen."""

    x: Real = variable()
    y: Real = variable()
    vx: Real = variable()
    vy: Real = variable()
    tension: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.tension * self.x
        yield der(self.vy) == -self.tension * self.y - 9.81
        yield self.x**2 + self.y**2 == 1.0


def test_constraints_complete_the_starts() -> None:
    """x = 0.6 and vx = 0.8 leave y = -0.8 (the guess picks the root) and vy = -x vx / y = 0.6."""
    result = start(Rod(x=fixed(0.6), y=guess(-1.0), vx=fixed(0.8)))
    assert result["y"][0] == pytest.approx(-0.8, abs=1e-9)
    assert result["vy"][0] == pytest.approx(0.6, abs=1e-9)
    # vx^2 + vy^2 = 1 = tension + 9.81 y
    assert result["tension"][0] == pytest.approx(1.0 + 9.81 * 0.8, abs=1e-7)


def test_starts_off_the_constraint() -> None:
    with pytest.raises(InitializationError, match=r"AC30\d"):
        start(Rod(x=fixed(0.6), y=fixed(-0.5), vx=fixed(0.0)))


class Far(Component):
    """atan(5 z) = x: from z = 2 Newton's method jumps ever farther; the way through the simplified equation is easy."""

    x: Real = variable(default=fixed(1.0))
    z: Real = variable(default=guess(2.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield homotopy(atan(5 * self.z), self.z) == self.x


def test_homotopy() -> None:
    assert start(Far())["z"][0] == pytest.approx(math.tan(1.0) / 5, rel=1e-9)


class Impossible(Component):
    x: Real = variable(default=fixed(2.0))
    z: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield sin(self.z) + 0.01 * self.z**2 == -self.x


class Undefined(Component):
    x: Real = variable(default=fixed(0.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.y
        yield self.y == 1 / self.x


@pytest.mark.parametrize(("model", "code"), [(Impossible(), "AC301"), (Undefined(), "AC303")])
def test_no_start(model: Component, code: str) -> None:
    with fails_with(InitializationError, code):
        start(model)


class Released(Component):
    """A point mass on a circle, at rest below the horizontal; `order` says how its three conditions are written."""

    order: tuple[int, ...] = structural(default=(0, 1, 2))
    x: Real = variable()
    y: Real = variable()
    vx: Real = variable()
    vy: Real = variable()
    pull: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.pull * self.x
        yield der(self.vy) == -self.pull * self.y - 9.81
        yield self.x**2 + self.y**2 == 1.0

    def initial_equations(self) -> Equations:
        conditions = [self.x == 0.8, self.y == -0.6, self.vx == 0.0]
        for k in self.order:
            yield conditions[k]


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0), (2, 0, 1)])
def test_a_condition_too_many_chooses_between_roots(order: tuple[int, ...]) -> None:
    """x = 0.8 and the circle leave y = 0.6 and -0.6; the third condition is no contradiction, in whatever order."""
    run = acausal.simulate(Released(order=order), stop_time=0.1)
    assert run["y"][0] == pytest.approx(-0.6, abs=1e-12)
    assert run["vy"][0] == pytest.approx(0.0, abs=1e-12)
