"""Functions of time that signal, voltage and current sources share.

Every switch is a condition on `time` alone: a time event, located exactly. The interval between two events is selected
by a balanced tree of `where`; within it, a table is searched by bisection.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Sequence
from itertools import pairwise

from acausal import Expr, lookup, quantity, sin, time, unitless, where
from acausal.errors import DeclarationError
from acausal.library.blocks.kinks import few
from acausal.library.blocks.tables import wrong_row

Points = tuple[tuple[float, float], ...]
"""Rows (time [s], value) with ascending times; two rows with the same time form a jump."""


def step(height: Expr, offset: Expr, start_time: Expr) -> Expr:
    """`offset`, and `offset + height` from `start_time` [s] on."""
    return offset + where(time < start_time, 0.0, height)


def ramp(height: Expr, duration: Expr, offset: Expr, start_time: Expr) -> Expr:
    """`offset`, then a straight line that rises by `height` within `duration` [s] from `start_time` [s] on."""
    rising = (time - start_time) * height / duration
    return offset + where(time < start_time, 0.0, where(time < start_time + duration, rising, height))


def sine(amplitude: Expr, f: Expr, phase: Expr, offset: Expr, start_time: Expr) -> Expr:
    """Sine of frequency `f` [Hz] and `phase` [rad] from `start_time` [s] on; `offset` before."""
    wave = amplitude * sin(2.0 * math.pi * f * (time - start_time) + phase)
    return offset + where(time < start_time, 0.0, wave)


def pulse(amplitude: Expr, width: Expr, period: Expr, nperiod: int, offset: Expr, start_time: Expr) -> Expr:
    """`nperiod` rectangles, each `width` (0..1) of `period` [s] long; `offset` between and after them."""
    levels: list[Expr | float] = [0.0]
    breaks: list[Expr] = []
    for k in range(nperiod):
        breaks += [start_time + float(k) * period, start_time + (float(k) + width) * period]
        levels += [amplitude, 0.0]
    return offset + _select(breaks, levels)


def table(points: Points, offset: Expr, start_time: Expr) -> Expr:
    """Linear interpolation of `points`, whose times count from `start_time` [s]; `offset` before.

    Beyond its ends the table is extrapolated along its first and its last line, as in the Modelica Standard Library. If
    it ends with a jump it holds the last value, and the first value if it begins with a jump.

    Raises
    ------
    DeclarationError
        AC130 if the table is empty, does not consist of pairs, or its times descend.
    """
    points = _checked(points)
    t = unitless(time - start_time)
    segments = [(t0, y0, (y1 - y0) / (t1 - t0), t1) for (t0, y0), (t1, y1) in pairwise(_with_ends(points)) if t1 > t0]
    rows = _joined(segments)
    cuts = _cuts(rows)
    pieces: list[Expr | float] = []
    for first, last in pairwise([0, *cuts, len(rows)]):
        t0, y0, slope, _ = rows[first]
        if last == first + 1:
            pieces.append(y0 + slope * (t - t0) if slope else y0)
        else:
            own = rows[first:last]
            # Alternating names, because a cut between two calls of the same function would be removed.
            name = "table" if len(pieces) % 2 else "table_"
            pieces.append(lookup([*(r[0] for r in own), own[-1][3]], [r[1:3] for r in own], name)(t))
    breaks = [start_time + quantity(rows[k][0], "s") for k in cuts]
    return offset + where(time < start_time, 0.0, _select(breaks, pieces))


def _with_ends(points: Points) -> Points:
    """The points, with a horizontal line after a jump at the end, and before a jump at the beginning."""
    (first, y_first), (last, y_last) = points[0], points[-1]
    far = last - first or 1.0
    # The output before time zero of the table is always `offset`.
    before = ((first - far, y_first),) if first > 0.0 and len(points) > 1 and points[1][0] == first else ()
    after = ((last + far, y_last),) if len(points) == 1 or points[-2][0] == last else ()
    return (*before, *points, *after)


def _joined(rows: Sequence[tuple[float, float, float, float]]) -> list[tuple[float, float, float, float]]:
    """Merge rows on one straight line: a line has a second derivative, a search among equal lines has none."""
    found: list[tuple[float, float, float, float]] = []
    for row in rows:
        before = found[-1] if found else None
        if before is not None and before[2:] == (row[2], row[0]):
            end = before[1] + before[2] * (row[0] - before[0])
            if abs(end - row[1]) <= 1e-14 * max(abs(end), abs(row[1])):
                found[-1] = (*before[:3], row[3])
                continue
        found.append(row)
    return found


def _cuts(rows: Sequence[tuple[float, float, float, float]]) -> list[int]:
    """Rows at which there is a time event: jumps, and all kinks if there are few."""
    height = max(r[1] for r in rows) - min(r[1] for r in rows) + abs(rows[-1][2]) * (rows[-1][3] - rows[-1][0])
    jumps = []
    for k, (a, b) in enumerate(pairwise(rows), start=1):
        gap = abs(b[1] - (a[1] + a[2] * (a[3] - a[0])))
        if b[0] > a[3] or gap > 1e-12 * height:
            jumps.append(k)
    return sorted({*jumps, *few([r[3] - r[0] for r in rows], [b[2] - a[2] for a, b in pairwise(rows)], height)})


def _select(breaks: Sequence[Expr], values: Sequence[Expr | float]) -> Expr | float:
    """`values[k]` where `breaks[k-1] <= time < breaks[k]`; there is one more value than breaks."""
    if len(values) == 1:
        return values[0]
    middle = len(values) // 2
    before = _select(breaks[: middle - 1], values[:middle])
    after = _select(breaks[middle:], values[middle:])
    return where(time < breaks[middle - 1], before, after)


def _checked(points: Points) -> Points:
    for k, row in enumerate(points):
        wrong = wrong_row(row)
        if wrong is not None:
            raise DeclarationError(
                "AC130",
                f"row {k + 1} of {len(points)} of the table, {reprlib.repr(row)}, {wrong}",
                help="table=((0.0, 0.0), (1.0, 2.0))",
            )
    if len(points) == 0:
        raise DeclarationError("AC130", "the table has no row", help="table=((0.0, 0.0), (1.0, 2.0))")
    for (t0, _), (t1, _) in pairwise(points):
        if t1 < t0:
            raise DeclarationError(
                "AC130",
                f"the times of a table must not descend: {t1:g} s follows {t0:g} s",
                help="sort the rows by time",
            )
    return tuple((float(t), float(y)) for t, y in points)
