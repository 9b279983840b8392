"""Outlines of all bodies of a scene as arrays, for their bounding boxes and displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from acausal.library.contact.collide.shapes import Capsule, Cone, Cylinder, PointedDrill, Sphere
from acausal.library.contact.scene.bodies import ContactBody

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Outlines:
    """Outlines of n bodies for the broad phase, in the axes of their frames [m].

    Attributes
    ----------
    corners
        Points whose displacements bound that of the surface, shape (n, 8, 3), or (n, 1, 3) if all bodies are balls.
        A round body that turns about its own axis does not move; its points are therefore on that axis, and `across`
        accounts for the rest.
    axis, across
        Axis of a round body and the distance of its surface from it; shapes (n, 3) and (n,).
    place, turned, middle, half
        Pose of the shape in the body's frame, and its box: (n, 3), (n, 3, 3), (n, 3), (n, 3).
    endless
        Numbers and bodies of those that are infinite.
    """

    corners: Array
    axis: Array
    across: Array
    place: Array
    turned: Array
    middle: Array
    half: Array
    endless: tuple[tuple[int, ContactBody], ...]

    @classmethod
    def of(cls, bodies: Sequence[ContactBody]) -> Outlines:
        """The outlines of some bodies."""
        n = len(bodies)
        sides = np.array([b.shape.bounding_box() for b in bodies], dtype=float).reshape(n, 2, 3)
        bounded = np.isfinite(sides).all(axis=(1, 2))
        sides[~bounded] = 0.0
        place = np.array([b.pose[0] for b in bodies], dtype=float).reshape(n, 3)
        turned = np.array([b.pose[1] for b in bodies], dtype=float).reshape(n, 3, 3)
        corners, across = np.zeros((n, 8, 3)), np.zeros(n)
        for k, (body, (low, high)) in enumerate(zip(bodies, sides, strict=True)):
            if isinstance(body.shape, Sphere):
                continue
            if isinstance(body.shape, Cylinder | Capsule | Cone | PointedDrill):
                across[k] = high[0]
                corners[k, :4, 2], corners[k, 4:, 2] = low[2], high[2]
            else:
                corners[k] = list(product(*zip(low, high, strict=True)))
        low, high = sides[:, 0], sides[:, 1]
        if not corners.any():  # all bodies are balls, which only need their centre
            corners = corners[:, :1]
        return cls(
            corners=place[:, None, :] + np.einsum("bkj,bij->bki", corners, turned),
            axis=turned[:, :, 2],
            across=across,
            place=place,
            turned=turned,
            middle=(low + high) / 2,
            half=(high - low) / 2,
            endless=tuple((k, b) for k, b in enumerate(bodies) if not bounded[k]),
        )

    def moved(self, before: tuple[Array, Array], r: Array, R: Array) -> Array:
        """Upper bound of the displacement of any point of any surface [m] at m instants, shape (m,).

        Positions of the bodies' frames have shape (n, 3) in `before` and (m, n, 3) in `r`, rotations (n, 3, 3) and
        (m, n, 3, 3).
        """
        shift, turn = r - before[0], R - before[1]
        at = shift[:, :, None, :] + np.einsum("mbij,bkj->mbki", turn, self.corners)
        far = np.sqrt((at * at).sum(axis=3).max(axis=2))
        are_round = np.flatnonzero(self.across)
        if len(are_round):
            tilt = np.linalg.norm(np.einsum("mbij,bj->mbi", turn[:, are_round], self.axis[are_round]), axis=2)
            far[:, are_round] += self.across[are_round] * tilt
        for k, _ in self.endless:
            still = (shift[:, k] == 0).all(axis=1) & (turn[:, k] == 0).all(axis=(1, 2))
            far[:, k] = np.where(still, 0.0, np.inf)
        return np.asarray(far.max(axis=1, initial=0.0))

    def boxes(self, r: Array, R: Array) -> tuple[Array, Array]:
        """Lowest and highest corners of boxes around the shapes in world axes [m], shape (n, 3) each.

        For poses at m instants, as in `moved`, they have shape (m, n, 3); all bodies must then be finite.
        """
        turned = R @ self.turned
        middle = r + np.einsum("...bij,bj->...bi", R, self.place) + np.einsum("...bij,bj->...bi", turned, self.middle)
        half = np.einsum("...bij,bj->...bi", np.abs(turned), self.half)
        low, high = middle - half, middle + half
        for k, body in self.endless:
            low[k], high[k] = body.box(r[k], R[k])
        return low, high
