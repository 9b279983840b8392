"""Friction elements and the bouncing mass against closed forms: Coulomb friction is a constant deceleration."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, part, signal_input, time, where
from acausal.library import rotational, translational


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
