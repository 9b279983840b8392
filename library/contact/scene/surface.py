"""Compliant contact of two bodies with friction, at all points where their shapes touch."""

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
    discrete,
    dot,
    equals,
    integer,
    maximum,
    no_event,
    pre,
    quantity,
    structural,
    variable,
    where,
)
from acausal.library.contact.collide.shapes import Box, Shape
from acausal.library.contact.manifold.point import deepest
from acausal.library.contact.manifold.touch import Touch, touches
from acausal.library.contact.scene.friction import Coulomb, FrictionLaw, Hybrid, LuGre, smooth_speed
from acausal.library.contact.scene.laws import NormalLaw
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import IDENTITY, Rotation, Vector, checked_rotation

Pose = tuple[Vector, Rotation]
_LIGHT = quantity(1e-9, "m")
"""Depth whose elastic force is the least weight in the mean velocity of points, which is 0/0 at first touch.

It is a depth rather than a force because bodies may have any weight. With a tenth of it, the corners of a tumbling box
land without time in between (AC502).
"""
_STILL = quantity(1e-9, "m/s")
"""Velocity below which the direction of sliding is smoothed."""
_BACK = 1e-3
"""A slowly sliding body sticks once it moves backward at this fraction of the velocity of slow sliding."""
AT_FRAME: Pose = ((0.0, 0.0, 0.0), IDENTITY)
"""Pose of a shape whose axes coincide with those of its body's frame."""
_STRAIGHT = as_expr((0.0, 0.0, 0.0)), as_expr(IDENTITY)


class SurfaceContact(Component):
    """Normal force and friction between the surfaces of two bodies.

    Each shape is fixed to a frame: its origin lies at `pose[0]` [m] in that frame, its axes are turned by `pose[1]`.
    The laws hold at each point of contact: four corners on the ground are four springs. Bristle friction has one
    bristle per contact, bent by the mean sliding velocity, weighted with the normal forces; what a point slips beyond
    the mean meets the friction of sliding.

    The work of all forces is accounted for: the power of the normal force (`power_normal`) is stored (`energy`) or
    damped (`power_damping`), that of friction is `power_friction`. Where points of contact change, `power_damping`
    needs the rate of the stored energy, an expression as long as the law itself: integrals of `power_normal` are
    cheaper.
    """

    frame_a: Frame = Frame()
    frame_b: Frame = Frame()

    shape_a: Shape = structural()
    shape_b: Shape = structural()
    pose_a: Pose = structural(default=AT_FRAME, doc="Position [m] and rotation of shape_a in frame_a")
    pose_b: Pose = structural(default=AT_FRAME, doc="Position [m] and rotation of shape_b in frame_b")
    law: NormalLaw = structural(doc="Normal force at each point")
    friction: FrictionLaw = structural(default=Coulomb(mu=0.0), doc="Friction force")

    depth: Real = variable(unit="m", nominal=1e-3, doc="Overlap at the deepest point that counts; negative when apart")
    F_N: Real = variable(unit="N", nominal=1e3, doc="Sum of the normal forces of all points")
    f_0: Real = variable(unit="N", shape=3, nominal=1e3, doc="Force on the body at frame_b, in world axes")
    energy: Real = variable(unit="J", doc="Energy stored in the contact")
    power_normal: Real = variable(unit="W", doc="Power taken by the normal force, stored or lost")
    power_damping: Real = variable(unit="W", doc="Power lost by the damping of the normal force")
    power_fading: Real = variable(unit="W", doc="Part of power_damping due to changing points of contact")
    slip: Real = variable(unit="m/s", shape=3, doc="Mean sliding velocity; with bristles only")
    power_friction: Real = variable(unit="W", doc="Power taken by friction; with bristles, partly stored")
    bristle: Real = variable(
        unit="m", shape=3, nominal=1e-5, doc="Deflection of the bristles, in world axes; LuGre, Hybrid"
    )
    mode: Real = integer(default=0, doc="0 stuck, 1 sliding slowly, 2 sliding; Hybrid only")
    direction: Real = discrete(unit="1", shape=3, doc="Direction of slow sliding; Hybrid only")

    def build(self) -> None:
        checked_rotation(self.pose_a[1], "pose_a[1]")
        checked_rotation(self.pose_b[1], "pose_b[1]")

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        origin, axes = self._axes()
        r_b, R_b = _placed(b, self.pose_b)
        own = _STRAIGHT if self._is_relative() else _placed(a, self.pose_a)
        points = touches(self.shape_a, self.shape_b)(*own, axes.T @ (r_b - origin), axes.T @ R_b)
        loads = [self._load(point, is_wide=len(points) > 1) for point in points]
        yield self.depth == deepest(points)
        yield self.F_N == _total([load.pressed for load in loads])
        yield self.f_0 == axes @ _total([load.force for load in loads])
        yield self.energy == _total([load.energy for load in loads])
        elastic = _total([load.elastic for load in loads])
        yield self.power_normal == _total([load.taken for load in loads])
        # Points that fade out while sliding along edges lose stored energy, which the law does not account for.
        yield self.power_fading == (elastic - der(self.energy) if any(p.share is not None for p in points) else 0.0)
        yield self.power_damping == _total([load.damping for load in loads]) + self.power_fading
        yield self.power_friction == _total([load.friction for load in loads])
        # Taking all moments about one origin needs one vector product per point; the rest is common.
        moment = axes @ _total([cross(p.place, load.force) for p, load in zip(points, loads, strict=True)])
        yield a.f == a.R.T @ self.f_0
        yield b.f == -(b.R.T @ self.f_0)
        yield a.t == a.R.T @ (moment + cross(origin - a.r_0, self.f_0))
        yield b.t == -(b.R.T @ (moment + cross(origin - b.r_0, self.f_0)))
        if self.friction.has_bristle:
            carried = _total([self._slip(p) * load.pressed for p, load in zip(points, loads, strict=True)])
            all_pressed = maximum(self.F_N, self.law.elastic(_LIGHT))
            yield self.slip == carried / all_pressed
            turns = [p.normal * (self._spin(p) * load.pressed) for p, load in zip(points, loads, strict=True)]
            turned = cross(_total(turns) / all_pressed, self.bristle)
        if isinstance(self.friction, Hybrid):
            yield from self._modes(self.friction, turned)
        elif isinstance(self.friction, LuGre):
            slip = self.slip
            straight = self.bristle / -self.friction.relaxation
            bent = self.friction.bristle_rate(self.bristle, slip) + turned
            touching = no_event(self.depth > 0)
            yield der(self.bristle) == as_expr([where(touching, bent[k], straight[k]) for k in range(3)])
        if not self.friction.has_bristle:
            yield self.slip == 0
            yield self.bristle == 0

    def _axes(self) -> tuple[Expr, Expr]:
        """Origin [m] and rotation of the axes in which points of contact are computed.

        For two boxes these are the axes of the first: its corners, faces and edges are constants there, which saves a
        tenth of the operations. For other shapes, and with bristles, they are the world axes.
        """
        return _placed(self.frame_a, self.pose_a) if self._is_relative() else _STRAIGHT

    def _is_relative(self) -> bool:
        return isinstance(self.shape_a, Box) and isinstance(self.shape_b, Box) and not self.friction.has_bristle

    def _modes(self, law: Hybrid, turned: Expr) -> Equations:
        """Transitions between the modes, and the deflection of the spring between the surfaces.

        `turned` is the rate of the deflection due to the rotation of the surfaces alone [m/s], vector.
        """
        stuck, slow = (equals(pre(self.mode), m) for m in (0, 1))
        pull, along = self._pull(law), dot(self.slip, pre(self.direction))
        # A guard that does not apply in a mode is given a value away from zero there.
        breaks = where(stuck, dot(pull, pull) - law.limit * law.limit, -1.0) > 0.0
        turns = where(slow, along + _BACK * law.v_s, law.v_s) < 0.0
        speed = smooth_speed(self.slip, _STILL)
        fast = where(stuck, -law.v_s, speed - where(slow, law.v_s, 0.5 * law.v_s)) > 0.0
        after_slow = where(turns, 0, where(fast, 2, 1))
        yield self.mode == where(stuck, where(breaks, 1, 0), where(slow, after_slow, where(fast, 2, 1)))
        pulled = smooth_speed(pull, 1e-9)
        for k in range(3):
            # At breakaway it is the direction of the pull, and that of the velocity where sliding becomes slow.
            begun = where(stuck, pull[k] / pulled, self.slip[k] / speed)
            yield self.direction[k] == where(equals(self.mode, 1) & ~slow, begun, pre(self.direction[k]))
            follows = (law.mu * self._way(k, speed) / law.s_0 - self.bristle[k]) / law.relaxation
            stretched = self.slip[k] + turned[k]
            held = where(no_event(self.depth > 0), stretched, self.bristle[k] / -law.relaxation)
            yield der(self.bristle[k]) == where(equals(self.mode, 0), held, follows)

    def _pull(self, law: Hybrid) -> Expr:
        """Force of the spring and the damper of a stuck contact per normal force [1], vector."""
        return law.s_0 * self.bristle + law.s_1 * self.slip

    def _way(self, k: int, speed: Expr) -> Expr:
        """Component `k` of the direction of sliding."""
        return where(equals(self.mode, 1), self.direction[k], self.slip[k] / speed)

    def initial_equations(self) -> Equations:
        if self.friction.has_bristle:
            yield self.bristle == 0

    def _load(self, point: Touch, *, is_wide: bool) -> _Load:
        rate = dot(point.normal, self._velocity(point))
        pressed = self.law.force(point.depth, rate)
        energy = self.law.energy(point.depth)
        elastic = self.law.elastic(point.depth)
        if point.share is not None:
            pressed, energy, elastic = (point.share * q for q in (pressed, energy, elastic))
        slip = self._slip(point)
        viscous = pressed * self.friction.drag(smooth_speed(slip, _STILL))
        drag, rubbed = slip * viscous, viscous * dot(slip, slip)
        if isinstance(self.friction, LuGre | Hybrid) and is_wide:
            drag = drag + self._turning(self.friction, point.normal, slip) * pressed
        if isinstance(self.friction, LuGre):
            # The rate relative to the surfaces: without their rotation, which bends nothing.
            held = self.friction.held(self.bristle, self.friction.bristle_rate(self.bristle, self.slip), slip)
            drag = drag + (held - point.normal * dot(held, point.normal)) * pressed
        if isinstance(self.friction, Hybrid):
            drag = drag + self._held(self.friction, point.normal, slip, is_wide=is_wide) * pressed
        if self.friction.has_bristle:
            rubbed = dot(drag, slip)
        taken, damping, kept = pressed * rate, (pressed - elastic) * rate, elastic * rate
        return _Load(point.normal * pressed + drag, pressed, energy, taken, damping, kept, rubbed)

    def _turning(self, law: LuGre | Hybrid, normal: Expr, slip: Expr) -> Expr:
        """What friction at a point is beyond that of the mean velocity, per normal force [1], vector.

        The bristle knows the mean alone: it would let a face spin on its normal as if there were no friction.
        """
        mean = self.slip - normal * dot(normal, self.slip)
        own, common = (v / smooth_speed(v, law.turning_speed) for v in (slip, mean))
        beyond = (own - common) * law.sliding(slip)
        if isinstance(law, LuGre):
            return beyond
        return as_expr([where(equals(self.mode, 2), 0.0, beyond[k]) for k in range(3)])  # there it has its own velocity

    def _held(self, law: Hybrid, normal: Expr, slip: Expr, *, is_wide: bool) -> Expr:
        """Friction per normal force at a point [1], vector in the plane of contact, without that of turning."""
        bent, speed = self.bristle * law.s_0, smooth_speed(slip, _STILL)
        bent = bent - normal * dot(bent, normal)
        way = self.direction - normal * dot(self.direction, normal)
        damped = self.slip - normal * dot(normal, self.slip) if is_wide else slip
        stuck, slow = equals(self.mode, 0), equals(self.mode, 1)
        return as_expr(
            [
                where(stuck, bent[k] + law.s_1 * damped[k], law.mu * where(slow, way[k], slip[k] / speed))
                for k in range(3)
            ]
        )

    def _spin(self, point: Touch) -> Expr:
        """Mean angular velocity of both bodies about the normal [rad/s]: bristles on a turning table turn with it.

        Source: S. Luding, Cohesive, frictional powders: contact models for tension, Granular Matter 10 (2008) 235-246,
        on tangential springs in a rotating frame of reference.
        """
        a, b = self.frame_a, self.frame_b
        return dot(point.normal, a.R @ a.w + b.R @ b.w) / 2

    def _slip(self, point: Touch) -> Expr:
        """Velocity of a relative to b in the plane of contact [m/s], in the axes of the points."""
        v = self._velocity(point)
        return v - point.normal * dot(point.normal, v)

    def _velocity(self, point: Touch) -> Expr:
        """Velocity of body a relative to body b at a point [m/s], in the axes of the points.

        Terms that do not depend on the point come first, so that all points share them.
        """
        a, b = self.frame_a, self.frame_b
        origin, axes = self._axes()
        w_a, w_b = a.R @ a.w, b.R @ b.w
        at_origin = (der(a.r_0) + cross(w_a, origin - a.r_0)) - (der(b.r_0) + cross(w_b, origin - b.r_0))
        return axes.T @ at_origin + cross(axes.T @ (w_a - w_b), point.place)


@dataclass(frozen=True, eq=False)
class _Load:
    """Load at one point: force on b [N] in its axes, its normal part [N], energy [J], and powers [W].

    `taken` is the power of the normal force; `damping` and `elastic` are the powers of its two parts.
    """

    force: Expr
    pressed: Expr
    energy: Expr
    taken: Expr
    damping: Expr
    elastic: Expr
    friction: Expr


def _placed(frame: Frame, pose: Pose) -> tuple[Expr, Expr]:
    """Position [m] and rotation of a shape in world axes."""
    r, R = pose
    place = frame.r_0 + frame.R @ as_expr(r) if any(r) else frame.r_0
    return place, frame.R if R == IDENTITY else frame.R @ as_expr(R)


def _total(terms: list[Expr]) -> Expr:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total
