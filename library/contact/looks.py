"""How contact scenes are drawn: bodies by their contact shapes, contacts by an arrow for their force."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from acausal import Component
from acausal.animate import meshes
from acausal.animate.looks import BLUE, GROUND, ORANGE, STEEL, Arrow, Drawn, Look, Part, Piece, Rigid
from acausal.animate.meshes import Mesh
from acausal.library.contact.collide import shapes as contact_shapes
from acausal.library.contact.scene.scene import ContactScene
from acausal.library.contact.scene.surface import SurfaceContact
from acausal.library.drilling.scene import WorkpieceBody


def _contact(part: Part) -> Iterator[Drawn]:
    yield Arrow("frame_b")


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
        # The shank of the contact shape points towards +z.
        drawn = meshes.drill(shape.diameter, shape.point_angle, shape.length)
        return [(m.placed(R=np.diag([1.0, -1.0, -1.0])), c) for m, c in zip(drawn, (STEEL, ORANGE), strict=True)]
    return [(shape_mesh(shape, size), color)]


def shape_mesh(shape: contact_shapes.Shape, size: float) -> Mesh:
    """The mesh of a contact shape in its own axes; a half-space is a plate three times as large as the scene."""
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


LOOKS: dict[type[Component], Look] = {SurfaceContact: _contact, ContactScene: _scene}
