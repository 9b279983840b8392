"""A robot arm whose motors reach their limits: point to point in the shortest time, with a price on effort."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from acausal import Component, Equations, Experiment, Panel, connect, fixed, free, part, structural
from acausal.library.multibody import Body, FixedTranslation, Revolute, World
from acausal.library.rotational import Inertia, Torque

if TYPE_CHECKING:
    from acausal.optimal_control import Problem

Vector = tuple[float, float, float]

# From the Modelica Standard Library, MultiBody.Examples.Systems.RobotR3: axes, ways to the next axis [m], masses [kg],
# centres [m], moments of inertia [kg.m2] about the centre (11, 22, 33), rotors as the gears show them [kg.m2].
AXES: tuple[Vector, ...] = ((0, 1, 0), (1, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0))
WAYS: tuple[Vector, ...] = ((0, 0.324, 0.3), (0, 0.65, 0), (0, 0.414, -0.155), (0, 0.186, 0), (0, 0.125, 0), (0, 0, 0))
MASSES = (1.0, 56.5, 26.4, 28.7, 5.2, 0.5)
CENTRES: tuple[Vector, ...] = ((0, 0, 0), (0.172, 0.205, 0), (0.064, -0.034, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0))
INERTIAS: tuple[Vector, ...] = (
    (1.16, 1.16, 1.16),
    (2.58, 0.64, 2.73),
    (0.279, 0.245, 0.413),
    (1.67, 0.081, 1.67),
    (1.25, 0.81, 1.53),
    (0.01, 0.01, 0.01),
)
ROTORS = (14.3, 57.3, 4.68, 15.7, 10.0, 15.7)
LOAD, LOAD_CENTRE = 15.0, (0.1, 0.25, 0.1)
LIMITS = (1200.0, 2000.0, 1000.0, 300.0, 250.0, 200.0)
"""Largest torques of the motors at the output of their gears [N.m]."""


class RobotArm(Component):
    """A loaded arm of one to six joints; each joint has a motor whose torque, zero by default, is to be optimised.

    Geometry and masses are those of the robot of the Modelica Standard Library; its motors, gears and controllers are
    replaced by rotors without friction.
    """

    joints: int = structural(default=6, doc="Number of joints, counted from the ground")
    start: Sequence[float] = structural(default=(0.0,) * 6, doc="Angles at the start [rad]")

    world: World = part()
    axis: list[Revolute] = part()
    way: list[FixedTranslation] = part()
    body: list[Body] = part()
    rotor: list[Inertia] = part()
    motor: list[Torque] = part()
    load: Body = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("axis[0].phi", "axis[1].phi"), title="Angles"),)

    def build(self) -> None:
        count = range(self.joints)
        self.world = World()
        self.axis = [Revolute(n=AXES[k], phi=fixed(self.start[k]), w=fixed(0.0)) for k in count]
        self.way = [FixedTranslation(r=WAYS[k]) for k in count]
        self.body = [
            Body(m=MASSES[k], r_CM=CENTRES[k], I_11=INERTIAS[k][0], I_22=INERTIAS[k][1], I_33=INERTIAS[k][2])
            for k in count
        ]
        self.rotor = [Inertia(J=ROTORS[k]) for k in count]
        self.motor = [Torque(u=0.0) for _ in count]
        self.load = Body(m=LOAD, r_CM=LOAD_CENTRE)

    def equations(self) -> Equations:
        before = self.world.frame_b
        for k in range(self.joints):
            yield connect(before, self.axis[k].frame_a)
            yield connect(self.axis[k].frame_b, self.way[k].frame_a, self.body[k].frame_a)
            yield connect(self.motor[k].flange, self.rotor[k].flange_a)
            yield connect(self.rotor[k].flange_b, self.axis[k].axis)
            before = self.way[k].frame_b
        yield connect(before, self.load.frame_a)


def point_to_point(joints: int = 6, price: float = 0.01, intervals: int = 12) -> Problem:
    """From stretched upwards to a quarter turn with bent elbow, at rest at both ends: minimises time and priced effort.

    `price` [s] is the cost of one second with all torques at their limits.
    """
    from acausal.optimal_control import Problem

    goal = (1.2, -0.8, 1.0, 0.7, -0.6, 0.5)
    arm = free(RobotArm(joints=joints), *(f"motor[{k}].u" for k in range(joints)))
    problem = Problem(arm)
    problem.phase(duration=(0.1, 5.0), intervals=intervals, expected=1.0)
    effort = 0.0
    for k in range(joints):
        problem.subject_to(f"motor[{k}].u", min=-LIMITS[k], max=LIMITS[k])
        problem.subject_to(problem.end(f"axis[{k}].phi") == goal[k])
        problem.subject_to(problem.end(f"axis[{k}].w") == 0.0)
        effort = effort + (problem[f"motor[{k}].u"] / LIMITS[k]) ** 2
    problem.guess(lines={f"axis[{k}].phi": (0.0, goal[k]) for k in range(joints)})
    problem.minimize(problem.duration + price * problem.integral(effort))
    return problem
