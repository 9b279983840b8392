"""Animation of drilling: shapes of workpiece, drill, force and hole; the feed points downwards."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from acausal import Component
from acausal.animate import meshes
from acausal.animate.looks import BLUE, ORANGE, STEEL, Arrow, Drawn, Hole, Look, Part, Piece, Rigid, Up
from acausal.library.contact.scene.scene import ContactScene
from acausal.library.drilling.interfaces import PartialDrillingForce
from acausal.library.drilling.workpiece import Workpiece


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


def _against_the_feed(part: Part) -> Up | None:
    if f"{part.path}.frame_a.R[0,0]" not in part.result:
        return None
    axis = np.asarray(getattr(part.component, "axis_a"), dtype=float)  # noqa: B009
    return Up(-(part.result[f"{part.path}.frame_a.R"][0] @ axis), False)


LOOKS: dict[type[Component], Look] = {Workpiece: _workpiece, PartialDrillingForce: _drilling}

UP = {PartialDrillingForce: _against_the_feed}
