"""Inputs that prescribe the motion of a body: an acceleration is one of its derivatives, not a second angle."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, signal_input
from acausal.errors import AcausalError
from acausal.library.rotational import Accelerate, Inertia, Speed


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
    with pytest.raises(AcausalError, match="the time derivative of input w is needed") as error:
        acausal.simulate(Driven(), stop_time=1.0)
    assert error.value.code == "AC207"
