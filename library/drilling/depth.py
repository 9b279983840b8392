"""Drilled depth of a hole (target depth)."""

from __future__ import annotations

from acausal import Component, Equations, Real, der, parameter, signal_input, signal_output, where


class DrillDepthCalculation(Component):
    """Depth of the bottom of the hole, which increases with the feed and never decreases.

    Source: founding paper, equations (17) to (19). The paper leaves open what happens before the first touch and on
    withdrawal; here the bottom moves only while the tip is behind the entry face, and only forward.
    """

    z_E: Real = parameter(default=2.0, unit="1", min=1.0, doc="Number of cutting edges")
    s_start: Real = parameter(default=0.0, unit="m", min=0.0, doc="Depth of the hole at the start")

    s: Real = signal_input(unit="m", doc="Depth of the tip, from DrillGeometry")
    f_z: Real = signal_input(unit="m", doc="Feed per edge and revolution, not negative, from DrillContactForce")
    n: Real = signal_input(unit="1/s", doc="Rotational speed, not negative, from DrillGeometry")
    f: Real = signal_output(unit="m", doc="Feed per revolution")
    v_tar: Real = signal_output(unit="m/s", doc="Target feed rate")
    s_tar: Real = signal_output(unit="m", doc="Target depth")

    def equations(self) -> Equations:
        yield self.f == self.z_E * self.f_z
        yield self.v_tar == self.f * self.n
        # An event although the rate is continuous: with a prescribed feed nothing else changes, and a solver taking
        # large steps before the contact could step over all of it.
        yield der(self.s_tar) == where(self.s > 0, self.v_tar, 0.0)

    def initial_equations(self) -> Equations:
        yield self.s_tar == self.s_start
