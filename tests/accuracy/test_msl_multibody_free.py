"""Examples of Modelica.Mechanics.MultiBody with free bodies, against their converged results."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from acausal import Component, Equations, connect, fixed, part
from acausal.library.multibody import (
    Body,
    BodyShape,
    Damper,
    Fixed,
    PointMass,
    Prismatic,
    Spring,
    SpringWithMass,
    World,
    point_field,
    quaternion,
    rotation_sequence,
)
from tests.accuracy.msl_reference import met

REST = fixed((0.0, 0.0, 0.0))
UPRIGHT = fixed((0.0, 0.0, 0.0, 1.0))


class FreeBody(Component):
    world: World = World()
    bar2: Fixed = Fixed(r=(0.8, 0.0, 0.0))
    spring1: Spring = Spring(c=20.0)
    spring2: Spring = Spring(c=20.0)
    body: BodyShape = BodyShape(
        m=1.0,
        r=(0.4, 0.0, 0.0),
        r_CM=(0.2, 0.0, 0.0),
        I_11=1.0,
        I_22=1.0,
        I_33=1.0,
        r_0=fixed((0.2, -0.5, 0.1)),
        v_0=REST,
        w_a=REST,
        Q=fixed(quaternion(rotation_sequence([math.radians(10.0)] * 3))),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.spring1.frame_a)
        yield connect(self.spring1.frame_b, self.body.frame_a)
        yield connect(self.bar2.frame_b, self.spring2.frame_a)
        yield connect(self.spring2.frame_b, self.body.frame_b)


class SpringDamperSystem(Component):
    anchor1: Fixed = Fixed(r=(0.3, 0.0, 0.0))
    anchor2: Fixed = Fixed(r=(0.6, 0.0, 0.0))
    body1: Body = Body(
        m=1.0,
        r_CM=(0.0, -0.2, 0.0),
        I_11=0.1,
        I_22=0.1,
        I_33=0.1,
        r_0=fixed((0.3, -0.2, 0.0)),
        v_0=REST,
        w_a=fixed((0.0, 0.0, math.radians(2.0))),
        Q=UPRIGHT,
    )
    spring1: Spring = Spring(c=30.0, s_unstretched=0.1)
    damper1: Damper = Damper(d=2.0)
    p2: Prismatic = Prismatic(n=(0.0, -1.0, 0.0), s=fixed(0.1), v=fixed(0.0))
    spring2: Spring = Spring(c=30.0, s_unstretched=0.1)
    body2: Body = Body(m=1.0, I_11=0.1, I_22=0.1, I_33=0.1)

    def equations(self) -> Equations:
        yield connect(self.anchor1.frame_b, self.spring1.frame_a, self.damper1.frame_a)
        yield connect(self.body1.frame_a, self.spring1.frame_b, self.damper1.frame_b)
        yield connect(self.anchor2.frame_b, self.p2.frame_a, self.spring2.frame_a)
        yield connect(self.p2.frame_b, self.spring2.frame_b, self.body2.frame_a)


class HangingMass(Component):
    world: World = World()
    spring: SpringWithMass = SpringWithMass(c=40.0, s_unstretched=0.2, m=0.5)
    body: Body = Body(m=1.0, r_0=fixed((0.0, -0.3, 0.0)), v_0=REST, w_a=REST, Q=UPRIGHT)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.spring.frame_a)
        yield connect(self.spring.frame_b, self.body.frame_a)


class PointGravity(Component):
    world: World = World(gravity=point_field(1.0))
    body1: Body = part()
    body2: Body = part()

    def build(self) -> None:
        common: dict[str, Any] = {"m": 1.0, "I_11": 0.1, "I_22": 0.1, "I_33": 0.1}
        self.body1 = Body(**common, r_0=fixed((0.0, 0.6, 0.0)), v_0=fixed((1.0, 0.0, 0.0)), w_a=REST, Q=UPRIGHT)
        self.body2 = Body(**common, r_0=fixed((0.6, 0.6, 0.0)), v_0=fixed((0.6, 0.0, 0.0)), w_a=REST, Q=UPRIGHT)


class PointGravityWithPointMasses(Component):
    bodies: list[PointMass] = part()
    spring: Spring = Spring(c=10.0)

    def build(self) -> None:
        places = ((0.0, 0.6, 0.0), (0.6, 0.6, 0.0), (0.0, 0.8, 0.0), (0.3, 0.8, 0.0))
        speeds = (1.0, 0.6, 0.6, 0.6)
        self.bodies = [
            PointMass(m=1.0, gravity=point_field(1.0), r_0=fixed(r), v_0=fixed((v, 0.0, 0.0)))
            for r, v in zip(places, speeds, strict=True)
        ]

    def equations(self) -> Equations:
        yield connect(self.spring.frame_a, self.bodies[2].frame_a)
        yield connect(self.spring.frame_b, self.bodies[3].frame_a)


EXAMPLES: dict[str, tuple[type[Component], float, dict[str, str]]] = {
    "MultiBody_FreeBody": (FreeBody, 1e-5, {"body.body": "body"}),
    "MultiBody_SpringDamperSystem": (SpringDamperSystem, 1e-5, {}),
    "MultiBody_SpringWithMass": (HangingMass, 1e-5, {}),
    # Kepler orbits of bodies, and of point masses.
    "MultiBody_PointGravity": (PointGravity, 1e-3, {}),
    "MultiBody_PointGravityWithPointMasses": (
        PointGravityWithPointMasses,
        1e-3,
        {f"body{k + 1}": f"bodies[{k}]" for k in range(4)},
    ),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_converged_solution_is_met(reference: Path, name: str) -> None:
    model, limit, renamed = EXAMPLES[name]
    met(model(), reference / "msl" / name, limit, renamed=renamed)
