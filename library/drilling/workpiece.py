"""The workpiece: a plate with an entry face."""

from __future__ import annotations

from acausal import Real, parameter
from acausal.library.multibody.parts import FixedRotation


class Workpiece(FixedRotation):
    """Massless plate, fixed to whatever `frame_a` is connected to: the world, a table, a moving body.

    `frame_b` is the entry face: its origin is the centre of the face, at `r` in frame_a; its z axis points into the
    plate, rotated by `R_rel` relative to frame_a; `width` and `height` extend along its x and y axes. For a plate with
    mass, connect a body to frame_a.
    """

    t: Real = parameter(unit="m", min=1e-6, doc="Thickness, from the entry face along z of frame_b")
    width: Real = parameter(default=0.1, unit="m", min=0.0, doc="Extent along x of frame_b")
    height: Real = parameter(default=0.1, unit="m", min=0.0, doc="Extent along y of frame_b")
