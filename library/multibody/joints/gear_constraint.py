"""Two shafts in one bearing, coupled by a gear."""

from __future__ import annotations

from acausal import Component, Equations, Real, connect, parameter, part, structural
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.joints.revolute import Revolute
from acausal.library.multibody.orientation import Vector
from acausal.library.multibody.parts import FixedTranslation
from acausal.library.rotational import IdealGear


class GearConstraint(Component):
    """Ideal gear between two shafts that turn in a common bearing: `phi_a == ratio * phi_b`.

    The bearing takes the difference of the torques. Start values and drives belong to either `revolute_a` or
    `revolute_b`. (Modelica.Mechanics.MultiBody.Joints.GearConstraint.)
    """

    frame_a: Frame = Frame()
    frame_b: Frame = Frame()
    bearing: Frame = Frame()
    n_a: Vector = structural(default=(1.0, 0.0, 0.0), doc="Axis of shaft a, in bearing")
    n_b: Vector = structural(default=(1.0, 0.0, 0.0), doc="Axis of shaft b, in bearing")
    r_a: Real = parameter(default=(0.0, 0.0, 0.0), unit="m", shape=3, doc="From bearing to shaft a, in bearing")
    r_b: Real = parameter(default=(0.0, 0.0, 0.0), unit="m", shape=3, doc="From bearing to shaft b, in bearing")
    ratio: Real = parameter(unit="1", doc="Angle of shaft a divided by that of shaft b")
    revolute_a: Revolute = part()
    revolute_b: Revolute = part()
    gear: IdealGear = part()
    to_a: FixedTranslation = part()
    to_b: FixedTranslation = part()

    def build(self) -> None:
        self.revolute_a = Revolute(n=self.n_a)
        self.revolute_b = Revolute(n=self.n_b)
        self.gear = IdealGear(ratio=self.ratio)
        self.to_a = FixedTranslation(r=self.r_a)
        self.to_b = FixedTranslation(r=self.r_b)

    def equations(self) -> Equations:
        yield connect(self.bearing, self.to_a.frame_a, self.to_b.frame_a)
        yield connect(self.to_a.frame_b, self.revolute_a.frame_a)
        yield connect(self.to_b.frame_b, self.revolute_b.frame_a)
        yield connect(self.revolute_a.frame_b, self.frame_a)
        yield connect(self.revolute_b.frame_b, self.frame_b)
        yield connect(self.revolute_a.axis, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.revolute_b.axis)
