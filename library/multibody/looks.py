"""Animation of mechanisms: shapes of bodies, joints and springs; gravity points downwards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from acausal import Component
from acausal.animate import meshes
from acausal.animate.looks import (
    BLUE,
    DARK,
    GREEN,
    ORANGE,
    RED,
    STEEL,
    Arrow,
    Drawn,
    Look,
    Part,
    Piece,
    Rigid,
    Stretched,
    Up,
)
from acausal.animate.meshes import Array, Mesh
from acausal.library.multibody import bodies, constraints, forces, joints, line_forces, parts, shapes, world


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
    """(Start, direction, length) of a body of uniform density [m]."""
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


def _against_gravity(part: Part) -> Up | None:
    if f"{part.path}.g_0[0]" not in part.result:
        return None
    g = np.asarray(part.value("g_0"))
    return Up(-g, True) if np.linalg.norm(g) > 0.0 else None


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
}

UP = {world.World: _against_gravity}
