"""Tables: interpolation of points by steps, straight segments or splines.

Names as in Modelica.Blocks.Tables and Modelica.Blocks.Types.Smoothness. Kinks and steps are located as events; curves
with a continuous derivative need none.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Sequence
from enum import Enum
from itertools import pairwise
from math import isfinite

from acausal import Equations, Expr, as_expr, clamp, floor, lookup, structural, unitless, where
from acausal.errors import DeclarationError
from acausal.library.blocks.interfaces import PartialSISO
from acausal.library.blocks.kinks import few

Points = tuple[tuple[float, float], ...]
"""Abscissa and ordinate of each point, abscissas strictly increasing."""


MANY = 64
"""Number of points above which segments are found by a search instead of relations, and kinks need not be events."""


class Smoothness(Enum):
    """Interpolation between two points of a table."""

    CONSTANT_SEGMENTS = "the value of the left point"
    LINEAR_SEGMENTS = "a straight line"
    CONTINUOUS_DERIVATIVE = "a cubic of Akima's spline: smooth, with few overshoots"
    MONOTONE_CONTINUOUS_DERIVATIVE = "a cubic of the Fritsch-Butland spline: smooth, without overshoots"


class Extrapolation(Enum):
    """Extrapolation beyond the first and the last point."""

    HOLD_LAST_POINT = "its value"
    LAST_TWO_POINTS = "the line through it with the slope it has there"


def table(
    points: Sequence[Sequence[float]],
    u: Expr,
    smoothness: Smoothness = Smoothness.LINEAR_SEGMENTS,
    extrapolation: Extrapolation = Extrapolation.LAST_TWO_POINTS,
    *,
    located: bool = True,
) -> Expr:
    """The function through `points`, pairs in SI units, at `u`.

    Kinks are events unless `located` is False: then the solver integrates across them under its error control, which is
    cheaper if a trajectory crosses many. With more than `MANY` kinks, none is an event; runs stop without an event at
    those that their solver cannot pass within the tolerance. Steps are always events.

    A single point is a constant. The segment is found by bisection: with few points by relations in the equations, with
    many by a search in one call (`acausal.lookup`).

    Raises
    ------
    DeclarationError
        AC160 if there is no point, a number is not finite, or the abscissas do not increase.
    """
    known = checked_points(points)
    if len(known) == 1:
        return as_expr(known[0][1])
    u = unitless(u)
    steps = smoothness is Smoothness.CONSTANT_SEGMENTS
    slopes = _SLOPES[smoothness](known)
    if len(known) > MANY:
        return _by_search(known, slopes, u, smoothness, extrapolation, located)
    pieces: list[tuple[float, Expr]] = []
    for (x0, y0), (x1, y1), (left, right) in zip(known[:-1], known[1:], slopes, strict=True):
        pieces.append((x0, as_expr(y0) if steps else _cubic(u, x0, y0, x1, y1, left, right)))
    (x0, y0), (xn, yn) = known[0], known[-1]
    hold = extrapolation is Extrapolation.HOLD_LAST_POINT or steps
    straight = not hold and smoothness is Smoothness.LINEAR_SEGMENTS
    if not straight:  # the outer segments of a polyline already extrapolate
        first, last = (0.0, 0.0) if hold else (slopes[0][0], slopes[-1][1])
        pieces = [(-float("inf"), y0 + first * (u - x0)), *pieces, (xn, yn + last * (u - xn))]
    kinked = smoothness is Smoothness.LINEAR_SEGMENTS or hold
    smooth = not steps and not (kinked and located)
    return _choice(u, pieces, smooth)


def _by_search(
    points: Points,
    slopes: Sequence[tuple[float, float]],
    u: Expr,
    smoothness: Smoothness,
    extrapolation: Extrapolation,
    located: bool,
) -> Expr:
    """The function of `table` with a search for the segment."""
    x, y = zip(*points, strict=True)
    if smoothness is Smoothness.CONSTANT_SEGMENTS:
        # The segment number is the floor of a piecewise linear function, so two relations suffice to locate all steps.
        places = lookup(x, [(float(k), 1.0 / (b - a)) for k, (a, b) in enumerate(pairwise(x))], "segment")
        number = floor(clamp(places(u), 0.0, len(y) - 0.5))
        return as_expr(lookup([*range(len(y)), len(y)], [(v,) for v in y], "step")(number + 0.5))
    rows: list[tuple[float, ...]] = [
        (a[1], *_polynomial(b[0] - a[0], b[1] - a[1], *slope))
        for (a, b), slope in zip(pairwise(points), slopes, strict=True)
    ]
    if smoothness is Smoothness.LINEAR_SEGMENTS:
        rows = [row[:2] for row in rows]
        if extrapolation is Extrapolation.LAST_TWO_POINTS:
            return _split_at_kinks(x, rows, u, located)
    hold = extrapolation is Extrapolation.HOLD_LAST_POINT
    first, last = (0.0, 0.0) if hold else (slopes[0][0], slopes[-1][1])
    ends = [(y[0] - first * (x[1] - x[0]), first), (y[-1], last)]  # an extra segment on each side
    outer = [(*end, *[0.0] * (len(rows[0]) - 2)) for end in ends]
    # The outer segments are as long as the table.
    far = x[-1] - x[0]
    outer[0] = (y[0] - first * far, *outer[0][1:])
    return _split_at_kinks((x[0] - far, *x, x[-1] + far), [outer[0], *rows, outer[1]], u, located)


def _split_at_kinks(ends: Sequence[float], rows: Sequence[tuple[float, ...]], u: Expr, located: bool) -> Expr:
    """Piecewise polynomial by a search, split by relations at its kinks if they are few."""
    lengths = [b - a for a, b in pairwise(ends)]
    slopes = [
        [row[1] if len(row) == 2 else row[1] + h * (2.0 * row[2] + h * 3.0 * row[3]) for h in (0.0, length)]
        for row, length in zip(rows, lengths, strict=True)
    ]
    height = max(r[0] for r in rows) - min(r[0] for r in rows)
    cuts = few(lengths, [b[0] - a[1] for a, b in pairwise(slopes)], height) if located else []
    pieces: list[tuple[float, Expr]] = []
    for first, last in pairwise([0, *cuts, len(rows)]):
        # Alternating names, because a cut between two calls of the same function would be removed.
        name = "table_" if len(pieces) % 2 else "table"
        pieces.append((ends[first], as_expr(lookup(ends[first : last + 1], rows[first:last], name)(u))))
    return _choice(u, pieces, smooth=False)


def checked_points(points: Sequence[Sequence[float]]) -> Points:
    """Validated points of a table; AC160 as in `table`."""
    known: list[tuple[float, float]] = []
    for k, row in enumerate(points):
        wrong = wrong_row(row)
        if wrong is None and known and row[0] <= known[-1][0]:
            wrong = f"does not lie beyond the one before, {known[-1]}"
        if wrong is not None:
            raise _no_table(f"row {k + 1} of {len(points)}, {reprlib.repr(row)}, {wrong}")
        known.append((float(row[0]), float(row[1])))
    if not known:
        raise _no_table("there is no row")
    return tuple(known)


def wrong_row(row: Sequence[float]) -> str | None:
    """Description of the error in one row of a table; None for a pair of finite numbers."""
    try:
        x, y = row
        is_finite = isfinite(x) and isfinite(y)
    except (TypeError, ValueError):
        return "is not a pair of numbers"
    return None if is_finite else "holds a number that is not finite"


def _no_table(why: str) -> DeclarationError:
    return DeclarationError(
        "AC160",
        f"this is no table: {why}",
        help="give at least one point (x, y), with x strictly increasing: ((0.0, 1.0), (2.0, 5.0))",
    )


def _choice(u: Expr, pieces: Sequence[tuple[float, Expr]], smooth: bool) -> Expr:
    if len(pieces) == 1:
        return pieces[0][1]
    middle = len(pieces) // 2
    left, right = (_choice(u, part, smooth) for part in (pieces[:middle], pieces[middle:]))
    return where(u < pieces[middle][0], left, right, smooth=smooth)


def _cubic(u: Expr, x0: float, y0: float, x1: float, y1: float, left: float, right: float) -> Expr:
    """Hermite's cubic on one segment, as a polynomial in u - x0."""
    slope, c2, c3 = _polynomial(x1 - x0, y1 - y0, left, right)
    s = u - x0
    if c2 == c3 == 0.0:
        return y0 + slope * s if slope else as_expr(y0)
    return y0 + s * (slope + s * (c2 + c3 * s))


def _polynomial(h: float, rise: float, left: float, right: float) -> tuple[float, float, float]:
    """Coefficients of Hermite's cubic over a segment of length `h`, in powers 1 to 3 of the distance from its start."""
    chord = rise / h
    c2 = (3.0 * chord - 2.0 * left - right) / h
    c3 = (left + right - 2.0 * chord) / h**2
    straight = abs(c2) * h + abs(c3) * h**2 <= 1e-12 * (abs(left) + abs(right))
    return (left, 0.0, 0.0) if straight else (left, c2, c3)


def _no_slopes(points: Points) -> list[tuple[float, float]]:
    return [(0.0, 0.0)] * (len(points) - 1)


def _chords(points: Points) -> list[float]:
    return [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairwise(points)]


def _straight(points: Points) -> list[tuple[float, float]]:
    return [(d, d) for d in _chords(points)]


def _akima(points: Points) -> list[tuple[float, float]]:
    """H. Akima, A new method of interpolation and smooth curve fitting, J. ACM 17 (1970), equations 1 and 8."""
    d = _chords(points)
    d = [3 * d[0] - 2 * d[min(1, len(d) - 1)], 2 * d[0] - d[min(1, len(d) - 1)], *d]
    d += [2 * d[-1] - d[-2], 3 * d[-1] - 2 * d[-2]]
    slopes = []
    for a, b, c, e in zip(d, d[1:], d[2:], d[3:], strict=False):
        left, right = abs(e - c), abs(b - a)
        slopes.append((left * b + right * c) / (left + right) if left + right > 0.0 else 0.5 * (b + c))
    return list(pairwise(slopes))


def _fritsch_butland(points: Points) -> list[tuple[float, float]]:
    """F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984), equation 5; chords at the ends."""
    d = _chords(points)
    slopes = [d[0]]
    for (x0, _), (x1, _), (x2, _), a, b in zip(points, points[1:], points[2:], d, d[1:], strict=False):
        share = (1.0 + (x2 - x1) / (x2 - x0)) / 3.0
        slopes.append(a * b / (share * b + (1.0 - share) * a) if a * b > 0.0 else 0.0)
    return list(pairwise([*slopes, d[-1]]))


_SLOPES: dict[Smoothness, Callable[[Points], list[tuple[float, float]]]] = {
    Smoothness.CONSTANT_SEGMENTS: _no_slopes,
    Smoothness.LINEAR_SEGMENTS: _straight,
    Smoothness.CONTINUOUS_DERIVATIVE: _akima,
    Smoothness.MONOTONE_CONTINUOUS_DERIVATIVE: _fritsch_butland,
}


class CombiTable1D(PartialSISO):
    """Table of one variable: `y` is the function through the points of `table` at `u` (MSL: CombiTable1Ds)."""

    table: Points = structural(doc="Points (u, y), u strictly increasing")
    smoothness: Smoothness = structural(default=Smoothness.LINEAR_SEGMENTS, doc="Interpolation between two points")
    extrapolation: Extrapolation = structural(
        default=Extrapolation.LAST_TWO_POINTS, doc="Extrapolation beyond the ends"
    )

    def equations(self) -> Equations:
        yield self.y == table(self.table, self.u, self.smoothness, self.extrapolation)
