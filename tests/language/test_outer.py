"""Inner and outer, as Modelica 3.6, section 5.4: whom `outer(...)` finds, and that gravity is forgotten nowhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, flatten, outer, parameter, part, structural, variable
from acausal.cli.arguments.settings import _values
from acausal.errors import DeclarationError
from acausal.library.multibody import (
    Body,
    BodyBox,
    BodyCylinder,
    BodyShape,
    PointMass,
    Revolute,
    World,
    point_field,
    quaternion,
    uniform_field,
)
from tests.expected import fails_with


class Ambient(Component):
    """What is around: a temperature, a profile that Python knows, and how often it is asked."""

    T: Real = parameter(default=290.0, unit="K")
    steps: int = structural(default=1)


class Probe(Component):
    """Reads what is around it."""

    around: Ambient = outer(Ambient)
    T: Real = parameter(default=lambda self: 2 * self.around.T, unit="K")
    x: Real = variable(unit="K")
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.x == self.around.T
        yield self.y == self.around.steps


class Room(Component):
    """A probe, and no ambient of its own."""

    probe: Probe = Probe()


class Cold(Component):
    """A room with its own ambient."""

    around: Ambient = Ambient(T=250.0, steps=3)
    room: Room = Room()


class House(Component):
    """The nearest counts."""

    air: Ambient = Ambient(T=300.0, steps=2)
    probe: Probe = Probe()
    room: Room = Room()
    cellar: Cold = Cold()
    rooms: list[Room] = part()

    def build(self) -> None:
        self.rooms = [Room() for _ in range(3)]


def test_the_nearest_around_is_meant() -> None:
    """Probes without a room, in rooms, in lists: 300 K; below the cellar's own ambient 250 K."""
    result = acausal.simulate(House(), stop_time=1.0)
    for path in ("probe", "room.probe", "rooms[0].probe", "rooms[2].probe"):
        assert result.final(f"{path}.x") == 300.0
        assert result.final(f"{path}.y") == 2.0
        assert result.final(f"{path}.T") == 600.0
    assert result.final("cellar.room.probe.x") == 250.0
    assert result.final("cellar.room.probe.y") == 3.0


def test_values_of_what_is_around_can_be_set() -> None:
    compiled = acausal.compile(House())
    result = acausal.simulate(compiled, stop_time=1.0, parameters={"air.T": 310.0, "cellar.around.T": 240.0})
    assert result.final("rooms[1].probe.T") == 620.0
    assert result.final("cellar.room.probe.x") == 240.0


def refused(model: Component) -> DeclarationError:
    with pytest.raises(DeclarationError) as caught:
        flatten(model)
    return caught.value


def test_nothing_around() -> None:
    error = refused(Room())
    assert error.code == "AC188"
    assert "probe (Probe) finds no Ambient" in str(error)
    assert "around: Ambient = Ambient()" in str(error)


def test_two_around() -> None:
    class Two(Component):
        inside: Ambient = Ambient()
        outside: Ambient = Ambient()
        room: Room = Room()

    error = refused(Two())
    assert error.code == "AC189"
    assert "inside (Ambient)" in str(error)

    class Named(Component):
        inside: Ambient = Ambient()
        around: Ambient = Ambient(T=280.0)
        room: Room = Room()

    assert acausal.simulate(Named(), stop_time=1.0).final("room.probe.x") == 280.0


def test_a_structural_value_is_not_known_in_build() -> None:
    class Early(Component):
        around: Ambient = outer(Ambient)
        probes: list[Probe] = part()

        def build(self) -> None:
            self.probes = [Probe() for _ in range(self.around.steps)]

    with fails_with(DeclarationError, "AC187", match=r"around\.steps.* is not known yet"):
        Early()


def test_an_outer_is_not_given() -> None:
    with pytest.raises(DeclarationError, match="has no field 'around'"):
        Probe(around=Ambient())  # type: ignore[call-arg]


MAKERS: dict[str, Any] = {
    "Body": lambda **start: Body(m=2.0, **start),
    "PointMass": lambda **start: PointMass(m=2.0, **start),
    "BodyShape": lambda **start: BodyShape(m=2.0, r=(1.0, 0.0, 0.0), **start),
    "BodyCylinder": lambda **start: BodyCylinder(r=(1.0, 0.0, 0.0), diameter=0.1, **start),
    "BodyBox": lambda **start: BodyBox(r=(1.0, 0.0, 0.0), width=0.1, width_direction=(0.0, 0.0, 1.0), **start),
}


def falling(name: str, world: World | None) -> Component:
    """A body that falls from rest, with a world beside it or without one."""
    turning = {} if name == "PointMass" else {"w_a": fixed((0.0, 0.0, 0.0)), "Q": fixed((0.0, 0.0, 0.0, 1.0))}
    start = {"r_0": fixed((0.0, 0.0, 0.0)), "v_0": fixed((0.0, 0.0, 0.0)), **turning}

    if world is None:

        class Alone(Component):
            body: Component = part()

            def build(self) -> None:
                self.body = MAKERS[name](**start)

        return Alone()
    given: World = world

    class Beside(Component):
        world: World = part()
        body: Component = part()

        def build(self) -> None:
            self.world = given
            self.body = MAKERS[name](**start)

    return Beside()


@pytest.mark.parametrize("name", MAKERS)
def test_every_body_feels_the_world_around_it(name: str) -> None:
    """Falls by g t^2 / 2 = 0.81 m in a second on the Moon (g = 1.62 m/s2), along n."""
    result = acausal.simulate(falling(name, World(g=1.62, n=(0.0, 0.0, -1.0))), stop_time=1.0)
    assert result.final("body.r_0[2]") == pytest.approx(-0.81, rel=1e-6)
    assert result.final("body.r_0[1]") == pytest.approx(0.0, abs=1e-9)


def test_gravity_can_be_set_without_compiling_again() -> None:
    compiled = acausal.compile(falling("Body", World()))
    for g in (0.0, 3.7):
        result = acausal.simulate(compiled, stop_time=1.0, parameters={"world.g": g})
        assert result.final("body.r_0[1]") == pytest.approx(-g / 2, abs=1e-9)


def test_without_a_world_one_is_added_with_a_note() -> None:
    """MSL adds a default World too (missingInnerMessage)."""
    compiled = acausal.compile(falling("Body", None))
    result = acausal.simulate(compiled, stop_time=1.0)
    assert result.final("body.r_0[1]") == pytest.approx(-9.80665 / 2, rel=1e-6)
    assert "no World around body: one with its defaults is added, as world" in str(result.stats["notes"])
    assert acausal.simulate(compiled, stop_time=1.0, parameters={"world.g": 0.0}).final("body.r_0[1]") == 0.0
    assert _values(falling("Body", None), {"world.g": "162 cm/s2"}) == {"world.g": 1.62}


def test_a_field_of_the_world() -> None:
    """A circular orbit of radius 2 around mu = 8: speed sqrt(mu / r) = 2, half a period is pi r / v = pi."""

    class Orbit(Component):
        world: World = World(gravity=point_field(8.0))
        body: Body = part()

        def build(self) -> None:
            self.body = Body(
                m=1.0,
                r_0=fixed((2.0, 0.0, 0.0)),
                v_0=fixed((0.0, 2.0, 0.0)),
                w_a=fixed((0.0, 0.0, 0.0)),
                Q=fixed(quaternion(((1, 0, 0), (0, 1, 0), (0, 0, 1)))),
            )

    result = acausal.simulate(Orbit(), stop_time=3.141592653589793, tolerance=1e-9)
    assert result.final("body.r_0[0]") == pytest.approx(-2.0, abs=1e-6)


def test_a_vector_of_gravity_in_the_field_of_a_point_mass_is_refused_and_not_ignored() -> None:
    """A body may have the uniform field that a vector belongs to: it falls by g t**2 / 2."""

    class Near(Component):
        world: World = World(gravity=point_field(8.0))
        body: PointMass = part()

    start: dict[str, Any] = {"m": 1.0, "r_0": fixed((2.0, 0.0, 0.0)), "v_0": fixed((0.0, 0.0, 0.0))}
    for wrong in (
        Near(body=PointMass(g_0=(0.0, 0.0, -3.0), **start)),
        Near(world=World(g_0=(0.0, 0.0, -3.0), gravity=point_field(8.0)), body=PointMass(**start)),
    ):
        with pytest.raises(DeclarationError, match="g_0 is given, but has no effect"):
            acausal.compile(wrong)
    body = PointMass(g_0=(0.0, 0.0, -3.0), gravity=uniform_field, **start)
    result = acausal.simulate(Near(body=body), stop_time=1.0)
    assert np.asarray(result.final("body.r_0")) == pytest.approx([2.0, 0.0, -1.5])


def test_a_body_in_a_subassembly_of_another_model() -> None:
    """A pendulum of length l swings with sqrt(g / l): from small angles, after half a period the angle is negative."""

    class Arm(Component):
        hinge: Revolute = part()
        body: Body = part()

        def build(self) -> None:
            self.hinge = Revolute(phi=fixed(0.001), w=fixed(0.0))
            self.body = Body(m=1.0, r_CM=(0.0, -1.0, 0.0), I_11=0.0, I_22=0.0, I_33=0.0)

        def equations(self) -> Equations:
            yield acausal.connect(self.hinge.frame_b, self.body.frame_a)

    class Swing(Component):
        world: World = World(g=4.0)
        arm: Arm = Arm()

        def equations(self) -> Equations:
            yield acausal.connect(self.world.frame_b, self.arm.hinge.frame_a)

    result = acausal.simulate(Swing(), stop_time=3.141592653589793 / 2, tolerance=1e-9)
    assert result.final("arm.hinge.phi") == pytest.approx(-0.001, rel=1e-5)


def test_flattening_leaves_the_recipe_as_it_was() -> None:
    model = falling("Body", World(g=1.0))
    before = {k: dict(c.__dict__) for k, c in model._parts.items()}
    flatten(model)
    for k, c in model._parts.items():
        held = dict(c.__dict__)
        assert held.keys() == before[k].keys()
        assert all(held[n] is before[k][n] for n in held)


def test_a_decay_beside_its_ambient() -> None:
    """Newton's law of cooling towards what is around: T - T_a falls by e in 1 / k."""

    class Cup(Component):
        around: Ambient = outer(Ambient, default=Ambient(T=273.0))
        T: Real = variable(unit="K", default=fixed(373.0))
        k: Real = parameter(default=1.0, unit="1/s")

        def equations(self) -> Equations:
            yield der(self.T) == self.k * (self.around.T - self.T)

    assert acausal.simulate(Cup(), stop_time=1.0, tolerance=1e-9).final("T") == pytest.approx(
        273.0 + 100.0 / 2.718281828459045, rel=1e-7
    )
