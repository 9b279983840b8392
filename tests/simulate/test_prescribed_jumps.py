"""A mass cannot follow a step: the impulse would be infinite. It follows a ramp: v = 1 m / 0.2 s = 5 m/s."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, time, variable, where
from acausal.errors import AcausalError
from acausal.library.blocks import Ramp, Step
from acausal.library.translational import Fixed, Mass, Position, Spring


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
    with pytest.raises(AcausalError, match=r"jumps at t = 0\.5 s, from 0 to 1") as error:
        acausal.simulate(Stepped(), stop_time=1.0, solver=solver)
    assert error.value.code == "AC039"


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
