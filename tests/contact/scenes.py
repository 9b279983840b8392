"""Small contact scenes that several tests share."""

from __future__ import annotations

from acausal import Component, Equations, Real, connect, fixed, parameter, part, quantity, structural, time
from acausal.library.contact import (
    AT_FRAME,
    Box,
    Coulomb,
    FrictionLaw,
    HalfSpace,
    HuntCrossley,
    NormalLaw,
    Shape,
    SurfaceContact,
)
from acausal.library.drilling import EnergyBalance
from acausal.library.multibody import Body, World, WorldForce

G = 9.81
FIRM = HuntCrossley(k=1e5, n=1.0, e=0.5, v_0=0.01)


class OnGround(Component):
    """One body on or over the ground, with a gravity that may pull sideways."""

    shape: Shape = structural(default=Box((0.1, 0.1, 0.1)))
    law: NormalLaw = structural(default=FIRM)
    friction: FrictionLaw = structural(default=Coulomb(mu=0.5))
    height: Real = parameter(default=0.05, unit="m", doc="Of the centre, at the start")
    sideways: Real = parameter(default=0.0, unit="1", doc="Gravity along x over gravity")
    ramp: Real = parameter(default=0.0, unit="1/s", doc="Rate of a push along x, over gravity")
    v_x: Real = parameter(default=0.0, unit="m/s")
    w_y: Real = parameter(default=0.0, unit="rad/s")
    m: Real = parameter(default=1.0, unit="kg")
    inertia: Real = parameter(default=1.0 / 600, unit="kg.m2")

    world: World = World()
    body: Body = part()
    contact: SurfaceContact = part()
    push: WorldForce = part()
    balance: EnergyBalance = part()

    def build(self) -> None:
        g = quantity(G, "m/s2")
        body = self.body = Body(
            m=self.m,
            I_11=self.inertia,
            I_22=self.inertia,
            I_33=self.inertia,
            g_0=(self.sideways * g, 0.0, -g),
            r_0=fixed((0.0, 0.0, self.height)),
            v_0=fixed((self.v_x, 0.0, 0.0)),
            Q=fixed((0.0, 0.0, 0.0, 1.0)),
            w_a=fixed((0.0, self.w_y, 0.0)),
        )
        contact = self.contact = SurfaceContact(
            shape_a=self.shape, shape_b=HalfSpace(), pose_b=AT_FRAME, law=self.law, friction=self.friction
        )
        self.push = WorldForce(force=(self.m * g * self.ramp * time, 0.0, 0.0))
        v, w = body.v_0, body.w_a
        self.balance = EnergyBalance(
            P_source=self.m * g * ((self.sideways + self.ramp * time) * v[0] - v[2]),
            P_cutting=0.0,
            P_friction=contact.power_friction,
            P_damping=contact.power_damping,
            E=self.m / 2 * (v @ v) + self.inertia / 2 * (w @ w) + contact.energy,
        )

    def equations(self) -> Equations:
        yield connect(self.body.frame_a, self.contact.frame_a, self.push.frame_b)
        yield connect(self.world.frame_b, self.contact.frame_b)
