"""A four-bar whose hinges are braked: more brakes than motions, which statics cannot tell apart."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, guess, parameter, part, time, where
from acausal.library.multibody import Body, Fixed, FixedTranslation, Revolute, RevolutePlanarLoopConstraint, World
from acausal.library.rotational import Brake, Torque

LEVEL = ((0.0, 1.0),)


class BrakedFourBar(Component):
    """A crank that turns fully, brakes of 0.7 and 1.1 N.m at its hinge and that of the rocker, no gravity."""

    w: Real = parameter(default=6.0, unit="rad/s", doc="Speed of the crank at the start")
    load: Real = parameter(default=0.0, unit="N.m", doc="Torque on the crank")
    since: Real = parameter(default=2.0, unit="s", doc="When the torque begins")
    world: World = World(g=0.0)
    left: Fixed = Fixed()
    right: Fixed = Fixed(r=(0.8, 0.1, 0.0))
    crank: Revolute = part()
    rod: Revolute = Revolute(phi=guess(-0.8))
    rocker: Revolute = Revolute(phi=guess(1.4))
    closing: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint()
    arms: list[FixedTranslation] = part()
    bodies: list[Body] = part()
    brake: Brake = Brake(fn_max=0.7, mu_pos=LEVEL)
    other: Brake = Brake(fn_max=1.1, mu_pos=LEVEL)
    drive: Torque = Torque()

    def build(self) -> None:
        self.crank = Revolute(phi=fixed(0.9), w=fixed(self.w))
        self.arms = [FixedTranslation(r=(r, 0.0, 0.0)) for r in (0.25, 0.7, 0.6)]
        self.bodies = [Body(m=1.0, I_33=0.05, r_CM=(r, 0.0, 0.0)) for r in (0.1, 0.35, 0.3)]

    def equations(self) -> Equations:
        yield connect(self.left.frame_b, self.crank.frame_a)
        yield connect(self.arms[0].frame_b, self.rod.frame_a)
        yield connect(self.right.frame_b, self.rocker.frame_a)
        for joint, arm, body in zip((self.crank, self.rod, self.rocker), self.arms, self.bodies, strict=True):
            yield connect(joint.frame_b, arm.frame_a, body.frame_a)
        yield connect(self.arms[1].frame_b, self.closing.frame_a)
        yield connect(self.closing.frame_b, self.arms[2].frame_b)
        yield connect(self.brake.flange_a, self.crank.axis)
        yield connect(self.other.flange_a, self.rocker.axis)
        yield connect(self.drive.flange, self.crank.axis)
        yield self.drive.u == where(time > self.since, self.load, 0.0)
        yield self.brake.f_normalized == 1.0
        yield self.other.f_normalized == 1.0


def energy(run: acausal.Result, row: int) -> float:
    """Of 1 kg on each link, with 0.05 kg.m2 about its centre."""
    total = 0.0
    for k, (x, joint) in enumerate(zip((0.1, 0.35, 0.3), ("crank", "rod", "rocker"), strict=True)):
        turn = run["crank.w"][row] + run["rod.w"][row] if joint == "rod" else run[f"{joint}.w"][row]
        R = np.array([[run[f"bodies[{k}].frame_a.R[{i},{j}]"][row] for j in range(2)] for i in range(2)])
        v = [run[f"bodies[{k}].v_0[{i}]"][row] for i in range(2)] + R @ [0.0, x * turn]
        total += 0.5 * float(v @ v) + 0.5 * 0.05 * turn**2
    return total


@pytest.mark.parametrize(("w", "solver"), [(6.0, "idas"), (-4.0, "rosenbrock")])
def test_brakes_take_all_energy_and_hold(w: float, solver: str) -> None:
    """Each brake takes its torque times the way of its hinge; then both hold the sum of their torques, both ways.

    Runs ended with AC506: accelerations that correct errors of the velocities within the tolerance were taken for a
    motion that the brakes cannot hold.
    """
    compiled = acausal.compile(BrakedFourBar())
    options = {"stop_time": 3.0, "solver": solver, "tolerance": 1e-8, "output_interval": 0.01}
    free = acausal.simulate(compiled, parameters={"w": w}, **options)  # type: ignore[arg-type]
    ways = [float(np.abs(np.diff(free[f"{joint}.phi"])).sum()) for joint in ("crank", "rocker")]
    assert 0.7 * ways[0] + 1.1 * ways[1] == pytest.approx(energy(free, 0), rel=1e-3)  # the rocker turns between rows
    slow = int(np.flatnonzero(np.abs(free["crank.w"]) > 1e-2)[-1])
    limit = 0.7 + 1.1 * float(abs(free["rocker.w"][slow] / free["crank.w"][slow]))
    for load in (-0.97 * limit, 0.97 * limit, 1.03 * limit):
        run = acausal.simulate(compiled, parameters={"w": w, "load": load}, **options)  # type: ignore[arg-type]
        assert (abs(float(run["crank.phi"][-1] - free["crank.phi"][-1])) < 1e-6) == (load < limit)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_it_rests_from_the_start_up_to_the_sum_of_both_brakes(share: float) -> None:
    """Virtual work: the crank holds up to 0.7 N.m + 1.1 N.m times the ratio of the speeds. Starts ended with AC304."""
    moving = acausal.simulate(BrakedFourBar(w=1.0), stop_time=1e-3)
    limit = 0.7 + 1.1 * float(abs(moving["rocker.w"][0]))
    run = acausal.simulate(BrakedFourBar(w=0.0, load=share * limit, since=-1.0), stop_time=1.0, tolerance=1e-8)
    assert (abs(float(run["crank.phi"][-1]) - 0.9) < 1e-7) == (abs(share) < 1.0)
