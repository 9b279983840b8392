"""Drills and workpieces as bodies of a contact scene, and the assignment of drills to holes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from acausal import Component
from acausal.errors import DeclarationError
from acausal.library.contact.collide.axis.crossing import crossing_function
from acausal.library.contact.collide.shapes import PointedDrill, Shape
from acausal.library.contact.scene.bodies import ContactBody, PoseValue, Surfaces
from acausal.library.contact.scene.surface import Pose
from acausal.library.drilling.drilling_force import DrillingForce
from acausal.library.drilling.flank import GuidedDrillingForce
from acausal.library.drilling.full_drilling_force import FullDrillingForce
from acausal.library.drilling.geometry_convex import ConvexLevel, shank_along_z
from acausal.library.drilling.holes import ALONG
from acausal.library.drilling.materials import STEEL_34CRMO4, Material
from acausal.library.drilling.tool import TWIST_DRILL_16MM, Tool
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import Vector, unit_vector

Array = NDArray[np.float64]
_OF_DRILL = ("axis_a", "k", "d_c")
_OF_WORKPIECE = ("level", "t", "width", "height")
_STATED_BY_BODIES = {
    **{name: "DrillBody(tool=Tool(...))" for name in ("tool", "d", "sigma", "z_E")},
    **{name: f"DrillBody({name}=...)" for name in _OF_DRILL},
    "length": "DrillBody(tip=...)",
    "material": "WorkpieceBody(material=...)",
    **{name: "WorkpieceBody(shape=..., pose=...)" for name in _OF_WORKPIECE},
}
"""Parameters of a drilling force that a scene takes from its bodies, and where to give each."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WorkpieceBody(ContactBody):
    """A body into which drills cut.

    Parameters
    ----------
    material
        Material of the body.
    """

    material: Material = STEEL_34CRMO4


@dataclass(frozen=True, eq=False, kw_only=True)
class DrillBody(ContactBody):
    """A drill: it cuts into every `WorkpieceBody`, and has surface contact with other bodies.

    A hole belongs to a drill and a line through a workpiece, and keeps its depth when the drill returns to it. More
    than a quarter of the diameter beside it, or in another direction, including the opposite one, a new hole starts.
    Overlapping holes, of one drill or of two, do not affect each other (AC192).

    Parameters
    ----------
    tool
        Diameter, point angle and number of edges.
    axis_a
        Direction from shank to tip, resolved in the frame of the body.
    tip
        Distance from the frame of the body to the tip along the axis [m].
    length
        Length of the part of the drill that can touch other bodies [m].
    k, d_c
        Stiffness [N/m] and damping [N.s/m] of the contact with the bottom of the hole.
    settings
        Further parameters of `FullDrillingForce` or, if `k_wall` is among them, of `GuidedDrillingForce`, as pairs of
        name and value. What the bodies of the scene state themselves is refused (AC173).
    wanders
        False for a drill that drills only one hole.
    """

    tool: Tool = TWIST_DRILL_16MM
    axis_a: Vector = (0.0, 0.0, 1.0)
    tip: float = 0.0
    length: float = 0.1
    k: float = 1e8
    d_c: float = 2e4
    settings: tuple[tuple[str, object], ...] = ()
    wanders: bool = True
    shape: Shape = field(init=False)
    pose: Pose = field(init=False)

    def __post_init__(self) -> None:
        for name, _ in self.settings:
            if name in _STATED_BY_BODIES:  # the force would drill another hole than the one that the scene sees
                raise DeclarationError(
                    "AC173",
                    f"the settings of {self.name} give {name}, which the bodies of the scene state",
                    help=f"give {_STATED_BY_BODIES[name]} instead",
                )
        e = unit_vector(self.axis_a, "axis_a")
        tip = (e[0] * self.tip, e[1] * self.tip, e[2] * self.tip)
        object.__setattr__(self, "shape", PointedDrill(self.tool.d, self.tool.sigma, self.length))
        object.__setattr__(self, "pose", (tip, shank_along_z(e)))

    @property
    def trace(self) -> str:
        return "s_tar" if self.wanders else ""

    def contact(self, other: ContactBody, surfaces: Surfaces) -> Component | None:
        if not isinstance(other, WorkpieceBody):
            return None
        kind: type[DrillingForce] = FullDrillingForce if self.settings else DrillingForce
        if any(name == "k_wall" for name, _ in self.settings):
            kind = GuidedDrillingForce
        return kind(
            level=ConvexLevel(other.shape, other.pose, other.name),
            tool=self.tool,
            material=other.material,
            axis_a=self.axis_a,
            length=self.tip,
            k=self.k,
            d_c=self.d_c,
            **dict(self.settings),  # type: ignore[arg-type]
        )

    def ends(self, made: Component) -> tuple[Frame, Frame]:
        if isinstance(made, DrillingForce):
            return made.frame_a, made.frame_w
        return super().ends(made)

    def accounts(self, made: Component) -> tuple[Component, ...]:
        return (made, made.flank) if isinstance(made, GuidedDrillingForce) else (made,)

    def describe(self, other: ContactBody) -> str:
        return "drilling" if isinstance(other, WorkpieceBody) else super().describe(other)

    def site(
        self, other: ContactBody, own: PoseValue, others: PoseValue, known: Sequence[Array], current: int, marked: bool
    ) -> tuple[list[Array], int]:
        """Holes in the axes of the workpiece, as point of entry [m] and direction; number of the current one."""
        if not isinstance(other, WorkpieceBody):
            return super().site(other, own, others, known, current, marked)
        r, R = others[0] + others[1] @ np.array(other.pose[0]), others[1] @ np.array(other.pose[1])
        axis = R.T @ own[1] @ np.array(unit_vector(self.axis_a))
        tip = R.T @ (own[0] + own[1] @ np.array(self.pose[0]) - r)
        depth, _, beside = _crossed(other, tip, axis)
        here = np.stack([tip - depth * axis, axis])
        holes = list(known)
        if holes and depth > 0 and not beside:
            holes[current] = here  # an engaged drill cannot leave its hole sideways
            return holes, current
        off = [np.linalg.norm(np.cross(h[0] - tip, axis)) + self.tool.d * (h[1] @ axis < ALONG) for h in holes]
        if off and min(off) < self.tool.d / 4:
            return holes, int(np.argmin(off))
        if holes and not marked:
            holes[current] = here  # nothing has been cut at the old position, so it is not a hole
            return holes, current
        return [*holes, here], len(holes)


def _crossed(workpiece: ContactBody, point: Array, axis: Array) -> tuple[float, float, bool]:
    """Depths [m] of a point behind entry and exit of a line, and whether the line misses the workpiece."""
    depth, beyond, beside, _ = crossing_function(workpiece.shape)(point, axis)
    return float(depth), float(beyond), bool(beside > 0.5)
