"""Convex shapes for collision detection, each in the frame of its body, lengths in m.

A shape is the convex hull of a few circles around the z axis of its frame (a point is a circle without radius), grown
by a margin: a sphere is a point with a margin, a cylinder two circles, a cone a point and a circle. From this one
description follow the support points, for numbers and for CasADi, and the contact of all pairs.
"""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from acausal.errors import DeclarationError

Vector = NDArray[np.float64]
Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]

_DEEP = 0.95
"""Fraction of the half length of a straight core from whose points rays may start."""


@dataclass(frozen=True)
class Inner:
    """A body inside a shape, from whose points the portal's ray starts: a box, or a cylinder about the z axis.

    `half` holds half lengths [m] of the box; with a `radius`, only the third counts, as that of a cylinder.
    """

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    radius: float | None = None

    def reduced(self, wide: bool) -> tuple[tuple[float, float, float], float | None]:
        """Half lengths and radius of the inner body: well inside, or `wide` and extended along the long sides.

        A wide one is very thin across the shape and almost as long as it: the mid-plane of a plate.
        """
        lengths = np.array([*self.half[:2], self.half[2]] if self.radius is None else [self.radius, self.half[2]])
        least = float(lengths.min())
        if least == 0.0:
            return self.half, self.radius
        inset = least * (0.05 + 0.9 * (least / lengths) ** 2) if wide else _DEEP * least
        left = (lengths - inset).tolist()
        if self.radius is None:
            return (left[0], left[1], left[2]), None
        return (0.0, 0.0, left[1]), left[0]


@dataclass(frozen=True)
class Shape:
    """Base of all convex shapes."""

    @property
    def margin(self) -> float:
        """Radius of the ball by which the hull of the circles is grown [m]."""
        return 0.0

    @property
    def rings(self) -> Vector:
        """Circles around z, shape (k, 4): centre x, y, z [m] and radius [m]; off the z axis points only."""
        raise NotImplementedError

    @property
    def inner(self) -> Inner:
        """The body from whose points rays start."""
        raise NotImplementedError

    @property
    def way_back(self) -> tuple[float, float]:
        """Ratios of distances up to which a tool with its tip towards -z is drawn back, not pushed through or aside."""
        return 0.0, 0.0

    def check(self, body: str) -> None:
        """Raise DeclarationError AC174 if the shape of `body` has no volume or is not convex."""
        raise NotImplementedError

    def support(self, direction: ArrayLike) -> Vector:
        """The point farthest in a direction, both in the frame of the shape, shape (3,)."""
        d = np.asarray(direction, dtype=float)
        across = math.hypot(d[0], d[1])
        rings = self.rings
        best = rings[np.argmax(rings[:, :3] @ d + rings[:, 3] * across)]
        point = np.array(best[:3])
        if across > 0.0:
            point[:2] += best[3] * d[:2] / across
        length = np.linalg.norm(d)
        return point + self.margin * d / length if length > 0.0 else point

    def interior(self) -> Vector:
        """A point well inside, shape (3,)."""
        return np.array(self.inner.centre)

    def bounding_box(self) -> Bounds:
        """Lowest and highest coordinates in the frame of the shape [m]."""
        rings = self.rings
        reach = np.stack([rings[:, 3], rings[:, 3], np.zeros(len(rings))], axis=1) + self.margin
        low, high = (rings[:, :3] - reach).min(axis=0), (rings[:, :3] + reach).max(axis=0)
        return (float(low[0]), float(low[1]), float(low[2])), (float(high[0]), float(high[1]), float(high[2]))

    def _positive(self, body: str, **lengths: float) -> None:
        for name, value in lengths.items():
            known = isinstance(value, numbers.Real)
            if not (known and math.isfinite(value) and value > 0.0):
                text = f"{value:g} m" if known else repr(value)
                self._wrong(body, f"{name} is {text}", "a contact needs a body with a volume: give a positive length")

    def _wrong(self, body: str, fact: str, help: str) -> NoReturn:
        raise DeclarationError("AC174", f"the {type(self).__name__} of {body} is not a body: its {fact}", help=help)


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball around the origin."""

    radius: float

    @property
    def margin(self) -> float:
        return self.radius

    @property
    def rings(self) -> Vector:
        return np.zeros((1, 4))

    @property
    def inner(self) -> Inner:
        return Inner((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def check(self, body: str) -> None:
        self._positive(body, radius=self.radius)


@dataclass(frozen=True)
class Box(Shape):
    """A cuboid with full edge lengths `size`, centred at the origin."""

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        try:
            x, y, z = map(float, self.size)
        except (TypeError, ValueError):
            raise DeclarationError(
                "AC174", f"a box has three edge lengths, not {self.size!r}", help="Box((length, width, height)) in m"
            ) from None
        object.__setattr__(self, "size", (x, y, z))

    @property
    def half(self) -> tuple[float, float, float]:
        """Half edge lengths [m]."""
        x, y, z = self.size
        return x / 2, y / 2, z / 2

    @property
    def rings(self) -> Vector:
        signs = np.array([(x, y, z, 0.0) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return np.asarray(signs * np.array([*self.half, 0.0]))

    @property
    def inner(self) -> Inner:
        return Inner((0.0, 0.0, 0.0), self.half)

    def check(self, body: str) -> None:
        x, y, z = self.size
        self._positive(body, **{"length in x": x, "length in y": y, "thickness in z": z})


@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder about z, centred at the origin."""

    radius: float
    length: float

    @property
    def rings(self) -> Vector:
        return np.array([(0.0, 0.0, side * self.length / 2, self.radius) for side in (-1, 1)])

    @property
    def inner(self) -> Inner:
        return Inner((0.0, 0.0, 0.0), (0.0, 0.0, self.length / 2), self.radius)

    def check(self, body: str) -> None:
        self._positive(body, radius=self.radius, length=self.length)


@dataclass(frozen=True)
class Capsule(Shape):
    """A cylinder about z with half balls at its ends, centred at the origin; `length` is that of the straight part."""

    radius: float
    length: float

    @property
    def margin(self) -> float:
        return self.radius

    @property
    def rings(self) -> Vector:
        return np.array([(0.0, 0.0, side * self.length / 2, 0.0) for side in (-1, 1)])

    @property
    def inner(self) -> Inner:
        return Inner((0.0, 0.0, 0.0), (0.0, 0.0, _DEEP * self.length / 2))

    def check(self, body: str) -> None:
        self._positive(body, radius=self.radius, length=self.length)


@dataclass(frozen=True)
class Cone(Shape):
    """A cone with its tip at the origin that opens towards +z; its base has `radius` and lies at z = `length`.

    A tool: if the shortest way out of another body is through it, past the tip, the cone is drawn back instead, unless
    that is more than four times as far: then it stands on its base.
    """

    radius: float
    length: float

    @property
    def rings(self) -> Vector:
        return np.array([(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, self.length, self.radius)])

    @property
    def inner(self) -> Inner:
        return Inner((0.0, 0.0, _DEEP * self.length), (0.0, 0.0, 0.0))

    @property
    def way_back(self) -> tuple[float, float]:
        return 4.0, 0.0

    def check(self, body: str) -> None:
        self._positive(body, radius=self.radius, length=self.length)


@dataclass(frozen=True)
class PointedDrill(Shape):
    """A drill with its tip at the origin and its shank towards +z.

    A tool like `Cone`: it leaves a workpiece on the side where it came in, even if the way through is shorter; a
    shorter way aside is taken only if drawing back is more than twice as far.

    Parameters
    ----------
    diameter, length
        Diameter and total length of the drill, including the point [m].
    point_angle
        Full angle of the point [rad].
    """

    diameter: float
    point_angle: float
    length: float

    @property
    def point_length(self) -> float:
        """Length of the conical point [m]."""
        return self.diameter / 2 / math.tan(self.point_angle / 2)

    @property
    def rings(self) -> Vector:
        radius = self.diameter / 2
        return np.array([(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, self.point_length, radius), (0.0, 0.0, self.length, radius)])

    @property
    def inner(self) -> Inner:
        inset = 0.5 * min(self.diameter / 2, self.length - self.point_length)
        return Inner((0.0, 0.0, self.length - inset), (0.0, 0.0, 0.0))

    @property
    def way_back(self) -> tuple[float, float]:
        return 4.0, 2.0

    def check(self, body: str) -> None:
        self._positive(body, diameter=self.diameter, length=self.length)
        if not 0.0 < self.point_angle < math.pi:
            self._wrong(
                body, f"point angle is {self.point_angle:g} rad", "give the full angle of the point, below 180 degrees"
            )
        if self.length <= self.point_length:
            self._wrong(
                body,
                f"length {self.length:g} m is not longer than its point of {self.point_length:g} m",
                "the length is that of the whole drill, point included",
            )


@dataclass(frozen=True)
class HalfSpace(Shape):
    """Everything below z = 0 of its frame: ground, a table, a wall."""

    @property
    def rings(self) -> Vector:
        return np.zeros((0, 4))

    @property
    def inner(self) -> Inner:
        return Inner((0.0, 0.0, -1.0), (0.0, 0.0, 0.0))

    def support(self, direction: ArrayLike) -> Vector:
        """The origin in direction +z; infinite in any other."""
        d = np.asarray(direction, dtype=float)
        return np.where(d == 0.0, 0.0, np.copysign(np.inf, d)) if d[0] or d[1] or d[2] <= 0.0 else np.zeros(3)

    def bounding_box(self) -> Bounds:
        return (-math.inf, -math.inf, -math.inf), (math.inf, math.inf, 0.0)

    def check(self, body: str) -> None:
        """A half-space is always valid."""


@dataclass(frozen=True)
class ConvexHull(Shape):
    """The convex hull of points in the frame of the body, shape (n, 3) [m].

    Only the corners are kept. `from_stl` reads the points of a file and rejects a surface that is not convex.
    """

    points: tuple[tuple[float, float, float], ...]

    def __init__(self, points: ArrayLike) -> None:
        try:
            given = np.asarray(points, dtype=float)
        except (TypeError, ValueError):
            raise DeclarationError(
                "AC174", f"a convex hull is made of points, shape (n, 3), not of {points!r}"
            ) from None
        if given.ndim != 2 or given.shape[1] != 3:
            raise DeclarationError(
                "AC174", f"a convex hull is made of points, shape (n, 3), not of an array of shape {given.shape}"
            )
        object.__setattr__(self, "points", tuple(map(tuple, given.tolist())))

    @classmethod
    def from_stl(cls, path: str, scale: float = 1.0, *, body: str = "the mesh") -> ConvexHull:
        """The hull of an STL file, text or binary, whose lengths are multiplied by `scale`.

        Raises
        ------
        DeclarationError
            AC175 if the file cannot be read, AC176 if its surface is not convex.
        """
        from acausal.library.contact.collide.stl import convex_points

        return cls(convex_points(path, scale, body))

    @cached_property
    def _hull(self) -> tuple[Vector, Vector]:
        """Corners, shape (n, 3), and faces as (outward normal, -offset), shape (m, 4)."""
        from scipy.spatial import ConvexHull as Hull

        points = np.array(self.points)
        hull = Hull(points)
        return points[hull.vertices], np.asarray(hull.equations)

    @property
    def faces(self) -> Vector:
        """Faces n x = offset as (outward unit normal, offset [m]), shape (m, 4)."""
        return self._hull[1] * (1.0, 1.0, 1.0, -1.0)

    @property
    def rings(self) -> Vector:
        corners = self._hull[0]
        return np.hstack([corners, np.zeros((len(corners), 1))])

    @cached_property
    def _inner(self) -> Inner:
        from scipy.optimize import linprog

        corners, faces = self._hull
        # The centre of the largest inscribed ball; in units of the hull, since the solver's tolerances are absolute.
        middle = corners.mean(axis=0)
        size = float(np.abs(corners - middle).max())
        rows, limits = np.hstack([faces[:, :3], np.ones((len(faces), 1))]), -(faces[:, 3] + faces[:, :3] @ middle)
        found = linprog([0, 0, 0, -1], rows, limits / size, bounds=(None, None))
        centre = middle + size * found.x[:3]
        extent = (corners.max(axis=0) - corners.min(axis=0)) / 2
        room = -(faces[:, :3] @ centre + faces[:, 3])
        half = extent * float((room / (np.abs(faces[:, :3]) @ extent)).min())
        x, y, z = centre.tolist()
        a, b, c = half.tolist()
        return Inner((x, y, z), (a, b, c))

    @property
    def inner(self) -> Inner:
        return self._inner

    def check(self, body: str) -> None:
        points = np.array(self.points)
        if len(points) < 4 or not np.isfinite(points).all():
            self._wrong(body, f"points are {len(points)}", "a hull needs at least four finite points")
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[2] <= 1e-9 * spread[0]:
            self._wrong(body, "points lie in a plane: zero thickness", "give points that span a volume")
