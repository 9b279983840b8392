"""Force-controlled feed: approach, hold the thrust, detect the breakthrough, retract."""

from __future__ import annotations

import math

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    assert_,
    clamp,
    der,
    discrete,
    minimum,
    parameter,
    quantity,
    reset,
    signal_input,
    signal_output,
    time,
    unitless,
    variable,
    when,
    where,
)
from acausal.library.drilling.materials import Material
from acausal.library.drilling.tool import Tool

APPROACH, DRILLING, EXIT, RETRACT, DONE = range(5)
"""Values of `ForceControl.phase`."""


def feed_rate_under(
    thrust: Expr | float, n: Expr | float, *, tool: Tool, material: Material, factor: float | None = None
) -> Expr:
    """Feed rate [m/s] of a drill at full diameter under a constant thrust.

    Founding paper, equations (16) to (18), with d_O = d and d_I = 0; no indentation, no correction factors.

    Parameters
    ----------
    thrust
        Force along the axis [N].
    n
        Rotational speed [1/s].
    factor
        Ratio of thrust to cutting force [1]; sin(sigma), as printed in the paper, by default.
    """
    ratio = math.sin(tool.sigma) if factor is None else factor
    share = unitless(thrust) / (ratio * tool.z_E / 2 * tool.d * material.k_c11 * 1e-3)
    f_z: Expr = 1e-3 * (share * math.sin(tool.sigma / 2) ** material.z) ** (1 / (1 - material.z))
    return quantity(1.0, "m/s") * f_z * tool.z_E * unitless(n)


class ForceControl(Component):
    """Thrust controller: its output is the set point of the feed rate, its inputs are thrust and position.

    - `APPROACH` at `v_approach` until the thrust exceeds `F_touch`;
    - `DRILLING`: a PI controller holds the thrust at `F_set`; the feed rate is limited to `v_max` (the feed cap);
    - `EXIT`: the thrust has reached 90 % of `F_set` and fallen below the fraction `breakthrough` of it although the
      feed is at its cap: the tip is through. The feed continues at `v_exit` until the full diameter is through,
      `overrun` beyond. If the thrust returns meanwhile, there is another plate, and the phase is `DRILLING` again;
    - `RETRACT` at `v_retract` to the position at the start, then `DONE`.

    The proportional gain is small and the integral part dominates: the thrust of a cut responds to a change of the feed
    rate at once, like a damper, so that the integral alone makes a first-order loop. The thrust grows with the feed
    rate to the power 1 - z, hence dF/dv = (1 - z) F / v with 1 - z about 0.8; the gain is proportional to v, so that
    the loop has the same `bandwidth` from the entry of the tip to its exit.

    Source: K. J. Åström, T. Hägglund, PID Controllers, 1995; phases as in robot drilling, for example T. Olsson et al.,
    Cost-efficient drilling using industrial robots with high-bandwidth force feedback, Robotics and
    Computer-Integrated Manufacturing 26 (2010) 24-38.
    """

    F_set: Real = parameter(unit="N", min=0.0, nominal=1e3, doc="Set point of the thrust")
    v_nominal: Real = parameter(unit="m/s", min=0.0, doc="Expected feed rate at full diameter under F_set")
    bandwidth: Real = parameter(default=2 * math.pi * 8.0, unit="rad/s", min=0.0, doc="Bandwidth of the force loop")
    T_filter: Real = parameter(default=5e-3, unit="s", min=0.0, doc="Time constant of the filter of the thrust")
    F_touch: Real = parameter(default=20.0, unit="N", min=0.0, doc="Thrust above which the drill touches the workpiece")
    breakthrough: Real = parameter(
        default=0.5, unit="1", min=0.0, max=1.0, doc="Fraction of F_set below which the tip is through"
    )
    v_approach: Real = parameter(default=5e-3, unit="m/s", min=0.0, doc="Feed rate before the touch")
    v_max: Real = parameter(default=lambda self: 4 * self.v_nominal, unit="m/s", min=0.0, doc="Feed cap")
    v_exit: Real = parameter(default=lambda self: 2 * self.v_nominal, unit="m/s", min=0.0, doc="Feed rate at the exit")
    v_retract: Real = parameter(default=20e-3, unit="m/s", min=0.0, doc="Rate of the withdrawal")
    overrun: Real = parameter(default=5e-3, unit="m", min=0.0, doc="Feed after the breakthrough")
    s_start: Real = parameter(default=0.0, unit="m", doc="Position to which the drill is retracted")

    F: Real = signal_input(unit="N", doc="Measured thrust, positive against the feed")
    s: Real = signal_input(unit="m", doc="Measured position of the feed")
    v_ref: Real = signal_output(unit="m/s", nominal=1e-3, doc="Set point of the feed rate")

    F_filtered: Real = variable(unit="N", default=0.0, nominal=1e3, doc="Filtered thrust")
    v_integral: Real = variable(unit="m/s", default=0.0, nominal=1e-3, doc="Integral part")
    phase: Real = discrete(doc="0 approach, 1 drilling, 2 exit, 3 retract, 4 done")
    loaded: Real = discrete(doc="1 once the thrust has been near F_set")
    s_through: Real = discrete(unit="m", doc="Position at the last breakthrough")
    breakthroughs: Real = discrete(doc="Number of breakthroughs so far")
    breakthrough_time: Real = discrete(unit="s", doc="Time of the last breakthrough")
    process_time: Real = discrete(unit="s", doc="Time from the start to the end of the withdrawal; 0 until then")

    def equations(self) -> Equations:
        yield der(self.F_filtered) == (self.F - self.F_filtered) / self.T_filter
        yield assert_(self.v_nominal > 0, "the feed rate v_nominal is 0: a drill that does not turn cannot cut")
        yield assert_(self.F_set > self.F_touch, "the thrust F_set is not above F_touch: contact is not detected")
        # Change of feed rate per newton, 1 / (dF/dv), which varies by a factor of ten while the cone enters. It is
        # limited at the cap, because a gain that grows with the integral would defeat the anti-windup.
        per_force = clamp(self.v_integral, self.v_nominal / 4, self.v_max) / (0.8 * self.F_set)
        error = self.F_set - self.F_filtered
        wanted = self.v_integral + 0.1 * per_force * error
        held = clamp(wanted, 0.0, self.v_max)
        drilling = (self.phase > APPROACH + 0.5) & (self.phase < DRILLING + 0.5)
        windup = held - wanted
        rate = self.bandwidth * (per_force * error + windup)
        yield der(self.v_integral) == where(drilling, rate, 0.0)
        yield self.v_ref == self.of_phase(self.v_approach, held, self.v_exit, -self.v_retract, 0.0)
        yield from self.transitions()

    def of_phase(self, *values: Expr | float) -> Expr | float:
        """The value for the current phase."""
        chosen = values[-1]
        for k in range(len(values) - 2, -1, -1):
            chosen = where(self.phase < k + 0.5, values[k], chosen)
        return chosen

    def transitions(self) -> Equations:
        """Transitions between the phases."""
        F, phase = self.F_filtered, self.phase
        approaching = phase < APPROACH + 0.5
        drilling = (phase > APPROACH + 0.5) & (phase < DRILLING + 0.5)
        leaving = (phase > DRILLING + 0.5) & (phase < EXIT + 0.5)
        retracting = (phase > EXIT + 0.5) & (phase < RETRACT + 0.5)
        low = self.breakthrough * self.F_set
        yield when(
            approaching & (F > self.F_touch),
            reset(phase, DRILLING),
            reset(self.v_integral, minimum(self.v_approach, self.v_max)),
        )
        yield when(drilling & (F > 0.9 * self.F_set), reset(self.loaded, 1.0))
        yield when(
            drilling & (self.loaded > 0.5) & (F < low),
            reset(phase, EXIT),
            reset(self.loaded, 0.0),
            reset(self.s_through, self.s),
            reset(self.breakthroughs, self.breakthroughs + 1.0),
            reset(self.breakthrough_time, time),
        )
        yield when(leaving & (F > 1.1 * low), reset(phase, DRILLING), reset(self.v_integral, self.v_exit))
        yield when(leaving & (self.s > self.s_through + self.overrun), reset(phase, RETRACT))
        yield when(retracting & (self.s < self.s_start), reset(phase, DONE), reset(self.process_time, time))
