"""Holes that drills leave in one workpiece, and checks for overlaps."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.library.multibody.orientation import across

Array = NDArray[np.float64]
_ROUNDING = 1e-9
"""Distance [m] by which an entry may lie in front of a face."""
ALONG = math.cos(0.1)
"""Cosine of the angle between two axes beyond which they belong to different holes."""


@dataclass(frozen=True, eq=False)
class Hole:
    """A hole with a conical bottom, in the axes of the workpiece; lengths in m."""

    drill: str
    d: float
    sigma: float
    entry: Array
    axis: Array
    depth: float
    inside: float
    """The part of the depth inside the workpiece, beyond which a drill may continue."""

    def overlaps(self, other: Hole) -> bool:
        """Whether the two holes overlap, judged by sample points on their walls and axes."""
        between = float(np.linalg.norm(self._middle - other._middle))
        if between > self._reach + other._reach:
            return False
        return other._holds(self._points()) or self._holds(other._points())

    def apart(self, other: Hole) -> float:
        """Distance [m] of the other's entry from the axis."""
        return float(np.linalg.norm(np.cross(other.entry - self.entry, self.axis)))

    @property
    def _middle(self) -> Array:
        return np.asarray(self.entry + self.axis * (self.inside / 2))

    @property
    def _reach(self) -> float:
        """Radius [m] of a ball around the middle that contains the hole."""
        return (self.inside + self.d) / 2

    def _radius(self, along: Array) -> Array:
        """Radius [m] at distances from the entry; shape (n,)."""
        cone = (self.depth - along) * math.tan(self.sigma / 2)
        return np.asarray(np.clip(cone, 0.0, self.d / 2))

    def _points(self) -> Array:
        """Points of wall and axis; shape (3, n)."""
        along, angles = np.linspace(0.0, self.inside, 65), np.linspace(0.0, 2 * math.pi, 64, endpoint=False)
        one, two = (np.array(v) for v in across((float(self.axis[0]), float(self.axis[1]), float(self.axis[2]))))
        ring = np.outer(one, np.cos(angles)) + np.outer(two, np.sin(angles))
        axis = self.entry[:, None] + np.outer(self.axis, along)
        wall = axis[:, :, None] + ring[:, None, :] * self._radius(along)[:, None]
        return np.hstack([axis, wall.reshape(3, -1)])

    def _holds(self, points: Array) -> bool:
        from_entry = points - self.entry[:, None]
        along = self.axis @ from_entry
        off = np.linalg.norm(from_entry - np.outer(self.axis, along), axis=0)
        return bool(((along >= -_ROUNDING) & (along <= self.inside) & (off < self._radius(along))).any())


def named(one: Hole, other: Hole) -> str:
    """Description of two holes in messages."""
    a, b = (re.sub(r"#\d+\]$", "]", hole.drill) for hole in (one, other))  # the later holes of a pair in a scene
    return f"two holes of {a}" if a == b else f"holes of {a} and {b}"
