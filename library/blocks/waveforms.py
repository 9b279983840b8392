"""Functions of time that signal, voltage and current sources share.

Every switch is a condition on `time` alone, so that the run is cut there exactly. Tables are searched by a
balanced tree of `where`: a table of n points costs log2(n) comparisons deep, not n.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from acausal import Expr, sin, time, where
from acausal.errors import DeclarationError

Points = tuple[tuple[float, float], ...]
"""Rows (time [s], value), times ascending; two rows with the same time are a jump."""


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

    Beyond its ends the table goes on along its first and its last line, as in the Modelica Standard Library.

    Raises
    ------
    DeclarationError
        AC130 when the table is empty, is not made of pairs, or its times descend.
    """
    _check(points)
    t = time - start_time
    lines: list[Expr | float] = []
    breaks: list[Expr] = []
    for (t0, y0), (t1, y1) in pairwise(points):
        if t1 > t0:
            slope = (y1 - y0) / (t1 - t0)
            lines.append(y0 + slope * (t - t0) if slope else y0)
            breaks.append(start_time + t1)
    if not lines:
        lines, breaks = [points[-1][1]], [start_time]
    return offset + where(time < start_time, 0.0, _select(breaks[:-1], lines))


def _select(breaks: Sequence[Expr], values: Sequence[Expr | float]) -> Expr | float:
    """`values[k]` where `breaks[k-1] <= time < breaks[k]`; one value more than breaks."""
    if len(values) == 1:
        return values[0]
    middle = len(values) // 2
    before = _select(breaks[: middle - 1], values[:middle])
    after = _select(breaks[middle:], values[middle:])
    return where(time < breaks[middle - 1], before, after)


def _check(points: Points) -> None:
    if not points or any(len(row) != 2 for row in points):
        raise DeclarationError(
            "AC130", f"the table {points!r} is not a list of (time, value) pairs", help="table=((0.0, 0.0), (1.0, 2.0))"
        )
    for (t0, _), (t1, _) in pairwise(points):
        if t1 < t0:
            raise DeclarationError(
                "AC130",
                f"the times of a table must not descend: {t1:g} s follows {t0:g} s",
                help="sort the rows by time",
            )
