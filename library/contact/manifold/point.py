"""One point at which two shapes touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from acausal import Expr, as_expr, maximum, minimum, no_event, quantity, where


@dataclass(frozen=True, eq=False)
class Touch:
    """One point of contact: depth [m], unit normal from a to b and position [m], both in world axes.

    `share` is a factor of the point's force: 1, or less where a corner of one box slides over an edge of the other.
    Where it is 0, the depth is meaningless. `overlap` [m] is the least overlap of the two shapes, negative where they
    are apart; only the first point of those with a `share` has it.
    """

    depth: Expr
    normal: Expr
    place: Expr
    share: Expr | None = None
    overlap: Expr | None = None


def sense(x: Expr) -> Expr:
    """1 or -1, never 0."""
    return where(no_event(x < 0), -1.0, 1.0)


def deepest(points: Sequence[Touch]) -> Expr:
    """Depth [m] of the deepest point that counts; if none does, minus the distance of the shapes."""
    overlap = points[0].overlap
    if overlap is None:
        return _largest([p.depth for p in points])
    never = quantity(_NEVER, "m")
    counted = _largest([p.depth if p.share is None else where(_counts(p.share), p.depth, never) for p in points])
    some = no_event(_largest([as_expr(1.0) if p.share is None else p.share for p in points]) > 0)
    return where(some, counted, minimum(overlap, quantity(0.0, "m")))


_NEVER = -1e9


def _counts(share: Expr) -> Expr:
    return no_event(share > 0)


def _largest(terms: Sequence[Expr]) -> Expr:
    largest = terms[0]
    for term in terms[1:]:
        largest = maximum(largest, term)
    return largest
