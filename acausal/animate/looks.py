"""How the components of the library look. Shapes are attached here, from outside the physics.

A look is a function of a `Part`, which knows the component, its path and its values in the result, and yields what is
to be drawn. It belongs to a class and its subclasses; `animate(..., looks={MyBody: my_look})` adds more, or replaces
these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.animate import meshes
from acausal.animate.meshes import Array, Mesh
from acausal.language.component import Component
from acausal.library.contact.collide import shapes as contact_shapes
from acausal.library.contact.scene.scene import ContactScene
from acausal.library.contact.scene.surface import SurfaceContact
from acausal.library.drilling.interfaces import PartialDrillingForce
from acausal.library.drilling.scene import WorkpieceBody
from acausal.library.drilling.workpiece import Workpiece
from acausal.library.multibody import bodies, constraints, forces, joints, line_forces, parts, shapes, world
from acausal.result import Result

STEEL, BLUE, ORANGE, DARK, GREEN, RED, GROUND = (
    "#9aa4b0",
    "#4477aa",
    "#ee8833",
    "#444a52",
    "#55a868",
    "#cc3344",
    "#c9cdd2",
)


@dataclass(frozen=True, eq=False)
class Piece:
    """A mesh in the axes of what it hangs on, with its colour `#rrggbb` and how much of it lets light through."""

    mesh: Mesh
    color: str = STEEL
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Rigid:
    """Pieces that move with a frame; `trail` is a point in it whose path is drawn."""

    pieces: tuple[Piece, ...]
    frame: str = "frame_a"
    trail: tuple[float, float, float] | None = None
    endless: bool = False
    """Whether it has no extent of its own: the ground."""
    symbol: bool = False
    """Whether it only stands for something that has no shape; it is left out where something with a shape is."""
    name: str = ""
    """What it is called behind the path of its component, when a component has several."""


@dataclass(frozen=True, eq=False)
class Stretched:
    """Pieces of length 1 along z that reach from one frame to another."""

    pieces: tuple[Piece, ...]
    frame_a: str = "frame_a"
    frame_b: str = "frame_b"


@dataclass(frozen=True, eq=False)
class Arrow:
    """The force that a component puts on what is connected to a frame, on its line of action."""

    frame: str


@dataclass(frozen=True, eq=False)
class Hole:
    """What a drill has left in a workpiece: as deep as its tip has ever been, seen from inside."""

    frame: str
    diameter: float
    point_angle: float
    thickness: float


Drawn = Rigid | Stretched | Arrow | Hole


@dataclass(frozen=True, eq=False)
class Part:
    """A component in its place, with what the result says about it; `size` is that of the scene [m]."""

    component: Component
    owner: Component | None
    path: str
    result: Result
    size: float

    def value(self, name: str) -> Any:
        """Value of a parameter or a constant, a float or an array; of a variable, at the end."""
        return self.result.final(f"{self.path}.{name}" if self.path else name)

    def largest(self, name: str) -> float:
        """The largest value over the run: a parameter of a contact that comes and goes is 0 while it is not there."""
        return float(np.nanmax(self.result[f"{self.path}.{name}" if self.path else name]))


Look = Callable[[Part], Iterable[Drawn]]


def look_of(component: Component, more: Mapping[type[Component], Look]) -> Look | None:
    """The look of the nearest class; None for what is not drawn."""
    for cls in type(component).__mro__:
        found = more.get(cls) or LOOKS.get(cls)
        if found is not None:
            return found
    return None


def _rod(to: Array, radius: float, start: Array | None = None) -> Mesh:
    begin = np.zeros(3) if start is None else start
    length = float(np.linalg.norm(to - begin))
    return meshes.cylinder(radius, length).placed(begin, meshes.along(to - begin))


def _is_long(vector: Array, size: float) -> bool:
    return float(np.linalg.norm(vector)) > 1e-6 * size


def _body(part: Part) -> Iterator[Drawn]:
    centre = np.asarray(part.value("r_CM"))
    pieces = [Piece(meshes.sphere(0.035 * part.size).placed(centre), BLUE)]
    if _is_long(centre, part.size):
        pieces.append(Piece(_rod(centre, 0.012 * part.size)))
    yield Rigid(tuple(pieces), trail=_point(centre), symbol=True)


def _body_shape(part: Part) -> Iterator[Drawn]:
    r, centre = np.asarray(part.value("r")), np.asarray(part.value("r_CM"))
    pieces = [Piece(meshes.sphere(0.03 * part.size).placed(centre), BLUE)]
    if _is_long(r, part.size):
        pieces.append(Piece(_rod(r, 0.015 * part.size)))
    yield Rigid(tuple(pieces), trail=_point(r))


def _long(part: Part) -> tuple[Array, Array, float]:
    """Beginning, direction and length of a body of uniform density."""
    start, along = np.asarray(part.value("r_shape")), np.asarray(part.value("length_direction"))
    return start, along / np.linalg.norm(along), float(part.value("length"))


def _body_cylinder(part: Part) -> Iterator[Drawn]:
    start, e, length = _long(part)
    mesh = meshes.cylinder(part.value("diameter") / 2, length, part.value("inner_diameter") / 2)
    yield Rigid((Piece(mesh.placed(start, meshes.along(e)), BLUE),), trail=_point(part.value("r")))


def _body_box(part: Part) -> Iterator[Drawn]:
    start, e, length = _long(part)
    width_direction = np.asarray(getattr(part.component, "width_direction"), dtype=float)  # noqa: B009
    z = np.cross(e, width_direction)
    z /= np.linalg.norm(z)
    turned = np.stack([e, np.cross(z, e), z], axis=1)
    mesh = meshes.box((length, part.value("width"), part.value("height")))
    yield Rigid((Piece(mesh.placed(start + e * length / 2, turned), BLUE),), trail=_point(part.value("r")))


def _point_mass(part: Part) -> Iterator[Drawn]:
    yield Rigid((Piece(meshes.sphere(0.035 * part.size), BLUE),), trail=(0.0, 0.0, 0.0), symbol=True)


def _point(r: Any) -> tuple[float, float, float]:
    x, y, z = np.asarray(r, dtype=float).tolist()
    return x, y, z


def _world(part: Part) -> Iterator[Drawn]:
    axis = meshes.arrow(0.004 * part.size, 0.15 * part.size)
    colors = zip(np.eye(3), (RED, GREEN, BLUE), strict=True)
    yield Rigid(tuple(Piece(axis.placed(R=meshes.along(e)), color) for e, color in colors), frame="frame_b")


def _revolute(part: Part) -> Iterator[Drawn]:
    length = 0.08 * part.size
    e = np.asarray(getattr(part.component, "n"), dtype=float)  # noqa: B009
    R = meshes.along(e)
    mesh = meshes.cylinder(0.022 * part.size, length).placed(-R[:, 2] * length / 2, R)
    yield Rigid((Piece(mesh, ORANGE),), symbol=True)


def _prismatic(part: Part) -> Iterator[Drawn]:
    width = 0.03 * part.size
    R = meshes.along(np.asarray(getattr(part.component, "n"), dtype=float))  # noqa: B009
    yield Rigid((Piece(meshes.box((width, width, 1.6 * width)).placed(R=R), ORANGE),), symbol=True)
    yield Stretched((Piece(meshes.cylinder(0.008 * part.size, 1.0), DARK),))


def _spherical(part: Part) -> Iterator[Drawn]:
    yield Rigid((Piece(meshes.sphere(0.028 * part.size), ORANGE),), symbol=True)


def _translation(part: Part) -> Iterator[Drawn]:
    r = np.asarray(part.value("r"))
    if _is_long(r, part.size):
        yield Rigid((Piece(_rod(r, 0.012 * part.size)),))


def _fixed(part: Part) -> Iterator[Drawn]:
    width = 0.03 * part.size
    yield Rigid((Piece(meshes.box((width, width, width)), DARK),), frame="frame_b", symbol=True)


def _wheel(part: Part) -> Iterator[Drawn]:
    radius = float(part.value("radius"))
    width = 0.15 * radius
    R = meshes.along((0.0, 1.0, 0.0))
    tyre = meshes.cylinder(radius, width, 0.85 * radius).placed(-R[:, 2] * width / 2, R)
    spokes = [meshes.box((1.8 * radius, width / 2, width / 2)), meshes.box((width / 2, width / 2, 1.8 * radius))]
    yield Rigid((Piece(tyre, DARK), Piece(meshes.merged(spokes), STEEL)))


def _spring(part: Part) -> Iterator[Drawn]:
    yield Stretched((Piece(meshes.coil(0.03 * part.size), GREEN),))


def _damper(part: Part) -> Iterator[Drawn]:
    thick = meshes.cylinder(0.022 * part.size, 0.5).placed((0.0, 0.0, 0.1))
    yield Stretched((Piece(thick, DARK), Piece(meshes.cylinder(0.008 * part.size, 1.0))))


def _force_b(part: Part) -> Iterator[Drawn]:
    yield Arrow("frame_b")


def _contact(part: Part) -> Iterator[Drawn]:
    yield Arrow("frame_b")


def _workpiece(part: Part) -> Iterator[Drawn]:
    t = float(part.value("t"))
    mesh = meshes.box((part.value("width"), part.value("height"), t)).placed((0.0, 0.0, t / 2))
    yield Rigid((Piece(mesh, BLUE, 0.35),), frame="frame_b")


def _drilling(part: Part) -> Iterator[Drawn]:
    d, sigma = part.largest("d"), part.largest("sigma")
    e = np.asarray(getattr(part.component, "axis_a"), dtype=float)  # noqa: B009
    e = e / np.linalg.norm(e)
    tip = part.largest("length") * e
    if not isinstance(part.owner, ContactScene):  # which draws its bodies itself
        length = max(6 * d, part.largest("length"))
        body, flutes = (m.placed(tip, meshes.along(e)) for m in meshes.drill(d, sigma, length))
        yield Rigid((Piece(body, STEEL), Piece(flutes, ORANGE)))
    yield Hole("frame_w", d, sigma, part.largest("t"))
    yield Arrow("frame_a")


def _scene(part: Part) -> Iterator[Drawn]:
    scene = part.component
    assert isinstance(scene, ContactScene), "the table says so"
    for body in scene.bodies:
        endless = isinstance(body.shape, contact_shapes.HalfSpace)
        r, R = (np.asarray(q, dtype=float) for q in body.pose)
        color = GROUND if endless else STEEL if body.at_rest else BLUE
        opacity = 0.35 if isinstance(body, WorkpieceBody) else 1.0
        found = [Piece(m, c, opacity) for m, c in _surfaces(body.shape, part.size, color)]
        pieces = tuple(Piece(p.mesh.placed(r, R), p.color, p.opacity) for p in found)
        frame = "ground.frame_b" if body.at_rest else f"frames[{scene._place[body.name]}]"
        trail = None if body.at_rest else (0.0, 0.0, 0.0)
        yield Rigid(pieces, frame, trail, endless, name=body.name)


def _surfaces(shape: contact_shapes.Shape, size: float, color: str) -> list[tuple[Mesh, str]]:
    if isinstance(shape, contact_shapes.PointedDrill):
        # The contact shape's shank is on the side of +z.
        drawn = meshes.drill(shape.diameter, shape.point_angle, shape.length)
        return [(m.placed(R=np.diag([1.0, -1.0, -1.0])), c) for m, c in zip(drawn, (STEEL, ORANGE), strict=True)]
    return [(shape_mesh(shape, size), color)]


def shape_mesh(shape: contact_shapes.Shape, size: float) -> Mesh:
    """The mesh of a contact shape in its own axes; a half space is a plate of three times the scene."""
    match shape:
        case contact_shapes.Sphere():
            return meshes.sphere(shape.radius)
        case contact_shapes.Box():
            return meshes.box(shape.size)
        case contact_shapes.Capsule():
            return meshes.capsule(shape.radius, shape.length)
        case contact_shapes.HalfSpace():
            thick = 0.01 * size
            return meshes.box((3 * size, 3 * size, thick)).placed((0.0, 0.0, -thick / 2))
        case _ if any(ring[3] > 0.0 for ring in shape.rings):
            rings = sorted((ring[2], ring[3]) for ring in shape.rings.tolist())
            line = [(r, z) for z, r in rings]
            line = [(0.0, line[0][1])] * (line[0][0] > 0.0) + line + [(0.0, line[-1][1])] * (line[-1][0] > 0.0)
            return meshes.revolved(line)
        case _:
            return meshes.hull(shape.rings[:, :3])


LOOKS: dict[type[Component], Look] = {
    bodies.Body: _body,
    bodies.BodyShape: _body_shape,
    shapes.BodyCylinder: _body_cylinder,
    shapes.BodyBox: _body_box,
    shapes.PointMass: _point_mass,
    world.World: _world,
    joints.Revolute: _revolute,
    joints.RevolutePlanarLoopConstraint: _revolute,
    constraints.RevoluteConstraint: _revolute,
    joints.Prismatic: _prismatic,
    joints.Spherical: _spherical,
    joints.Universal: _spherical,
    joints.RollingWheel: _wheel,
    parts.Fixed: _fixed,
    parts.FixedTranslation: _translation,
    parts.FixedRotation: _translation,
    line_forces.Spring: _spring,
    line_forces.SpringDamperParallel: _spring,
    line_forces.SpringWithMass: _spring,
    line_forces.Damper: _damper,
    forces.WorldForce: _force_b,
    forces.FrameForce: _force_b,
    forces.Force: _force_b,
    SurfaceContact: _contact,
    Workpiece: _workpiece,
    PartialDrillingForce: _drilling,
    ContactScene: _scene,
}
"""Looks by class. Bodies of a `ContactScene` have their contact shapes; everything else without a look is not drawn."""
