"""Crossing of an edge of one box with an edge of another: the contact that no face normal describes.

Source of the nine overlaps: S. Gottschalk, M. C. Lin, D. Manocha, OBBTree, SIGGRAPH 1996, table of the separating axes.
"""

from __future__ import annotations

from itertools import product

from acausal import Expr, as_expr, clamp, dot, fabs, maximum, no_event, sqrt, where
from acausal.library.contact.manifold.point import Touch, sense

_PARALLEL = 1e-4
"""Square of the sine of the angle below which two edges count as parallel: a face lies on them."""

_BLEND = 0.1
"""Relative difference between the overlaps of faces and of edges from which the crossing of edges alone counts."""

_NEVER = 1e3
_TINY = 1e-9


def crossed_edges(
    r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr, half_a: list[float], half_b: list[float], faces: Expr
) -> tuple[Touch, Expr]:
    """The point where two edges of boxes cross, and its weight in the contact.

    `faces` is the least overlap along the normals of faces [m]. Where edges overlap as much, the weight is 0; it grows
    smoothly as they overlap less, so that forces are continuous.
    """
    C, t = R_a.T @ R_b, R_a.T @ (r_b - r_a)
    best, axis, own, others = _least(C, t, half_a, half_b)
    # In the axes of a: the two edges, each outermost towards the other box, and their nearest points.
    ahead, back = [sense(axis[k]) for k in range(3)], [sense(x) for x in _scalars(C.T @ axis)]
    on_a = as_expr([(1 - own[k]) * ahead[k] * half_a[k] for k in range(3)])
    on_b = t - C @ as_expr([(1 - others[k]) * back[k] * half_b[k] for k in range(3)])
    u, v = own, C @ others
    between, cosine = on_b - on_a, dot(u, v)
    way = (dot(between, u) - cosine * dot(between, v)) / maximum(1 - cosine * cosine, _PARALLEL)
    point = on_a + u * way - axis * (best / 2)
    gain = clamp((faces - best) / maximum(_BLEND * faces, _TINY), 0.0, 1.0)
    share = gain * gain * (3 - 2 * gain)
    return Touch(best, R_a @ axis, r_a + R_a @ point, share), share


def _least(C: Expr, t: Expr, half_a: list[float], half_b: list[float]) -> tuple[Expr, Expr, Expr, Expr]:
    """The least overlap [m] across an edge of each box, its direction from a to b, and the axes of the two edges.

    The axes are unit vectors that select an axis of a and one of b; the direction is in the axes of a.
    """
    best: Expr = as_expr(_NEVER)
    axis, own, others = as_expr((1.0, 0.0, 0.0)), as_expr((0.0, 1.0, 0.0)), as_expr((0.0, 1.0, 0.0))
    for i, j in product(range(3), repeat=2):
        i1, i2, j1, j2 = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        square = C[i1, j] * C[i1, j] + C[i2, j] * C[i2, j]
        length = sqrt(maximum(square, _PARALLEL))
        reach_a = half_a[i1] * fabs(C[i2, j]) + half_a[i2] * fabs(C[i1, j])
        reach_b = half_b[j1] * fabs(C[i, j2]) + half_b[j2] * fabs(C[i, j1])
        apart = t[i2] * C[i1, j] - t[i1] * C[i2, j]
        overlap = where(no_event(square > _PARALLEL), (reach_a + reach_b - fabs(apart)) / length, _NEVER)
        less = no_event(overlap < best)
        towards = sense(apart) / length
        found: dict[int, Expr | float] = {i: 0.0, i1: -C[i2, j] * towards, i2: C[i1, j] * towards}
        axis = as_expr([where(less, found[k], axis[k]) for k in range(3)])
        own = as_expr([where(less, float(k == i), own[k]) for k in range(3)])
        others = as_expr([where(less, float(k == j), others[k]) for k in range(3)])
        best = where(less, overlap, best)
    return best, axis, own, others


def _scalars(vector: Expr) -> list[Expr]:
    return [vector[k] for k in range(3)]
