"""A plate drilled in the shortest time that limits of thrust, torque, power and breakthrough allow."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Panel,
    Real,
    connect,
    fixed,
    parameter,
    part,
    signal_input,
    signal_output,
)
from acausal.library.blocks import FirstOrder
from acausal.library.drilling import DrillingForce, PlateLevel, Workpiece
from acausal.library.multibody import Prismatic, Revolute, World
from acausal.library.rotational import Speed
from acausal.library.translational import Force, Mass

if TYPE_CHECKING:
    from acausal.optimal_control import Problem

# The drill of the founding paper: diameter and half the point angle.
DIAMETER, KAPPA = 16e-3, math.radians(59.0)
CONE = DIAMETER / (2 * math.tan(KAPPA))


class PlateDrilling(Component):
    """A drill goes through a steel plate; force and rotational speed are inputs.

    The feed axis has a mass; the spindle follows the set point of its speed with a lag.
    """

    F: Real = signal_input(unit="N", min=0.0, max=6e3, nominal=4e3, default=2000.0, doc="Feed force")
    n: Real = signal_input(
        unit="1/s", min=1.0, max=20.0, nominal=10.0, default=9.28, doc="Set point of the rotational speed"
    )
    m: Real = parameter(default=50.0, unit="kg", min=0.0, doc="Mass of the feed axis")
    t: Real = parameter(default=20e-3, unit="m", min=1e-6, doc="Thickness of the plate")
    gap: Real = parameter(default=1e-3, unit="m", doc="Distance from the tip to the plate at the start")
    n_0: Real = parameter(default=10.0, unit="1/s", doc="Rotational speed at the start")
    v_0: Real = parameter(default=5e-3, unit="m/s", doc="Feed rate at the start")

    world: World = part()
    slide: Prismatic = part()
    mass: Mass = part()
    joint: Revolute = part()
    drill: DrillingForce = part()
    workpiece: Workpiece = part()
    force: Force = part()
    drive: FirstOrder = part()
    speed: Speed = part()

    depth: Real = signal_output(unit="m", nominal=1e-2, doc="Depth of the tip behind the upper face")
    feed: Real = signal_output(unit="m/s", nominal=1e-3, doc="Feed rate")
    thrust: Real = signal_output(unit="N", nominal=1e3, doc="Thrust of the cut")
    torque: Real = signal_output(unit="N.m", nominal=10.0, doc="Torque of the cut")
    power: Real = signal_output(unit="W", nominal=1e3, doc="Power of the spindle")

    experiment: ClassVar[Experiment] = Experiment(stop_time=45.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("depth",), title="Depth of the tip", unit="mm"),
        Panel(("thrust",), title="Thrust"),
        Panel(("torque",), title="Torque"),
    )

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.world = World(g=0.0)
        self.slide = Prismatic(n=axis, s=fixed(-self.gap), v=fixed(self.v_0))
        self.mass = Mass(m=self.m)
        self.joint = Revolute(n=axis, phi=fixed(0.0))
        self.workpiece = Workpiece(t=self.t)
        self.drill = DrillingForce(level=PlateLevel("workpiece"), t=self.workpiece.t, k=1e8, d_c=2e4)
        self.force = Force()
        self.drive = FirstOrder(k=2.0 * math.pi, T=0.05, y=fixed(2.0 * math.pi * self.n_0))
        self.speed = Speed()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.F, self.force.u)
        yield connect(self.force.flange, self.mass.flange_a)
        yield connect(self.mass.flange_b, self.slide.axis)
        yield connect(self.n, self.drive.u)
        yield connect(self.drive.y, self.speed.w_ref)
        yield connect(self.speed.flange, self.joint.axis)
        yield self.depth == self.drill.s
        yield self.feed == self.slide.v
        yield self.thrust == self.drill.thrust
        yield self.torque == self.drill.torque
        yield self.power == self.drill.torque * self.joint.w


def least_time(intervals: int = 5, parameters: Mapping[str, float] | None = None, price: float = 0.0) -> Problem:
    """The shortest time from 1 mm above the plate to where the cone has left it, with values of parameters by path.

    Where only the feed is at its limit, the rotational speed does not affect the time. A price [s] on changes of speed,
    stated for one of 20 1/s within the lag of the spindle, makes it unique.
    """
    from acausal.optimal_control import Problem

    problem = Problem(PlateDrilling(), parameters=parameters)
    depth, thickness = problem["depth"], 20e-3
    problem.phase("air", until="depth > 0", intervals=intervals)
    problem.phase("entering", until=depth >= CONE, intervals=intervals)
    problem.phase("full", until=depth >= thickness, intervals=intervals)
    leaving = problem.phase("leaving", until=depth >= thickness + CONE, intervals=intervals)
    problem.subject_to("feed", max=20e-3)
    problem.subject_to("thrust", max=4e3)
    problem.subject_to("torque", max=20.0)
    problem.subject_to("power", max=1e3)
    leaving.subject_to("feed", max=5e-3)
    change = (problem["n"] - problem["drive.y"] / (2 * math.pi)) / 20.0
    problem.minimize(problem.duration + (price / 0.05 * problem.integral(change**2) if price else 0.0))
    return problem
