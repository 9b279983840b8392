"""Broad phase: finds the pairs whose inflated bounding boxes overlap, vectorised over all bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.library.contact.scene.bodies import ContactBody

Array = NDArray[np.float64]
Pair = tuple[int, int]
Ends = tuple[NDArray[np.int_], NDArray[np.int_]]


@dataclass(frozen=True)
class Dropped:
    """Number of pairs that are left out of the equations for one reason."""

    reason: str
    count: int


@dataclass(frozen=True, repr=False)
class PairReport:
    """Pairs of bodies kept and dropped, with the reasons.

    Attributes
    ----------
    kept
        For each pair in the equations, the names of the bodies and how their contact is found.
    dropped
        The other pairs, counted by reason.
    """

    bodies: int
    kept: tuple[tuple[str, str, str], ...]
    dropped: tuple[Dropped, ...]

    def __repr__(self) -> str:
        total = self.bodies * (self.bodies - 1) // 2
        lines = [f"{self.bodies} bodies, {total} pairs: {len(self.kept)} in the equations"]
        lines += [f"  {a} - {b}   {how}" for a, b, how in self.kept[:20]]
        if len(self.kept) > 20:
            lines.append(f"  and {len(self.kept) - 20} more")
        lines += [f"  {d.count} dropped: {d.reason}" for d in self.dropped]
        return "\n".join(lines)


AT_REST = "both at rest"
ONE_GROUP = "in one group"
OUT_OF_REACH = "never within reach of each other"
FAR = "too far apart now"
CANNOT_MEET = "can never meet: bounds of their poses keep them apart"


def candidates(bodies: Sequence[ContactBody]) -> tuple[Ends, dict[str, int]]:
    """Pairs that the declarations of the bodies allow to touch, and the numbers of all others by reason.

    Pairs are given as the numbers of their first and of their second bodies, shape (n,) each.
    """
    n = len(bodies)
    first, second = np.triu_indices(n, 1)
    rest = np.array([b.at_rest for b in bodies], dtype=bool)
    groups = {name: k for k, name in enumerate(dict.fromkeys(b.group for b in bodies))}
    group = np.array([groups[b.group] if b.group is not None else -1 - k for k, b in enumerate(bodies)], dtype=int)
    low, high = np.array([_swept(b) for b in bodies]).reshape(n, 2, 3).swapaxes(0, 1)
    left = np.ones(len(first), dtype=bool)
    counts = {}
    for reason, out in (
        (AT_REST, rest[first] & rest[second]),
        (ONE_GROUP, group[first] == group[second]),
        (OUT_OF_REACH, ~overlapping(low, high, first, second)),
    ):
        counts[reason] = int(np.sum(left & out))
        left &= ~out
    return (first[left], second[left]), counts


def overlapping(low: Array, high: Array, first: NDArray[np.int_], second: NDArray[np.int_]) -> NDArray[np.bool_]:
    """Whether the boxes of pairs overlap; boxes are given by their corners [m], shape (n, 3)."""
    return np.asarray(gaps(low, high, first, second) <= 0.0)


def gaps(low: Array, high: Array, first: NDArray[np.int_], second: NDArray[np.int_]) -> Array:
    """Inflation [m] at which the boxes of each pair begin to overlap, half of it for each box; shape (n,)."""
    found = np.full(len(first), -np.inf)
    for lowest, highest in zip(low.T.copy(), high.T.copy(), strict=True):  # gathering rows of three is slow
        np.maximum(found, lowest[first] - highest[second], out=found)
        np.maximum(found, lowest[second] - highest[first], out=found)
    return found


def _swept(body: ContactBody) -> tuple[Array, Array]:
    """Box [m] around all positions of the body."""
    if body.at_rest:
        return body.box(np.zeros(3), np.eye(3))
    if body.reach is None:
        return np.full(3, -np.inf), np.full(3, np.inf)
    radius = body.radius()
    return np.array(body.reach[0]) - radius, np.array(body.reach[1]) + radius
