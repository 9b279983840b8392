"""A thin wheel that rolls on a plane."""

from __future__ import annotations

from acausal import Component, Equations, Real, as_expr, cross, der, dot, norm, parameter, structural, variable
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import Vector, unit_vector
from acausal.library.multibody.rotations import resolve_in_frame, resolve_in_world


class RollingWheel(Component):
    """Contact of a thin wheel with the plane through the world's origin, without lift-off or slip.

    frame_a is the centre of the wheel, its y axis the axle. The plane can pull as well as push, with unlimited
    friction: `f_n` and the other forces show whether a real plane could. Singular where the wheel lies flat.
    (Modelica.Mechanics.MultiBody.Joints.RollingWheel; here the coordinates are those of the body.)
    """

    frame_a: Frame = Frame()
    radius: Real = parameter(unit="m", min=0.0, doc="Radius of the wheel")
    n: Vector = structural(default=(0.0, 1.0, 0.0), doc="Normal of the plane, towards the wheel, in world axes")
    f_n: Real = variable(unit="N", doc="Force of the plane on the wheel, along n")
    f_long: Real = variable(unit="N", doc="Force of the plane on the wheel, in the direction of rolling")
    f_lat: Real = variable(unit="N", doc="Force of the plane on the wheel, sideways")

    def build(self) -> None:
        self._n = unit_vector(self.n)

    def equations(self) -> Equations:
        a = self.frame_a
        n = as_expr(self._n)
        axle = resolve_in_world(a, as_expr((0.0, 1.0, 0.0)))
        ahead = cross(axle, n)
        e_long = ahead / norm(ahead)
        e_lat = cross(n, e_long)
        to_contact = self.radius * cross(axle, e_long)
        slip = der(a.r_0) + cross(resolve_in_world(a, a.w), to_contact)
        yield dot(n, a.r_0 + to_contact) == 0
        yield dot(e_long, slip) == 0
        yield dot(e_lat, slip) == 0
        force = self.f_n * n + self.f_long * e_long + self.f_lat * e_lat
        yield a.f == -resolve_in_frame(a, force)
        yield a.t == -resolve_in_frame(a, cross(to_contact, force))
