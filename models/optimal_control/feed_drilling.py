"""Force-controlled drilling into steel of unknown hardness: a feed drive under a predictive controller."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
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
from acausal.library.drilling import DrillingForce, FeedDrive, PlateLevel, Workpiece
from acausal.library.multibody import Prismatic, Revolute, World
from acausal.library.rotational import Speed

if TYPE_CHECKING:
    from acausal.optimal_control import Problem

STIFFNESS, SIGMA = 1e8, math.radians(118.0)


class FeedDrilling(Component):
    """A feed drive presses a drill at constant speed into a thick block; the feed rate is the input."""

    v_ref: Real = signal_input(
        unit="m/s", min=0.0, max=5e-3, nominal=1e-3, default=1e-3, doc="Set point of the feed rate"
    )
    k_c11: Real = parameter(default=2240e6, unit="Pa", min=0.0, doc="Specific cutting force of the block")
    n: Real = parameter(default=9.28, unit="1/s", min=0.0, doc="Rotational speed")
    gap: Real = parameter(default=2e-4, unit="m", doc="Distance from the tip to the block at the start")

    world: World = part()
    slide: Prismatic = part()
    joint: Revolute = part()
    drill: DrillingForce = part()
    workpiece: Workpiece = part()
    feed: FeedDrive = part()
    speed: Speed = part()

    depth: Real = signal_output(unit="m", nominal=1e-3, doc="Depth of the tip behind the upper face")
    thrust: Real = signal_output(unit="N", nominal=1e3, doc="Thrust of the cut")
    width: Real = signal_output(unit="m", nominal=1e-2, doc="Engaged width, outer minus inner diameter")

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("depth",), unit="mm"), Panel(("thrust",)))

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.world = World(g=0.0)
        self.slide = Prismatic(n=axis, s=fixed(-self.gap), v=fixed(1e-3))
        self.joint = Revolute(n=axis, phi=fixed(0.0))
        self.workpiece = Workpiece(t=0.05)
        self.drill = DrillingForce(
            level=PlateLevel("workpiece"), t=self.workpiece.t, k=STIFFNESS, d_c=2e4, k_c11=self.k_c11
        )
        self.feed = FeedDrive(f_max=10e3)
        self.speed = Speed(w_ref=2 * math.pi * self.n)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.v_ref, self.feed.v_ref)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.speed.flange, self.joint.axis)
        yield self.depth == self.drill.s
        yield self.thrust == self.drill.thrust
        yield self.width == self.drill.d_O - self.drill.d_I


def horizon(limit: float = 3000.0, samples: int = 4, step: float = 0.01) -> Problem:
    """The problem solved at each sample: drill as deep as possible in the next ones with limited thrust [N]."""
    from acausal.optimal_control import Problem

    problem = Problem(FeedDrilling())
    problem.phase(duration=samples * step, intervals=samples)
    problem.subject_to("thrust", max=limit)
    problem.minimize(-1e3 * problem.end("depth"))
    return problem


def window(samples: int = 8, step: float = 0.01) -> Problem:
    """The last samples, from which an estimator finds k_c11 of the block."""
    from acausal.optimal_control import Problem

    problem = Problem(FeedDrilling())
    problem.phase(duration=samples * step, intervals=samples)
    problem.decide("k_c11", min=1000e6, max=5000e6)
    return problem


@dataclass
class Hardness:
    """Estimate of k_c11 [Pa] from thrust, feed rate and engaged width, by Kienzle's law; a first-order filter.

    While the thrust grows, the bottom of the hole recedes more slowly than the drill moves: the difference is the rate
    of the thrust divided by the stiffness.
    """

    k_c11: float = 2240e6
    share: float = 0.5
    step: float = 0.01
    n: float = 9.28
    thrust: float = 0.0

    MEASURED: ClassVar[tuple[str, ...]] = ("thrust", "width", "slide.v", "depth")

    def __call__(self, time: float, measured: Mapping[str, float]) -> dict[str, float]:
        """The estimated parameter for the controller."""
        thrust, width = measured["thrust"], measured["width"]
        rate = measured["slide.v"] - (thrust - self.thrust) / self.step / STIFFNESS
        self.thrust = thrust
        if thrust > 20.0 and measured["depth"] > 0.0 and rate > 0.0:
            f_z = rate / (2 * self.n)
            h = f_z * math.sin(SIGMA / 2)
            seen = thrust / (math.sin(SIGMA) * width * f_z * (h / 1e-3) ** -0.21)
            self.k_c11 += self.share * (seen - self.k_c11)
        return {"k_c11": self.k_c11}
