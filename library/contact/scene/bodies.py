"""Bodies of a contact scene: their shapes, where they can be, and the contacts that they make with others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from acausal import Component
from acausal.errors import DeclarationError
from acausal.library.contact.collide.shapes import Shape
from acausal.library.contact.manifold.touch import method
from acausal.library.contact.scene.friction import Coulomb, FrictionLaw
from acausal.library.contact.scene.laws import NormalLaw
from acausal.library.contact.scene.surface import AT_FRAME, Pose, SurfaceContact
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import Vector

Corners = tuple[Vector, Vector]
Array = NDArray[np.float64]
PoseValue = tuple[Array, Array]
"""Position [m], shape (3,), and rotation, shape (3, 3), of a body's frame at one instant."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactBody:
    """A body that can touch others, as it is registered with a scene.

    Parameters
    ----------
    name
        Name in reports and error messages.
    shape
        Shape of its surface.
    pose
        Position [m] and rotation of the shape in the body's frame; in world axes for a body at rest.
    at_rest
        True for a body that never moves: it has no frame, and contacts between two such bodies are ignored.
    reach
        Lowest and highest corner [m] of a box in world axes that the origin of the body's frame never leaves; None
        if unknown. A pair of bodies whose reaches keep them apart is dropped before the model is compiled.
    group
        Contacts within one group are ignored, e.g. between neighbours in a mechanism.
    """

    name: str
    shape: Shape
    pose: Pose = AT_FRAME
    at_rest: bool = False
    reach: Corners | None = None
    group: str | None = None

    def contact(self, other: ContactBody, surfaces: Surfaces) -> Component | None:
        """Component of the contact with another body; None leaves the decision to the other, then to the scene."""
        return None

    def ends(self, made: Component) -> tuple[Frame, Frame]:
        """Frames of a component made by `contact`: of this body, and of the other."""
        frames: tuple[Frame, Frame] = (getattr(made, "frame_a"), getattr(made, "frame_b"))  # noqa: B009
        return frames

    def accounts(self, made: Component) -> tuple[Component, ...]:
        """Components whose energies and powers add up to those of a contact."""
        return (made,)

    def describe(self, other: ContactBody) -> str:
        """Name of the method that finds the contact of a pair, for the report."""
        return method(self.shape, other.shape)

    @property
    def trace(self) -> str:
        """Signal of a contact that is positive once this body has left a trace at the site; "" without traces."""
        return ""

    def site(
        self, other: ContactBody, own: PoseValue, others: PoseValue, known: Sequence[Array], current: int, marked: bool
    ) -> tuple[list[Array], int]:
        """Sites of the contacts with another body, and the number of the present one.

        `known` holds the sites so far, in the axes of the other's shape, each a point [m] and a direction, shape
        (2, 3); `current` is the number of the site at the last choice, `marked` whether that one has a trace.
        """
        return list(known), 0

    def radius(self) -> float:
        """Largest distance of a point of the shape from the origin of the body's frame [m]."""
        lowest, highest = (np.array(c, dtype=float) for c in self.shape.bounding_box())
        furthest = np.maximum(np.abs(lowest), np.abs(highest))
        return float(np.linalg.norm(furthest)) + math.hypot(*self.pose[0])

    def box(self, r: Array, R: Array) -> tuple[Array, Array]:
        """Lowest and highest corner of a box around the shape [m], in world axes, for a pose of the body's frame."""
        lowest, highest = (np.array(c, dtype=float) for c in self.shape.bounding_box())
        turned = R @ np.array(self.pose[1], dtype=float)
        if not np.isfinite(lowest).all() or not np.isfinite(highest).all():
            return _unbounded(r + R @ np.array(self.pose[0]), turned)
        middle = r + R @ np.array(self.pose[0]) + turned @ ((lowest + highest) / 2)
        half = np.abs(turned) @ ((highest - lowest) / 2)
        return middle - half, middle + half


def _unbounded(origin: Array, R: Array) -> tuple[Array, Array]:
    """Box around a half-space z <= 0: bounded on one side when its face is along the world's axes."""
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    up = R[:, 2]
    k = int(np.argmax(np.abs(up)))
    if abs(up[k]) > 1 - 1e-12:
        (high if up[k] > 0 else low)[k] = origin[k]
    return low, high


@dataclass(frozen=True, eq=False, kw_only=True)
class Surfaces:
    """The laws between the surfaces of a scene: a common one, and others for named pairs.

    `pairs` holds rows of two names, in any order, a normal law and a friction law.
    """

    law: NormalLaw | None = None
    friction: FrictionLaw = field(default_factory=lambda: Coulomb(mu=0.0))
    pairs: tuple[tuple[str, str, NormalLaw, FrictionLaw], ...] = ()

    def between(self, a: ContactBody, b: ContactBody) -> tuple[NormalLaw, FrictionLaw]:
        """Laws between two bodies; DeclarationError AC171 when none is given."""
        for one, two, law, friction in self.pairs:
            if {one, two} == {a.name, b.name}:
                return law, friction
        if self.law is None:
            raise DeclarationError(
                "AC171",
                f"{a.name} and {b.name} can touch, but the scene has no contact law for them",
                help="ContactScene(surfaces=Surfaces(law=HuntCrossley(...), friction=Coulomb(...)), ...)",
            )
        return self.law, self.friction

    def contact(self, a: ContactBody, b: ContactBody) -> SurfaceContact:
        """Surface contact of two bodies."""
        law, friction = self.between(a, b)
        return SurfaceContact(
            shape_a=a.shape, shape_b=b.shape, pose_a=a.pose, pose_b=b.pose, law=law, friction=friction
        )
