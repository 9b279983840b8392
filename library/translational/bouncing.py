"""Bouncing body: instantaneous impacts with a coefficient of restitution."""

from __future__ import annotations

from acausal import Equations, Real, boolean, der, integer, no_event, parameter, pre, reset, variable, when, where
from acausal.library.translational.interfaces import PartialRigid


class BouncingMass(PartialRigid):
    """Sliding mass whose left end bounces off a fixed obstacle at `s_stop`.

    At an impact the velocity v becomes -e*v: Newton's law of restitution, with impacts of zero duration. If the rebound
    is slower than `v_rest`, the mass comes to rest on the obstacle; it lifts off when the contact force `f_contact`
    would become a pull.
    """

    m: Real = parameter(unit="kg", min=0.0, doc="Mass")
    e: Real = parameter(default=0.8, unit="1", min=0.0, max=1.0, doc="Coefficient of restitution")
    s_stop: Real = parameter(default=0.0, unit="m", doc="Position of the obstacle")
    v_rest: Real = parameter(default=1e-6, unit="m/s", min=0.0, doc="Slowest rebound; below it the mass rests")
    v: Real = variable(unit="m/s", prefer_state=True, doc="Absolute velocity")
    a: Real = variable(unit="m/s2", doc="Absolute acceleration")
    f_contact: Real = variable(unit="N", doc="Force of the obstacle at rest, without impacts")
    resting: Real = boolean(doc="The mass lies on the obstacle")
    bounces: Real = integer(doc="Number of impacts so far")

    def equations(self) -> Equations:
        touching = self.s - self.L / 2.0 < self.s_stop
        load = self.flange_a.f + self.flange_b.f
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.m * self.a == load + self.f_contact
        yield self.f_contact == where(self.resting, -load, 0.0)
        rebound = -self.e * pre(self.v)
        slow = no_event(rebound < self.v_rest)
        yield when(
            touching & (self.v < 0.0),
            reset(self.v, where(slow, 0.0, rebound)),
            reset(self.resting, slow),
            reset(self.bounces, pre(self.bounces) + 1),
        )
        yield when(pre(self.resting) & (load > 0.0), reset(self.resting, False))
