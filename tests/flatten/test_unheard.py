"""A parameter that is set and changes nothing is told."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, part, variable
from acausal.library.multibody import PointMass, World


class Falling(Component):
    """A mass under gravity, of which the strength or the whole vector may be given."""

    world: World = World()
    mass: PointMass = PointMass(m=1.0, r_0=fixed((0.0, 0.0, 0.0)), v_0=fixed((0.0, 0.0, 0.0)))


class Upwards(Component):
    """Gravity as a vector: its strength `world.g` is no part of it."""

    world: World = World(g_0=(0.0, 3.0, 0.0))
    mass: PointMass = PointMass(m=1.0, r_0=fixed((0.0, 0.0, 0.0)), v_0=fixed((0.0, 0.0, 0.0)))


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(("model", "way"), [(Falling, -1.0), (Upwards, 1.5)])
def test_a_gravity_that_nobody_feels_is_told(model: type[Component], way: float, compiled: bool) -> None:
    """A fall of one second is half the gravity that acts; where that is not the one set, a note says so."""
    made = acausal.compile(model()) if compiled else model()
    result = acausal.simulate(made, stop_time=1.0, parameters={"world.g": 2.0})
    assert result.final("mass.r_0[1]") == pytest.approx(way, abs=1e-9)
    told = "world.g is set, but nothing in the model depends on it" in result.stats["notes"]  # type: ignore[operator]
    assert told is (model is Upwards)


def test_what_acts_at_the_start_or_through_another_parameter_is_heard() -> None:
    class Decay(Component):
        k: Real = parameter(default=1.0)
        twice: Real = parameter(default=lambda self: 2.0 * self.k)
        begin: Real = parameter(default=3.0)
        idle: Real = parameter(default=(1.0, 2.0), shape=2)
        x: Real = variable(default=lambda self: fixed(self.begin))

        def equations(self) -> Equations:
            yield der(self.x) == -self.twice * self.x

    values = {"k": 0.5, "begin": 2.0, "idle": (3.0, 4.0)}
    assert acausal.flatten(Decay(), parameters=values).notes == ("idle is set, but nothing in the model depends on it",)


def test_a_part_in_a_list_is_told_too() -> None:
    """Its index is no index of the parameter."""

    class Decay(Component):
        idle: Real = parameter(default=1.0)
        x: Real = variable(default=fixed(1.0))

        def equations(self) -> Equations:
            yield der(self.x) == -self.x

    class Row(Component):
        members: list[Decay] = part()

        def build(self) -> None:
            self.members = [Decay(), Decay()]

    assert acausal.flatten(Row(), parameters={"members[1].idle": 2.0}).notes == (
        "members[1].idle is set, but nothing in the model depends on it",
    )
