"""The bicycle of Whipple: a closed loop with two rolling wheels, linearized about riding straight on.

Source: J. P. Meijaard, J. M. Papadopoulos, A. Ruina, A. L. Schwab, Linearized dynamics equations for the balance and
steer of a bicycle: a benchmark and review, Proc. R. Soc. A 463 (2007) 1955-1982, tables 1 and 2.
"""

from __future__ import annotations

import math

import numpy as np

import acausal
from acausal import Component, Equations, connect, fixed, guess, part, structural
from acausal.library.multibody import Body, FixedTranslation, Revolute, RollingWheel, World

Vector = tuple[float, float, float]
WHEEL_BASE, TRAIL, TILT = 1.02, 0.08, math.pi / 10
REAR, FRONT = 0.3, 0.35  # radii
# table 2 at 5 m/s: weave, a pair of conjugates, capsize and castering
PUBLISHED = (-0.775341882195 + 4.464867713788j, -0.775341882195 - 4.464867713788j, -0.322866429004, -14.078389692798)


def up(x: float, y: float, z: float) -> Vector:
    """A vector of the source, whose z points down, with z up."""
    return (x, -y, -z)


def solid(m: float, r_CM: Vector, xx: float, yy: float, zz: float, xz: float = 0.0, **more: object) -> Body:
    """A body with the moments of inertia of the source."""
    return Body(m=m, r_CM=r_CM, I_11=xx, I_22=yy, I_33=zz, I_31=-xz, **more)  # type: ignore[arg-type]


class Bicycle(Component):
    """Frame with rider, fork, and two wheels; the origin of the frame is the hub of the rear wheel."""

    v: float = structural(default=5.0)
    world: World = World(n=(0.0, 0.0, -1.0), g=9.81)
    frame: Body = part()
    fork: Body = part()
    rear: Body = part()
    front: Body = part()
    to_head: FixedTranslation = part()
    to_hub: FixedTranslation = part()
    steer: Revolute = part()
    rear_hub: Revolute = Revolute(n=(0.0, 1.0, 0.0))
    front_hub: Revolute = Revolute(n=(0.0, 1.0, 0.0))
    rear_tyre: RollingWheel = RollingWheel(radius=REAR, n=(0.0, 0.0, 1.0))
    front_tyre: RollingWheel = RollingWheel(radius=FRONT, n=(0.0, 0.0, 1.0))

    def build(self) -> None:
        head = WHEEL_BASE + TRAIL  # where the steering axis meets the ground
        self.frame = solid(
            85.0,
            up(0.3, 0.0, -0.9 + REAR),
            *(9.2, 11.0, 2.8, 2.4),
            r_0=fixed((0.0, 0.0, REAR)),
            v_0=guess((self.v, 0.0, 0.0)),
            Q=fixed((0.0, 0.0, 0.0, 1.0)),
            w_a=fixed((0.0, 0.0, 0.0)),
        )
        self.to_head = FixedTranslation(r=up(head, 0.0, REAR))
        self.steer = Revolute(n=up(math.sin(TILT), 0.0, math.cos(TILT)), phi=fixed(0.0), w=fixed(0.0))
        self.fork = solid(4.0, up(0.9 - head, 0.0, -0.7), 0.05892, 0.06, 0.00708, -0.00756)
        self.to_hub = FixedTranslation(r=up(WHEEL_BASE - head, 0.0, -FRONT))
        self.rear_hub = Revolute(n=(0.0, 1.0, 0.0), phi=fixed(0.0), w=fixed(self.v / REAR))
        self.front_hub = Revolute(n=(0.0, 1.0, 0.0), phi=fixed(0.0), w=guess(self.v / FRONT))
        self.rear = solid(2.0, (0.0, 0.0, 0.0), 0.0603, 0.12, 0.0603)
        self.front = solid(3.0, (0.0, 0.0, 0.0), 0.1405, 0.28, 0.1405)

    def equations(self) -> Equations:
        yield connect(self.frame.frame_a, self.to_head.frame_a, self.rear_hub.frame_a)
        yield connect(self.rear_hub.frame_b, self.rear.frame_a, self.rear_tyre.frame_a)
        yield connect(self.to_head.frame_b, self.steer.frame_a)
        yield connect(self.steer.frame_b, self.fork.frame_a, self.to_hub.frame_a)
        yield connect(self.to_hub.frame_b, self.front_hub.frame_a)
        yield connect(self.front_hub.frame_b, self.front.frame_a, self.front_tyre.frame_a)


def test_eigenvalues_are_the_published_ones() -> None:
    """All others, of place, heading and speed, are zero, some of them twice."""
    found = acausal.linearize(Bicycle()).eigenvalues
    for value in PUBLISHED:
        assert np.abs(found - value).min() < 1e-9
    assert np.abs(found[: len(found) - 4]).max() < 1e-4
