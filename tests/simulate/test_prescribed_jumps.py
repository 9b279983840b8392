"""Prescribed motions: a mass cannot follow a step, but a ramp; accelerations are derivatives of one angle."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    ceil,
    connect,
    der,
    fabs,
    fixed,
    floor,
    lookup,
    maximum,
    sign,
    signal_input,
    sin,
    time,
    unitless,
    variable,
    where,
)
from acausal.errors import AcausalError
from acausal.library.blocks import Ramp, Step
from acausal.library.rotational import Accelerate, Inertia, Speed
from acausal.library.translational import Fixed, Mass, Position, Spring
from tests.expected import fails_with


class Stepped(Component):
    """A mass that is to be elsewhere at once."""

    signal: Step = Step(height=1.0, start_time=0.5)
    position: Position = Position()
    mass: Mass = Mass(m=1.0)

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.position.s_ref)
        yield connect(self.position.flange, self.mass.flange_a)


class Ramped(Component):
    """One that gets there in a fifth of a second."""

    signal: Ramp = Ramp(height=1.0, start_time=0.5, duration=0.2)
    position: Position = Position()
    mass: Mass = Mass(m=1.0)

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.position.s_ref)
        yield connect(self.position.flange, self.mass.flange_a)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_step_of_a_prescribed_position_is_refused(solver: str) -> None:
    with fails_with(AcausalError, "AC039", match=r"jumps at t = 0\.5 s, from 0 to 1"):
        acausal.simulate(Stepped(), stop_time=1.0, solver=solver)


def test_before_its_step_and_along_a_ramp_it_runs() -> None:
    assert acausal.simulate(Stepped(), stop_time=0.4).final("mass.s") == pytest.approx(0.0)
    assert acausal.simulate(Ramped(), stop_time=0.6).final("mass.v") == pytest.approx(5.0)


def noted(model: Component, stop: float = 1.0) -> list[str]:
    notes: tuple[str, ...] = acausal.simulate(model, stop_time=stop).stats["notes"]  # type: ignore[assignment]
    return [n for n in notes if "corner" in n]


def test_corners_of_a_ramp_that_moves_a_mass_are_noted() -> None:
    """The mass gains 5 kg m/s at 0.5 s and loses them at 0.7 s, in no time: no row of the force shows that."""
    (note,) = noted(Ramped())
    assert "jumps from 0 to 5 at t = 0.5 s and at 1 more" in note
    assert noted(Ramped(), 0.4) == []


class Shown(Component):
    """A speed that follows from a ramp, and moves nothing: no impulse."""

    signal: Ramp = Ramp(height=1.0, start_time=0.5, duration=0.2)
    position: Position = Position()
    spring: Spring = Spring(c=2.0)
    fixed: Fixed = Fixed()
    v: Real = variable()

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.position.s_ref)
        yield connect(self.position.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.fixed.flange)
        yield self.v == der(self.position.flange.s)


def test_without_inertia_there_is_nothing_to_note() -> None:
    assert noted(Shown()) == []


class Rounded(Component):
    """The same way by a parabola whose rate has no jump."""

    position: Position = Position()
    mass: Mass = Mass(m=1.0)

    def equations(self) -> Equations:
        late = where(time > 0.5, time - 0.5, 0.0)
        yield self.position.s_ref == late * late
        yield connect(self.position.flange, self.mass.flange_a)


def test_a_motion_whose_rate_is_continuous_is_not_noted() -> None:
    assert noted(Rounded()) == []


LAWS: dict[str, tuple[Callable[[Expr], Expr], bool]] = {
    "where": (lambda x: where(x > 0.77, 3.0 * x, x), False),
    "floor": (lambda x: floor(3.0 * x) * x, False),
    "ceil": (lambda x: ceil(3.0 * x) * x, False),
    "sign": (lambda x: sign(x - 0.77) * (x + 1.0), False),
    "steps": (lambda x: lookup([0.0, 1.0, 2.0, 3.0], [(1.0,), (2.0,), (4.0,)])(floor(2.0 * x)) * x, False),
    "where that meets": (lambda x: where(x > 0.77, 3.0 * x - 1.54, x), True),
    "sign that meets": (lambda x: sign(x - 0.77) * (x - 0.77), True),
    "maximum": (lambda x: maximum(x, 0.3 + fabs(x - 1.0)), True),
}


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_jump_at_an_instant_that_is_found_in_the_run(solver: str) -> None:
    """sin(3 t) passes 1/2 at pi/18."""

    class Switched(Component):
        w: Real = variable(default=fixed(0.0))
        q: Real = variable()

        def equations(self) -> Equations:
            yield self.q == where(sin(3.0 * unitless(time)) > 0.5, 2.0 * unitless(time), unitless(time))
            yield der(self.w) == der(self.q)

    with fails_with(AcausalError, "AC039", match=r"jumps at t = 0\.17453292"):
        acausal.simulate(Switched(), stop_time=1.0, solver=solver)


@pytest.mark.parametrize(("solver", "of_time"), [("idas", False), ("rosenbrock", True)])
@pytest.mark.parametrize("name", LAWS)
def test_an_integrated_rate_is_what_it_is_the_rate_of(name: str, of_time: bool, solver: str) -> None:
    """w' = q' makes w = q, or is refused where q jumps."""
    law, is_continuous = LAWS[name]

    class Follows(Component):
        x: Real = variable(default=fixed(0.0))
        w: Real = variable(default=fixed(0.0))
        q: Real = variable()

        def equations(self) -> Equations:
            yield der(self.x) == 1.0
            yield self.q == law(unitless(time) if of_time else self.x)
            yield der(self.w) == der(self.q)

    if is_continuous:
        result = acausal.simulate(Follows(), stop_time=1.3, solver=solver, tolerance=1e-8)
        assert result.final("w") == pytest.approx(result.final("q") - result["q"][0], abs=1e-7)
        return
    with pytest.raises(AcausalError) as error:
        acausal.simulate(Follows(), stop_time=1.3, solver=solver)
    assert error.value.code in ("AC039", "AC507")


@pytest.mark.parametrize("name", [n for n in LAWS if n != "maximum"])
def test_what_may_jump_needs_a_name_to_be_differentiated(name: str) -> None:
    law, _ = LAWS[name]

    class Nameless(Component):
        x: Real = variable(default=fixed(0.0))
        w: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == 1.0
            yield der(self.w - 2.0 * law(self.x)) == 0.0

    with fails_with(AcausalError, "AC144", match="has no name"):
        acausal.compile(Nameless())


class Accelerated(Component):
    """An inertia whose angular acceleration is an input."""

    a: Real = signal_input(default=0.5, unit="rad/s2")
    drive: Accelerate = Accelerate()
    load: Inertia = Inertia(J=2.0, phi=fixed(0.3), w=fixed(0.1))

    def equations(self) -> Equations:
        yield connect(self.a, self.drive.a_ref)
        yield connect(self.drive.flange, self.load.flange_a)


class Driven(Component):
    """One whose speed is an input."""

    w: Real = signal_input(unit="rad/s")
    drive: Speed = Speed()
    load: Inertia = Inertia(J=2.0)

    def equations(self) -> Equations:
        yield connect(self.w, self.drive.w_ref)
        yield connect(self.drive.flange, self.load.flange_a)


def test_a_prescribed_acceleration_may_be_an_input() -> None:
    """phi = 0.3 + 0.1 t + 0.25 t^2 and tau = J a; with a = 2 t, phi = 0.3 + 0.1 t + t^3 / 3."""
    constant = acausal.simulate(Accelerated(), stop_time=2.0, tolerance=1e-9)
    assert constant.final("load.phi") == pytest.approx(1.5, rel=1e-8)
    assert constant.final("load.flange_a.tau") == pytest.approx(1.0)
    ramp = acausal.simulate(Accelerated(), stop_time=1.0, inputs={"a": lambda t: 2.0 * t}, tolerance=1e-9)
    assert ramp.final("load.phi") == pytest.approx(0.4 + 1.0 / 3.0, rel=1e-7)


def test_a_prescribed_speed_needs_the_derivative_of_the_input() -> None:
    with fails_with(AcausalError, "AC207", match="the time derivative of input w is needed"):
        acausal.simulate(Driven(), stop_time=1.0)
