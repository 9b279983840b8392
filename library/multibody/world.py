"""The inertial frame."""

from __future__ import annotations

from acausal import Component, Equations, Real, identity, parameter, root, structural
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.gravity import STANDARD_GRAVITY
from acausal.library.multibody.orientation import Vector, unit_vector


class World(Component):
    """World frame and uniform gravity.

    Bodies do not look for a world: bind their gravity to this one, `Body(m=1.0, g_0=self.world.g_0)`. Their
    default is the default of this class, so that only a model with another gravity has to.
    """

    frame_b: Frame = Frame()
    n: Vector = structural(default=(0.0, -1.0, 0.0), doc="Direction of gravity in world axes")
    g: Real = parameter(default=STANDARD_GRAVITY, unit="m/s2", doc="Acceleration of gravity")
    g_0: Real = parameter(
        default=lambda self: tuple(self.g * e for e in unit_vector(self.n)),
        unit="m/s2",
        shape=3,
        doc="Vector of gravity in world axes",
    )

    def ties(self) -> Equations:
        yield root(self.frame_b)

    def equations(self) -> Equations:
        yield self.frame_b.r_0 == 0
        yield self.frame_b.R == identity(3)
        yield self.frame_b.w == 0
