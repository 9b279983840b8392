"""One point at which two shapes touch."""

from __future__ import annotations

from dataclasses import dataclass

from acausal import Expr, no_event, where


@dataclass(frozen=True, eq=False)
class Touch:
    """One point of contact: depth [m], unit normal from a to b and place [m], both in world axes.

    `share` is the part of the point's force that counts: 1, less where a corner of one box slides over an edge of the
    other.
    """

    depth: Expr
    normal: Expr
    place: Expr
    share: Expr | None = None


def sense(x: Expr) -> Expr:
    """1 or -1, never 0."""
    return where(no_event(x < 0), -1.0, 1.0)
