"""A gear that locks itself: LossyGearDemo1 of the Modelica Standard Library, and closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, structural
from acausal.errors import DeclarationError
from acausal.library import blocks, rotational
from acausal.library.rotational.lossy import Losses, LossyGear
from tests.accuracy.msl_reference import met


class LossyGearDemo1(Component):
    gear: LossyGear = LossyGear(ratio=2.0, lossTable=((0.0, 0.5, 0.5, 0.0, 0.0),))
    Inertia1: rotational.Inertia = rotational.Inertia(J=1.0)
    Inertia2: rotational.Inertia = rotational.Inertia(J=1.5, phi=fixed(0.0), w=fixed(0.0))
    torque1: rotational.Torque = rotational.Torque()
    torque2: rotational.Torque = rotational.Torque()
    drive: blocks.Sine = blocks.Sine(amplitude=10.0, f=1.0)
    load: blocks.Ramp = blocks.Ramp(height=5.0, duration=2.0, offset=-10.0)

    def equations(self) -> Equations:
        yield connect(self.Inertia1.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.Inertia2.flange_a)
        yield connect(self.torque1.flange, self.Inertia1.flange_a)
        yield connect(self.torque2.flange, self.Inertia2.flange_b)
        yield connect(self.drive.y, self.torque1.u)
        yield connect(self.load.y, self.torque2.u)


def test_lossy_gear_demo(reference: Path) -> None:
    """Phases of the independent solution in the data: backward, stuck, forward, stuck, backward."""
    r = met(LossyGearDemo1(), reference / "msl" / "Rotational_LossyGearDemo1")
    mode = np.round(r["gear.mode"])
    changes = np.flatnonzero(np.diff(mode)) + 1
    assert list(r.time[changes]) == pytest.approx([0.080477, 0.199520, 0.371343, 0.464539], abs=5e-6)
    assert list(mode[[0, *changes]]) == [-1, 0, 1, 0, -1]


class Hoist(Component):
    """A constant torque on an inertia behind a gear of ratio 3."""

    tau: Real = parameter(unit="N.m")
    losses: Losses = structural(default=((0.0, 0.8, 0.6, 0.1, 0.2),))
    drive: rotational.ConstantTorque = part()
    gear: LossyGear = part()
    load: rotational.Inertia = rotational.Inertia(J=2.0, phi=fixed(0.0), w=fixed(0.0))
    weight: rotational.ConstantTorque = rotational.ConstantTorque(tau_constant=-6.0)

    def build(self) -> None:
        self.drive = rotational.ConstantTorque(tau_constant=self.tau)
        self.gear = LossyGear(ratio=3.0, lossTable=self.losses)

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.load.flange_a)
        yield connect(self.load.flange_b, self.weight.flange)


@pytest.mark.parametrize(
    ("tau", "acceleration"),
    [
        # lifts with what the teeth and bearings leave: 3 (0.8 tau - 0.1) - 6
        (3.0, (3 * (0.8 * 3.0 - 0.1) - 6) / 2),
        # between (6/3 - 0.2)*0.6 = 1.08 and (6/3 + 0.1)/0.8 = 2.625 N.m the gear holds the weight
        (2.6, 0.0),
        (1.1, 0.0),
        # lets it down: flange_b drives, and the drive brakes with 3 (tau/0.6 + 0.2)
        (0.5, (3 * (0.5 / 0.6 + 0.2) - 6) / 2),
    ],
)
def test_lifting_holding_and_letting_down(tau: float, acceleration: float) -> None:
    """Efficiency 0.8 where flange_a drives, 0.6 where flange_b does, 0.1 and 0.2 N.m in the bearings."""
    r = acausal.simulate(Hoist(tau=tau), stop_time=1.0, tolerance=1e-9)
    assert r.final("load.w") == pytest.approx(acceleration, abs=1e-8)
    assert np.all(r["gear.loss_power"] >= -1e-9)


@pytest.mark.parametrize("losses", [((0.0, 1.0, 1.0, 0.0, 0.0),), ((0.0, 1.5, 1.0, 0.0, 0.0),), ((0.0, 0.5),)])
def test_tables_that_are_none(losses: Losses) -> None:
    with pytest.raises(DeclarationError, match="lossTable"):
        LossyGear(ratio=1.0, lossTable=losses)


class Braked(Component):
    """A gear between two inertias that turn, with a torque on the first and a spring behind the second."""

    u: Real = parameter(unit="N.m", doc="Torque")
    w_0: Real = parameter(unit="rad/s", doc="Speed at the start")
    one: rotational.Inertia = part()
    gear: LossyGear = LossyGear(ratio=2.0, lossTable=((0.0, 0.9, 0.8, 1.9, 1.9),))
    two: rotational.Inertia = rotational.Inertia(J=0.5)
    spring: rotational.Spring = rotational.Spring(c=2.7)
    wall: rotational.Fixed = rotational.Fixed()
    torque: rotational.Torque = part()

    def build(self) -> None:
        self.one = rotational.Inertia(J=0.4, phi=fixed(0.0), w=fixed(self.w_0))
        self.torque = rotational.Torque(u=self.u)

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.one.flange_a)
        yield connect(self.one.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.two.flange_a)
        yield connect(self.two.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.wall.flange)


def test_a_gear_that_turns_backward_starts_as_one_that_turns_forward() -> None:
    """At the start the second inertia drives the gear, x < 0 in `one.a*0.4 == u - x`, and is stopped by its losses.

    With 0.5/4 kg.m2 seen at the first flange, (u - x)/0.4 == (0.9*x + 1.9)/0.125. Mirrored, the events of the start did
    not settle: a gear of unknown mode was taken for one at rest that its deceleration sets going the other way.
    """
    x = (0.82 * 0.125 / 0.4 - 1.9) / (0.9 + 0.125 / 0.4)
    model = acausal.compile(Braked(u=0.82, w_0=-0.15))
    for way in (1.0, -1.0):
        run = acausal.simulate(model, parameters={"u": way * 0.82, "w_0": -way * 0.15}, stop_time=1.0, tolerance=1e-8)
        assert way * run["one.a"][0] == pytest.approx((0.82 - x) / 0.4, rel=1e-9)
        assert run.final("one.w") == pytest.approx(0.0, abs=1e-9)
