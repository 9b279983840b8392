"""Points of contact of two boxes: corners of faces that lie on each other, or two edges that cross."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

from acausal import Expr, as_expr, clamp, dot, fabs, maximum, minimum, no_event, where
from acausal.library.contact.manifold.edges import crossed_edges
from acausal.library.contact.manifold.point import Touch, sense


def boxes(
    r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr, size_a: tuple[float, ...], size_b: tuple[float, ...]
) -> tuple[Touch, ...]:
    """Corners of the two faces that lie on each other, pressed along the face normal with the smallest overlap.

    A corner that projects beyond the other face is moved to its edge, so that two crossed planks touch at the four
    corners of their common area. The normal belongs to the pair, not to a corner, because all corners lie on edges if
    equal boxes are stacked. A box that is tilted against a face touches it with its own corners only. If two edges
    cross and overlap less, there is one point across both.
    """
    half_a, half_b = ([s / 2 for s in size] for size in (size_a, size_b))
    normal, overlap = _face_normal(r_a, R_a, r_b, R_b, half_a, half_b)
    flat_a, flat_b = _flat(R_a.T @ normal), _flat(R_b.T @ normal)
    edge, crossing = crossed_edges(r_a, R_a, r_b, R_b, half_a, half_b, overlap)
    edge_share = crossing * (1 - flat_a * flat_b)
    edge = replace(edge, share=edge_share, overlap=minimum(edge.depth, overlap))
    margin = 0.02 * min(*half_a, *half_b)
    found = [edge]
    for r, R, half, other_r, other_R, other, direction, flat in (
        (r_a, R_a, half_a, r_b, R_b, half_b, normal, flat_b),
        (r_b, R_b, half_b, r_a, R_a, half_a, -normal, flat_a),
    ):
        along_own, along = R.T @ direction, other_R.T @ direction
        outward, first, second = _facing(R, along_own, half)
        across, _, _ = _facing(other_R, -along, other)
        for one, two in product((-1.0, 1.0), repeat=2):
            corner = r + outward + first * one + second * two
            seen = other_R.T @ (corner - other_r)
            shift = other_R @ as_expr([where(_pressed(along[k]), 0.0, _back(seen[k], other[k])) for k in range(3)])
            # Along the face of the corner, which need not be parallel to the other; then from plane to plane.
            slope = dot(outward, shift) / dot(outward, direction)
            point = corner + shift - direction * slope
            depth = dot(across, point - other_r - across) / dot(across, direction)
            place = point - direction * (depth / 2)
            share = _inside(R.T @ (place - r), along_own, half, margin) * flat * (1 - edge_share)
            # Boxes that are separated along two edges are apart, even if corners lie behind a face.
            depth = where(no_event(edge_share >= 1), minimum(depth, edge.depth), depth)
            found.append(Touch(depth, normal, place, share))
    return tuple(found)


def _flat(along: Expr) -> Expr:
    """1 where the pressed face of a box is perpendicular to a direction in its axes, 0 where it is tilted.

    The plane of a tilted face does not measure the depths of the other box's corners.
    """
    cosine = maximum(maximum(fabs(along[0]), fabs(along[1])), fabs(along[2]))
    x = clamp((cosine - _TILTED) / (_ACROSS - _TILTED), 0.0, 1.0)
    return x * x * (3 - 2 * x)


_ACROSS, _TILTED = math.cos(math.radians(3.0)), math.cos(math.radians(10.0))


def _back(x: Expr, half: float) -> Expr:
    """Displacement that moves `x` into the interval from -half to half."""
    return clamp(x, -half, half) - x


def _pressed(along: Expr) -> Expr:
    """Whether an axis of a box is the one along which its face is pressed."""
    return no_event(fabs(along) > 0.71)


def _facing(R: Expr, along: Expr, half: list[float]) -> tuple[Expr, Expr, Expr]:
    """Vector from a box's centre to the face towards a direction, and half its edges [m], all in world axes."""
    columns = [as_expr([R[i, k] for i in range(3)]) * half[k] for k in range(3)]
    x, y, z = (fabs(along[k]) for k in range(3))
    is_x, is_y = no_event((x >= y) & (x >= z)), no_event(y >= z)
    facing = where(is_x, along[0], where(is_y, along[1], along[2]))

    def pick(of_x: Expr, of_y: Expr, of_z: Expr) -> Expr:
        return as_expr([where(is_x, of_x[i], where(is_y, of_y[i], of_z[i])) for i in range(3)])

    outward = pick(*columns) * sense(facing)
    return outward, pick(columns[1], columns[2], columns[0]), pick(columns[2], columns[0], columns[1])


def _extent(direction: Expr, half: list[float]) -> Expr:
    """Half the extent of a box along a direction in its own axes [m]."""
    return sum((fabs(direction[k]) * half[k] for k in range(3)), as_expr(0.0))


def _face_normal(
    r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr, half_a: list[float], half_b: list[float]
) -> tuple[Expr, Expr]:
    """The normal of a face of either box along which they overlap least, from a to b, and that overlap [m]."""
    apart = r_b - r_a
    best: Expr | None = None
    normal: Expr | None = None
    for own, R in enumerate((R_a, R_b)):
        for k in range(3):
            axis = as_expr([R[i, k] for i in range(3)])
            across = dot(axis, apart)
            side = sense(across)
            reach = half_a[k] + _extent(R_b.T @ axis, half_b) if own == 0 else half_b[k] + _extent(R_a.T @ axis, half_a)
            overlap = reach - fabs(across)
            if best is None or normal is None:
                best, normal = overlap, axis * side
                continue
            # Ties keep the first: two faces that lie on each other have the same overlap.
            nearer = no_event(overlap < best - _TIE)
            normal = as_expr([where(nearer, axis[i] * side, normal[i]) for i in range(3)])
            best = where(nearer, overlap, best)
    assert best is not None
    assert normal is not None
    return normal, best


_TIE = 1e-9


def _inside(place: Expr, along: Expr, half: list[float], margin: float) -> Expr:
    """1 inside a box, seen along its pressed axis; falls to 0 within `margin` [m] beyond the other edges."""
    share: Expr = as_expr(1.0)
    for k in range(3):
        # The axis along the normal is left out: only the position within the face counts here.
        beyond = where(_pressed(along[k]), 0.0, clamp((fabs(place[k]) - half[k]) / margin, 0.0, 1.0))
        share = share * (1 - beyond * beyond * (3 - 2 * beyond))
    return share
