"""Friction elements, freewheels and the bouncing mass against closed forms; friction takes energy at any speed."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, signal_input, time, where
from acausal.errors import AcausalError, DeclarationError
from acausal.library import rotational, translational
from acausal.library.blocks import Constant
from acausal.library.blocks.tables import Points
from acausal.library.rotational import (
    BearingFriction,
    Brake,
    Clutch,
    ConstantTorque,
    Fixed,
    Inertia,
    LossyGear,
    OneWayClutch,
)
from acausal.library.translational import SupportFriction
from tests.expected import fails_with


class Shaft(Component):
    """Inertia on a bearing with friction, driven by a torque."""

    inertia: rotational.Inertia = part()
    bearing: rotational.BearingFriction = part()
    torque: rotational.Torque = part()
    w0: float = acausal.structural(default=0.0)
    drive: Real = signal_input(unit="N.m", default=0.0)
    peak: float = acausal.structural(default=1.0)

    def build(self) -> None:
        self.inertia = rotational.Inertia(J=2.0, phi=0.0, w=self.w0)
        self.bearing = rotational.BearingFriction(tau_pos=((0.0, 4.0),), peak=self.peak)
        self.torque = rotational.Torque(u=self.drive)

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.inertia.flange_a)
        yield connect(self.inertia.flange_b, self.bearing.flange_a)


@pytest.mark.parametrize("w0", [10.0, -10.0])
def test_a_shaft_runs_out_and_stays(w0: float) -> None:
    """J*w' = -4: at rest after 5 s and 25 rad."""
    r = acausal.simulate(Shaft(w0=w0), stop_time=8.0, tolerance=1e-8)
    assert [e.time for e in r.events] == pytest.approx([5.0], abs=1e-7)
    assert r.final("inertia.phi") == pytest.approx(np.sign(w0) * 25.0, abs=1e-6)
    assert r.final("bearing.mode") == 0.0


def test_a_shaft_lets_go_at_the_peak_and_slides_with_less() -> None:
    """Torque 1*t: stuck up to 1.5*4 at t = 6; then 2*w' = t - 4: w = ((t - 4)^2 - 4)/4."""
    r = acausal.simulate(Shaft(drive=1.0 * time, peak=1.5), stop_time=8.0, tolerance=1e-8)
    assert r.at(5.9, "inertia.w") == 0.0
    assert r.at(5.9, "bearing.tau") == pytest.approx(5.9, abs=1e-9)
    assert r.final("inertia.w") == pytest.approx(3.0, abs=1e-6)


class TwoShafts(Component):
    """One turning, one at rest, and a clutch between them."""

    first: rotational.Inertia = rotational.Inertia(J=1.0, phi=0.0, w=10.0)
    clutch: rotational.Clutch = rotational.Clutch(fn_max=10.0, f_normalized=where(time < 0.5, 0.0, 1.0))
    second: rotational.Inertia = rotational.Inertia(J=1.0, phi=0.0, w=0.0)

    def equations(self) -> Equations:
        yield connect(self.first.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.second.flange_a)


def test_a_clutch_makes_two_speeds_one() -> None:
    """5 N.m from 0.5 s on: 10 - 5t = 5t after 1 s; the heat is half of the energy, 25 J."""
    r = acausal.simulate(TwoShafts(), stop_time=2.0, tolerance=1e-8)
    assert r.at(0.4, "clutch.mode") == 2.0
    assert r.at(1.0, "clutch.mode") == -1.0
    assert r.final("clutch.mode") == 0.0
    assert [e.time for e in r.events][-1] == pytest.approx(1.5, abs=1e-7)
    assert (r.final("first.w"), r.final("second.w")) == pytest.approx((5.0, 5.0), abs=1e-7)


class Block(Component):
    """Mass with a brake that is pressed from t = 1 on."""

    mass: translational.Mass = translational.Mass(m=1.0, s=0.0, v=3.0)
    brake: translational.Brake = translational.Brake(fn_max=10.0, f_normalized=where(time < 1.0, 0.0, 1.0))

    def equations(self) -> Equations:
        yield connect(self.mass.flange_b, self.brake.flange_a)


def test_a_brake_stops_a_mass() -> None:
    """3 m, then v^2/(2*5) = 0.9 m in 0.6 s."""
    r = acausal.simulate(Block(), stop_time=3.0, tolerance=1e-8)
    assert r.events[-1].time == pytest.approx(1.6, abs=1e-7)
    assert r.final("mass.s") == pytest.approx(3.9, abs=1e-6)
    assert r.final("brake.loss_power") == pytest.approx(0.0, abs=1e-6)


class Dropped(Component):
    """Mass that falls on the ground, lies there, and is pulled up from t = 3 on."""

    body: translational.BouncingMass = translational.BouncingMass(m=1.0, e=0.5, s=1.0, v=0.0)
    force: translational.Force = translational.Force(u=where(time < 3.0, -10.0, 2.0))

    def equations(self) -> Equations:
        yield connect(self.force.flange, self.body.flange_b)


def test_a_dropped_mass_bounces_lies_and_is_lifted() -> None:
    """Fall sqrt(0.2) s; bounces end at sqrt(0.2)*(1 + e)/(1 - e) = 1.342 s; lifted by 2 m/s2 from 3 s on."""
    r = acausal.simulate(Dropped(), stop_time=4.0, tolerance=1e-8)
    assert r.events[0].time == pytest.approx(np.sqrt(0.2), abs=1e-7)
    assert r.at(2.0, "body.resting") == 1.0
    assert r.at(2.0, "body.f_contact") == pytest.approx(10.0, abs=1e-6)
    assert r.final("body.s") == pytest.approx(1.0, abs=1e-5)
    assert r.final("body.v") == pytest.approx(2.0, abs=1e-5)


class Play(Component):
    """Mass in a play of 0.2 m between two undamped ends."""

    mass: translational.Mass = translational.Mass(m=1.0, s=0.0, v=1.0)
    wall: translational.Fixed = translational.Fixed()
    backlash: translational.Backlash = translational.Backlash(c=1e4, d=0.0, b=0.2)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.backlash.flange_a)
        yield connect(self.backlash.flange_b, self.mass.flange_a)


def test_a_mass_goes_to_and_fro_in_its_play() -> None:
    """Free flight 0.2 s, then half a swing of pi/100 s at either end: period 0.4 + 2*pi/100 s."""
    period = 0.4 + np.pi / 50.0
    r = acausal.simulate(Play(), stop_time=3 * period, tolerance=1e-8)
    assert (r.final("mass.s"), r.final("mass.v")) == pytest.approx((0.0, 1.0), abs=1e-6)
    assert r["mass.s"].max() == pytest.approx(0.11, abs=1e-6)


FALLING = ((0.0, 0.4), (3.0, 0.2))
HELD = (*FALLING, (4.0, 0.2))


class Coasting(Component):
    """A shaft that turns at 10 rad/s against an element of friction, whose other end is held."""

    element: Brake | BearingFriction | Clutch | OneWayClutch = part()
    shaft: Inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(10.0))
    wall: Fixed = Fixed()

    def equations(self) -> Equations:
        if isinstance(self.element, Clutch | OneWayClutch):
            yield connect(self.wall.flange, self.element.flange_a)
        yield connect(self.element.flange_b, self.shaft.flange_a)


Pressed = type[Brake] | type[Clutch] | type[OneWayClutch]


def coasting(cls: Pressed, points: Points, pressed: float = 1.0) -> Coasting:
    return Coasting(element=cls(mu_pos=points, fn_max=2.0, f_normalized=pressed))


@pytest.mark.parametrize("cls", [Brake, Clutch, OneWayClutch])
def test_a_fast_shaft_is_braked_or_its_table_is_refused(cls: Pressed) -> None:
    """0.2*1 m*2 N = 0.4 N.m on 1 kg.m2 where the last value is held; free where nothing presses."""
    for points, pressed, w in ((HELD, 1.0, 9.6), (FALLING, 0.0, 10.0)):
        r = acausal.simulate(coasting(cls, points, pressed), stop_time=1.0, tolerance=1e-8)
        assert r.final("shaft.w") == pytest.approx(w, abs=1e-7)
    with pytest.raises(AcausalError, match="beyond 6 "):  # 0.4 - 0.2/3*6 = 0
        acausal.simulate(coasting(cls, FALLING), stop_time=1.0)


def test_a_bearing_of_falling_friction() -> None:
    with pytest.raises(AcausalError, match="beyond 6 "):
        acausal.simulate(Coasting(element=BearingFriction(tau_pos=FALLING)), stop_time=1.0)


class Geared(Component):
    drive: ConstantTorque = ConstantTorque(tau_constant=2.0)
    motor: Inertia = Inertia(J=0.1, phi=fixed(0.0), w=fixed(0.0))
    gear: LossyGear = LossyGear(ratio=1.0, lossTable=((0.0, 0.8, 0.8, 0.0, 0.0), (2.0, 0.9, 0.8, 0.0, 0.0)))
    load: Inertia = Inertia(J=0.1)

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.motor.flange_a)
        yield connect(self.motor.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.load.flange_a)


def test_no_gear_gives_more_than_it_takes() -> None:
    """An efficiency of 0.8 + 0.05*w is 1 at 4 rad/s."""
    with pytest.raises(AcausalError, match="beyond 4 "):
        acausal.simulate(Geared(), stop_time=1.0)


def test_friction_below_zero_is_refused() -> None:
    for points in (((0.0, -0.1),), ((0.0, 0.2), (1.0, -0.1)), ((1.0, 0.1), (2.0, 0.4))):
        with pytest.raises(DeclarationError, match="friction over speed comes to -0"):
            SupportFriction(f_pos=points)


class Pair(Component):
    """Two free inertias and a freewheel between them."""

    w: Real = parameter(default=1.0, unit="rad/s")
    a: Inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
    b: Inertia = part()
    clutch: OneWayClutch = OneWayClutch(fn_max=2.0, mu_pos=((0.0, 0.5),))
    pressed: Constant = Constant(k=1.0)

    def build(self) -> None:
        self.b = Inertia(J=0.5, phi=fixed(0.0), w=fixed(self.w))

    def equations(self) -> Equations:
        yield connect(self.pressed.y, self.clutch.f_normalized)
        yield connect(self.a.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.b.flange_a)


def test_sliding_ends_at_the_common_speed() -> None:
    """Momentum 0.5*1 over 1.5 kg.m2; 1 N.m brings the relative speed to 0 after 1/3 s."""
    result = acausal.simulate(Pair(), stop_time=1.0, tolerance=1e-9)
    assert result.final("a.w") == pytest.approx(1.0 / 3.0, abs=1e-8)
    assert result.events[0].time == pytest.approx(1.0 / 3.0, abs=1e-8)


def test_it_cannot_start_backwards() -> None:
    """w_rel = -1 rad/s went on for ever, as if that were locked."""
    with fails_with(AcausalError, "AC503") as error:
        acausal.simulate(acausal.compile(Pair(), parameters={"w": -1.0}), stop_time=1.0)
    assert "w_rel >= 0" in str(error.value)
    assert "clutch" in str(error.value)
