"""Bodies whose mass and inertia follow from their shape, and point masses."""

from __future__ import annotations

import math

from acausal import (
    Equations,
    Expr,
    Real,
    as_expr,
    assert_,
    cross,
    der,
    dot,
    identity,
    is_root,
    maximum,
    norm,
    parameter,
    potential_root,
    quantity,
    structural,
    unitless,
    variable,
)
from acausal.library.multibody.bodies import PartialTwoFrameBody
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import Vector, unit_vector
from acausal.library.multibody.world import PartialHeavy


class PartialLongBody(PartialTwoFrameBody):
    """Body of uniform density that begins at `r_shape` and extends by `length` along `length_direction`.

    frame_b is at `r`, wherever the shape ends: a cylinder may be longer or shorter than the distance of its frames.
    Source: Modelica.Mechanics.MultiBody.Parts.BodyBox and BodyCylinder, version 4.0.0.
    """

    r_shape: Real = parameter(
        default=(0.0, 0.0, 0.0), unit="m", shape=3, doc="From frame_a to the beginning of the shape, in frame_a"
    )
    length_direction: Real = parameter(
        default=lambda self: unitless(self.r - self.r_shape),
        unit="1",
        shape=3,
        doc="Direction of the length, of any size, in frame_a",
    )
    length: Real = parameter(
        default=lambda self: norm(self.r - self.r_shape), unit="m", min=0.0, doc="Length along length_direction"
    )
    density: Real = parameter(default=7700.0, unit="kg/m3", min=0.0, doc="Density")

    def equations(self) -> Equations:
        yield assert_(
            dot(self.length_direction, self.length_direction) > 0.0,
            "it has no direction: give r other than r_shape, or length_direction",
        )

    def demand_extent(self, m: Expr) -> Equations:
        """Assert that a body without a given mass has a length: otherwise errors would concern whole assemblies."""
        yield assert_(
            (self.length > 0) | (m > 0),
            "its length is 0, and so is the mass that follows from it: give r other than r_shape, length, or m",
        )

    def centre(self) -> Expr:
        """Centre of mass [m], resolved in frame_a, shape (3,)."""
        return self.r_shape + self._along() * (self.length / 2)

    def _along(self) -> Expr:
        return self.length_direction / norm(self.length_direction)


class BodyCylinder(PartialLongBody):
    """Cylinder or tube of uniform density, along the line from frame_a to frame_b by default."""

    diameter: Real = parameter(unit="m", min=0.0, doc="Outer diameter")
    inner_diameter: Real = parameter(default=0.0, unit="m", min=0.0, doc="Diameter of the bore")
    m: Real = parameter(default=lambda self: self._mass(), unit="kg", min=0.0, doc="Mass")
    tensor: Real = parameter(
        default=lambda self: self._tensor(), unit="kg.m2", shape=(3, 3), doc="Inertia about the centre of mass"
    )

    def equations(self) -> Equations:
        yield assert_(self.inner_diameter <= self.diameter, "the bore is wider than the cylinder")
        yield from self.demand_extent(self.m)
        yield from self.balance(self.m, self.centre(), self.tensor)

    def _mass(self) -> Expr:
        area = math.pi / 4 * (self.diameter * self.diameter - self.inner_diameter * self.inner_diameter)
        return self.density * area * self.length

    def _tensor(self) -> Expr:
        squares = self.diameter * self.diameter + self.inner_diameter * self.inner_diameter
        along = self.m * squares / 8
        across = self.m * (self.length * self.length + 0.75 * squares) / 12
        return across * identity(3) + (along - across) * _outer(self._along())


class BodyBox(PartialLongBody):
    """Box of uniform density, solid or hollow from end to end, along the line from frame_a to frame_b by default.

    `width` is measured along `width_direction`, made perpendicular to the length; `height` perpendicular to both. The
    direction has no default because none fits every `r`: it must not be parallel to the length.
    """

    width: Real = parameter(unit="m", min=0.0, doc="Width")
    height: Real = parameter(default=lambda self: self.width, unit="m", min=0.0, doc="Height")
    inner_width: Real = parameter(default=0.0, unit="m", min=0.0, doc="Width of the hollow")
    inner_height: Real = parameter(default=lambda self: self.inner_width, unit="m", min=0.0, doc="Height of the hollow")
    width_direction: Vector = structural(doc="In frame_a")
    m: Real = parameter(default=lambda self: self._mass(), unit="kg", min=0.0, doc="Mass")
    tensor: Real = parameter(
        default=lambda self: self._tensor(), unit="kg.m2", shape=(3, 3), doc="Inertia about the centre of mass"
    )

    def equations(self) -> Equations:
        hollow = self.inner_width * self.inner_height
        yield assert_(
            (self.inner_width <= self.width)
            & (self.inner_height <= self.height)
            & ((hollow <= 0) | (self._area() > 0)),
            "the hollow is not smaller than the box",
        )
        z = cross(self._along(), self._width_direction())
        yield assert_(dot(z, z) > _PARALLEL**2, "width_direction is parallel to the length")
        yield from self.demand_extent(self.m)
        yield from self.balance(self.m, self.centre(), self.tensor)

    def _width_direction(self) -> Expr:
        return as_expr(unit_vector(self.width_direction, "width_direction"))

    def _area(self) -> Expr:
        return self.width * self.height - self.inner_width * self.inner_height

    def _mass(self) -> Expr:
        return self.density * self.length * self._area()

    def _tensor(self) -> Expr:
        x = self._along()
        z = cross(x, self._width_direction())
        z = z / norm(z)
        y = cross(z, x)
        # Ratio of missing to present area: a box without width has no hollow, but no area to divide by either.
        missing = self.inner_width * self.inner_height / maximum(self._area(), 1e-300)
        length, width, height = (d * d for d in (self.length, self.width, self.height))
        width = width + missing * (width - self.inner_width * self.inner_width)
        height = height + missing * (height - self.inner_height * self.inner_height)
        about_x, about_y, about_z = width + height, length + height, length + width
        return self.m / 12 * (about_x * _outer(x) + about_y * _outer(y) + about_z * _outer(z))


_ROUNDING = quantity(1e-11, "m")
"""Lever arm of rounding errors: a torque below this length times the acting force counts as none."""
_LEAST = quantity(1.0, "m/s2"), quantity(1e-100, "N2")
"""Lower bounds of that force, since torques are rounded without any force too: an acceleration and a tiny force."""
_TURNED = (
    "a torque acts on parts fixed to it, but a point mass has no rotational inertia: its axes would stand still; "
    "connect a Body with an inertia, instead or in addition"
)

_PARALLEL = 1e-6
"""Sine of the angle below which two directions count as parallel: their cross product would have no correct digits."""


class PointMass(PartialHeavy):
    """Point mass, which has a position and a velocity but no orientation.

    Forces may act on it from any side. If a rod is fixed to it, another component must determine the rotation of that:
    a joint with angles, or a Body. An unbalanced torque ends the run.
    """

    frame_a: Frame = Frame()
    r_0: Real = variable(unit="m", shape=3, doc="Position, in world axes")
    v_0: Real = variable(unit="m/s", shape=3, doc="Velocity, in world axes")
    a_0: Real = variable(unit="m/s2", shape=3, doc="Acceleration, in world axes")
    m: Real = parameter(unit="kg", min=0.0, doc="Mass")

    def ties(self) -> Equations:
        # Last choice: any body of the island is a better root, because a point mass would keep its axes fixed.
        yield potential_root(self.frame_a, 10000)

    def equations(self) -> Equations:
        a = self.frame_a
        yield self.r_0 == a.r_0
        yield self.v_0 == der(self.r_0)
        yield self.a_0 == der(self.v_0)
        yield a.f == self.m * (a.R.T @ (self.a_0 - self.gravity_at(self.r_0)))
        if is_root(a):
            # Its axes do not turn, which is arbitrary as long as no other part of the island has an orientation. Parts
            # that should turn would silently be held: a point mass on a rod would not fall.
            yield a.R == identity(3)
            yield a.w == 0
            # A product: without any torque it is identically zero, and the assertion vanishes.
            forces = dot(a.f, a.f) + (self.m * _LEAST[0]) ** 2 + _LEAST[1]
            yield assert_(dot(a.t, a.t) * (1 / forces) <= _ROUNDING**2, _TURNED)
        else:
            yield a.t == 0


def _outer(e: Expr) -> Expr:
    return as_expr([[a * b for b in e] for a in e])
