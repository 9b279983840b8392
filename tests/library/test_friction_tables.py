"""Friction takes energy, however fast its surfaces are: a table that is left does not make it drive."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, connect, fixed, part
from acausal.errors import AcausalError, DeclarationError
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
