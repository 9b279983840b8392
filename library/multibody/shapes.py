"""Bodies whose mass and inertia follow from a shape, and the body that is a point."""

from __future__ import annotations

import math

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    as_expr,
    cross,
    der,
    dot,
    identity,
    is_root,
    parameter,
    potential_root,
    sqrt,
    structural,
    variable,
)
from acausal.library.multibody.bodies import PartialTwoFrameBody
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.gravity import STANDARD_GRAVITY, Field, uniform_field
from acausal.library.multibody.orientation import Vector, unit_vector


class BodyCylinder(PartialTwoFrameBody):
    """Cylinder or tube of uniform density along the line from frame_a to frame_b."""

    diameter: Real = parameter(unit="m", min=0.0, doc="Outer diameter")
    inner_diameter: Real = parameter(default=0.0, unit="m", min=0.0, doc="Diameter of the bore")
    density: Real = parameter(default=7700.0, unit="kg/m3", min=0.0, doc="Density")
    length: Real = parameter(default=lambda self: sqrt(dot(self.r, self.r)), unit="m", doc="Length")
    m: Real = parameter(default=lambda self: self._mass(), unit="kg", min=0.0, doc="Mass")
    tensor: Real = parameter(
        default=lambda self: self._tensor(), unit="kg.m2", shape=(3, 3), doc="Inertia about the centre of mass"
    )

    def equations(self) -> Equations:
        yield from self.balance(self.m, self.r / 2, self.tensor)

    def _mass(self) -> Expr:
        area = math.pi / 4 * (self.diameter * self.diameter - self.inner_diameter * self.inner_diameter)
        return self.density * area * self.length

    def _tensor(self) -> Expr:
        squares = self.diameter * self.diameter + self.inner_diameter * self.inner_diameter
        along = self.m * squares / 8
        across = self.m * (self.length * self.length + 0.75 * squares) / 12
        e = self.r / self.length
        return across * identity(3) + (along - across) * _outer(e)


class BodyBox(PartialTwoFrameBody):
    """Box of uniform density whose length runs from frame_a to frame_b.

    `width` is measured along `width_direction`, made perpendicular to `r`; `height` perpendicular to both. There is no
    default direction because none fits every `r`: it must not be parallel to it.
    """

    width: Real = parameter(unit="m", min=0.0, doc="Width")
    height: Real = parameter(default=lambda self: self.width, unit="m", min=0.0, doc="Height")
    width_direction: Vector = structural(doc="In frame_a")
    density: Real = parameter(default=7700.0, unit="kg/m3", min=0.0, doc="Density")
    length: Real = parameter(default=lambda self: sqrt(dot(self.r, self.r)), unit="m", doc="Length")
    m: Real = parameter(
        default=lambda self: self.density * self.length * self.width * self.height, unit="kg", min=0.0, doc="Mass"
    )
    tensor: Real = parameter(
        default=lambda self: self._tensor(), unit="kg.m2", shape=(3, 3), doc="Inertia about the centre of mass"
    )

    def equations(self) -> Equations:
        yield from self.balance(self.m, self.r / 2, self.tensor)

    def _tensor(self) -> Expr:
        x = self.r / self.length
        z = cross(x, as_expr(unit_vector(self.width_direction, "width_direction")))
        z = z / sqrt(dot(z, z))
        y = cross(z, x)
        length, width, height = (d * d for d in (self.length, self.width, self.height))
        about_x, about_y, about_z = width + height, length + height, length + width
        return self.m / 12 * (about_x * _outer(x) + about_y * _outer(y) + about_z * _outer(z))


class PointMass(Component):
    """Mass without extension: it has a place and a velocity, and no orientation."""

    frame_a: Frame = Frame()
    r_0: Real = variable(unit="m", shape=3, doc="Position, in world axes")
    v_0: Real = variable(unit="m/s", shape=3, doc="Velocity, in world axes")
    a_0: Real = variable(unit="m/s2", shape=3, doc="Acceleration, in world axes")
    m: Real = parameter(unit="kg", min=0.0, doc="Mass")
    g_0: Real = parameter(
        default=(0.0, -STANDARD_GRAVITY, 0.0), unit="m/s2", shape=3, doc="Vector of gravity in world axes"
    )
    gravity: Field = structural(default=uniform_field, doc="Field of gravity; the uniform one is g_0 everywhere")

    def ties(self) -> Equations:
        # Last choice: any body of the island is a better root, because a point mass would hold its axes still.
        yield potential_root(self.frame_a, 10000)

    def equations(self) -> Equations:
        a = self.frame_a
        yield self.r_0 == a.r_0
        yield self.v_0 == der(self.r_0)
        yield self.a_0 == der(self.v_0)
        yield a.f == self.m * (a.R.T @ (self.a_0 - self.gravity(self.g_0, self.r_0)))
        if is_root(a):
            yield a.R == identity(3)
            yield a.w == 0
        else:
            yield a.t == 0


def _outer(e: Expr) -> Expr:
    return as_expr([[a * b for b in e] for a in e])
