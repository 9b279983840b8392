"""Energy balance of a drilling scene."""

from __future__ import annotations

from acausal import Component, Equations, Real, der, signal_input, signal_output, variable


class EnergyBalance(Component):
    """Work of the sources, minus the work of cutting, friction and damping and the stored energy.

    A scene binds sums of its powers and energies to the inputs: `EnergyBalance(P_source=self.spindle.power +
    self.feed.power, P_cutting=self.drill.power_cutting, ...)`. In a consistent model `residual` is the
    integration error, so it checks the model (a force without its reaction is visible) and the tolerance.

    Losses of compliances may be given by supplied power and stored energy, `P_compliant` and `E_compliant`: the lost
    power is then the rate of their difference. What is lost at one instant, as by the spring of a drill that slips off
    an edge, has no power: only in this form it is part of `W_damping`, otherwise of the residual.
    """

    P_source: Real = signal_input(unit="W", doc="Power of all sources into the scene")
    P_cutting: Real = signal_input(unit="W", doc="Power of the cut")
    P_friction: Real = signal_input(unit="W", default=0.0, doc="Power lost by friction")
    P_damping: Real = signal_input(unit="W", default=0.0, doc="Power lost in dampers and compliances")
    P_compliant: Real = signal_input(unit="W", default=0.0, doc="Power into compliances that lose a part of it")
    E_compliant: Real = signal_input(unit="J", default=0.0, doc="Energy stored in these, also contained in E")
    E: Real = signal_input(unit="J", default=0.0, doc="Kinetic and potential energy of the scene")

    W_source: Real = signal_output(unit="J", doc="Work of the sources")
    W_cutting: Real = signal_output(unit="J", doc="Work of the cut")
    W_friction: Real = signal_output(unit="J", doc="Work lost by friction")
    W_damping: Real = signal_output(unit="J", doc="Work lost by damping")
    W_given: Real = variable(unit="J", doc="Work lost by damping, and energy stored in compliances")
    E_start: Real = variable(unit="J", doc="Energy at the start")
    residual: Real = signal_output(unit="J", doc="Unaccounted work of the sources: 0 except for integration errors")

    def equations(self) -> Equations:
        yield der(self.W_source) == self.P_source
        yield der(self.W_cutting) == self.P_cutting
        yield der(self.W_friction) == self.P_friction
        yield der(self.W_given) == self.P_damping + self.P_compliant
        yield self.W_damping == self.W_given - self.E_compliant
        yield der(self.E_start) == 0.0
        spent = self.W_cutting + self.W_friction + self.W_damping
        yield self.residual == self.W_source - spent - (self.E - self.E_start)

    def initial_equations(self) -> Equations:
        yield self.W_source == 0.0
        yield self.W_cutting == 0.0
        yield self.W_friction == 0.0
        yield self.W_damping == 0.0
        yield self.E_start == self.E
