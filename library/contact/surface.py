"""The contact of two bodies: compliant, with friction, at all points where their shapes touch."""

from __future__ import annotations

from dataclasses import dataclass

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    as_expr,
    cross,
    der,
    dot,
    maximum,
    no_event,
    structural,
    variable,
    where,
)
from acausal.library.contact.friction import Coulomb, FrictionLaw, LuGre, smooth_speed
from acausal.library.contact.laws import NormalLaw
from acausal.library.contact.shapes import Shape
from acausal.library.contact.touch import Touch, touches
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import IDENTITY, Rotation, Vector

Pose = tuple[Vector, Rotation]
_LIGHT = 1e-2
"""Normal force [N] below which bristles do not feel the whole velocity of sliding: at touch it is not to jump."""
AT_FRAME: Pose = ((0.0, 0.0, 0.0), IDENTITY)
"""A shape whose own axes are those of the frame of its body."""


class SurfaceContact(Component):
    """Normal force and friction between the surfaces of two bodies.

    Each shape is fixed to a frame: its origin lies at `pose[0]` [m] in that frame, its axes are turned by `pose[1]`.
    The laws hold at each point of contact: four corners on the ground are four springs. Friction by bristles has one
    bristle per contact, bent by the mean velocity of sliding, weighted with the normal forces.

    The work of all forces is accounted for: what the normal force takes is stored (`energy`) or damped
    (`power_damping`), what friction takes is `power_friction`.
    """

    frame_a: Frame = Frame()
    frame_b: Frame = Frame()

    shape_a: Shape = structural()
    shape_b: Shape = structural()
    pose_a: Pose = structural(default=AT_FRAME, doc="Place [m] and rotation of shape_a in frame_a")
    pose_b: Pose = structural(default=AT_FRAME, doc="Place [m] and rotation of shape_b in frame_b")
    law: NormalLaw = structural(doc="Normal force at each point")
    friction: FrictionLaw = structural(default=Coulomb(mu=0.0), doc="Friction force")

    depth: Real = variable(unit="m", nominal=1e-3, doc="Overlap at the deepest point; negative when apart")
    F_N: Real = variable(unit="N", nominal=1e3, doc="Sum of the normal forces of all points")
    f_0: Real = variable(unit="N", shape=3, nominal=1e3, doc="Force on the body at frame_b, in world axes")
    energy: Real = variable(unit="J", doc="Stored in the compliance")
    power_damping: Real = variable(unit="W", doc="Taken by the damping of the normal force")
    power_friction: Real = variable(unit="W", doc="Taken by friction; with bristles, partly stored in them")
    bristle: Real = variable(unit="m", shape=3, nominal=1e-5, doc="Bending of the bristles, in world axes; LuGre only")

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        points = touches(self.shape_a, self.shape_b)(*_placed(a, self.pose_a), *_placed(b, self.pose_b))
        loads = [self._load(point) for point in points]
        yield self.depth == _largest([p.depth for p in points])
        yield self.F_N == _total([load.pressed for load in loads])
        yield self.f_0 == _total([load.force for load in loads])
        yield self.energy == _total([load.energy for load in loads])
        yield self.power_damping == _total([load.damping for load in loads])
        yield self.power_friction == _total([load.friction for load in loads])
        # Moments about the world's origin are one vector product per point; the rest is done once.
        moment = _total([cross(p.place, load.force) for p, load in zip(points, loads, strict=True)])
        yield a.f == a.R.T @ self.f_0
        yield b.f == -(b.R.T @ self.f_0)
        yield a.t == a.R.T @ (moment - cross(a.r_0, self.f_0))
        yield b.t == -(b.R.T @ (moment - cross(b.r_0, self.f_0)))
        if isinstance(self.friction, LuGre):
            carried = _total([self._slip(p) * load.pressed for p, load in zip(points, loads, strict=True)])
            slip = carried / maximum(self.F_N, _LIGHT)
            straight = self.bristle / -self.friction.relaxation
            bent = self.friction.bristle_rate(self.bristle, slip)
            touching = no_event(self.depth > 0)
            yield der(self.bristle) == as_expr([where(touching, bent[k], straight[k]) for k in range(3)])
        else:
            yield self.bristle == 0

    def initial_equations(self) -> Equations:
        if isinstance(self.friction, LuGre):
            yield self.bristle == 0

    def _load(self, point: Touch) -> _Load:
        rate = dot(point.normal, self._velocity(point))
        pressed = self.law.force(point.depth, rate)
        energy = self.law.energy(point.depth)
        elastic = self.law.elastic(point.depth)
        if point.share is not None:
            pressed, energy, elastic = (point.share * q for q in (pressed, energy, elastic))
        slip = self._slip(point)
        drag = slip * (pressed * self.friction.drag(smooth_speed(slip, 1e-9)))
        if isinstance(self.friction, LuGre):
            held = self.friction.held(self.bristle, der(self.bristle), slip)
            drag = drag + (held - point.normal * dot(held, point.normal)) * pressed
        return _Load(point.normal * pressed + drag, pressed, energy, (pressed - elastic) * rate, dot(drag, slip))

    def _slip(self, point: Touch) -> Expr:
        """Velocity of a over b in the plane of contact [m/s], in world axes."""
        v = self._velocity(point)
        return v - point.normal * dot(point.normal, v)

    def _velocity(self, point: Touch) -> Expr:
        """Velocity of body a against body b at a point [m/s], in world axes.

        Written with what does not depend on the point in front, so that many points share it.
        """
        a, b = self.frame_a, self.frame_b
        w_a, w_b = a.R @ a.w, b.R @ b.w
        at_origin = (der(a.r_0) - cross(w_a, a.r_0)) - (der(b.r_0) - cross(w_b, b.r_0))
        return at_origin + cross(w_a - w_b, point.place)


@dataclass(frozen=True, eq=False)
class _Load:
    """What acts at one point: force on b [N] in world axes, its normal part [N], energy [J], and powers [W]."""

    force: Expr
    pressed: Expr
    energy: Expr
    damping: Expr
    friction: Expr


def _placed(frame: Frame, pose: Pose) -> tuple[Expr, Expr]:
    """Place [m] and rotation of a shape in world axes."""
    r, R = pose
    place = frame.r_0 + frame.R @ as_expr(r) if any(r) else frame.r_0
    return place, frame.R if R == IDENTITY else frame.R @ as_expr(R)


def _total(terms: list[Expr]) -> Expr:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _largest(terms: list[Expr]) -> Expr:
    largest = terms[0]
    for term in terms[1:]:
        largest = maximum(largest, term)
    return largest
