"""A component through which nothing flows because an end of it is open is told; open ends that lose nothing are not."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, connect, fixed
from acausal.errors import StructureError
from acausal.library.electrical import Capacitor, Ground, Resistor
from acausal.library.multibody import BodyShape, Revolute, World
from acausal.library.rotational import Damper, IdealGearWithSupport, Inertia, RelSpeedSensor, TorqueSensor


class Pendulum(Component):
    """A pendulum whose bearing is damped, or only seems to be."""

    world: World = World()
    joint: Revolute = Revolute(phi=fixed(0.0), w=fixed(0.0))
    body: BodyShape = BodyShape(m=1.0, r=(1.0, 0.0, 0.0), r_CM=(0.5, 0.0, 0.0))
    damper: Damper = Damper(d=5.0)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a)
        yield connect(self.joint.axis, self.damper.flange_b)


class Damped(Pendulum):
    def equations(self) -> Equations:
        yield connect(self.joint.support, self.damper.flange_a)


NOTE = "damper.flange_a is connected to nothing: nothing flows through damper, as if it were not there"


def test_a_damper_with_an_open_end_is_told() -> None:
    """Its loss is none, that of one with both ends is what the pendulum has lost; other ends are open in both."""
    lost = {}
    for model in (Pendulum, Damped):
        result = acausal.simulate(model(), stop_time=2.0)
        lost[model] = abs(result["damper.loss_power"]).max()
        assert (NOTE in result.stats["notes"]) is (model is Pendulum)  # type: ignore[operator]
    assert lost[Pendulum] < 1e-12 < lost[Damped]


def test_open_ends_that_lose_nothing_are_no_notes() -> None:
    class Shafts(Component):
        a: Inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(1.0))
        b: Inertia = Inertia(J=2.0)
        torque: TorqueSensor = TorqueSensor()
        speed: RelSpeedSensor = RelSpeedSensor()

        def equations(self) -> Equations:
            yield connect(self.a.flange_b, self.torque.flange_a, self.speed.flange_a)
            yield connect(self.torque.flange_b, self.b.flange_a, self.speed.flange_b)

    assert acausal.flatten(Shafts()).notes == ()


def test_an_open_pin() -> None:
    class Circuit(Component):
        c: Capacitor = Capacitor(C=1.0, v=fixed(1.0))
        r: Resistor = Resistor(R=1.0)
        ground: Ground = Ground()

        def equations(self) -> Equations:
            yield connect(self.c.p, self.r.p)
            yield connect(self.c.n, self.ground.p)

    assert any(note.startswith("r.n is connected to nothing") for note in acausal.flatten(Circuit()).notes)


def test_a_gear_without_a_housing_is_refused() -> None:
    """It would transmit no torque: the second shaft would stand still beside the first."""

    class Geared(Component):
        a: Inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(1.0))
        gear: IdealGearWithSupport = IdealGearWithSupport(ratio=2.0)
        b: Inertia = Inertia(J=1.0)

        def equations(self) -> Equations:
            yield connect(self.a.flange_b, self.gear.flange_a)
            yield connect(self.gear.flange_b, self.b.flange_a)

    with pytest.raises(StructureError) as caught:
        acausal.compile(Geared())
    assert caught.value.code == "AC212"
