"""Approximation of a signal over time by polynomials; the run is cut only where one of them ends.

Each polynomial covers as many measured values as possible, as long as a solver could not distinguish it from them;
noise is followed from value to value. The allowed error is a fraction of the tolerance, relative to the size of the
signal's variation. Polynomials agree with the signal at both ends, so that they add no jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.lower.chebyshev import INPUT_DEGREE, INPUT_WIDTH, between, fitted, value

Signal = Callable[[Vector], Vector]
# Pieces into which a function is divided first, enough to detect a pulse of a thousandth of the run.
_FIRST = 64
_MOST = 20_000
# The shortest piece, relative to the run.
_SHORTEST = 1e-11
# Points between the nodes of a polynomial, on [-1, 1], at which it is compared with the signal.
_BETWEEN = -np.cos(np.pi * (np.arange(INPUT_DEGREE) + 0.5) / INPUT_DEGREE)
# So few intervals between rows are not tried as one polynomial, but as straight lines.
_FEW = 6


@dataclass(frozen=True, eq=False)
class Pieces:
    """Consecutive polynomials."""

    breaks: Vector  # where each begins, and where the last one ends [s]; shape (n + 1,)
    numbers: Vector  # centre, inverse of half the width, and coefficients of each; shape (n, INPUT_WIDTH)

    def at(self, times: Vector) -> Vector:
        """The numbers of the pieces in which n instants lie, shape (n, INPUT_WIDTH)."""
        piece = np.searchsorted(self.breaks, times, side="right") - 1
        return np.asarray(self.numbers[np.clip(piece, 0, len(self.numbers) - 1)])

    @property
    def jumps(self) -> Vector:
        """Breaks at which the value itself jumps [s]."""
        left = self.numbers[:-1, 2:].sum(axis=1)
        right = self.numbers[1:, 2:] @ (-1.0) ** np.arange(INPUT_DEGREE + 1)
        size = np.abs(self.numbers[:, 2:]).sum(axis=1)
        return np.asarray(self.breaks[1:-1][np.abs(right - left) > 1e-12 * (size[:-1] + size[1:])])


def _row(a: float, b: float, coefficients: Vector) -> Vector:
    row = np.zeros(INPUT_WIDTH)
    row[:2] = 0.5 * (a + b), 2.0 / (b - a)
    row[2 : 2 + len(coefficients)] = coefficients
    return row


def _joined(parts: Sequence[tuple[float, float, Vector]]) -> Pieces:
    breaks = np.array([*(a for a, _, _ in parts), parts[-1][1]])
    return Pieces(breaks, np.array([_row(*part) for part in parts]))


def held(times: Vector, values: Vector) -> Pieces:
    """Hold each value up to the next instant; consecutive equal values become one piece."""
    starts = [0, *(k for k in range(1, len(times) - 1) if values[k] != values[k - 1] or times[k] == times[k + 1])]
    starts = [k for k in starts if times[k] < times[k + 1]]
    ends = [float(times[k]) for k in starts[1:]] + [float(times[-1])]
    return _joined([(float(times[k]), end, values[k : k + 1]) for k, end in zip(starts, ends, strict=True)])


def steps(times: Vector, values: Vector) -> Pieces:
    """A constant piece between each two of n + 1 instants [s]; `values` has shape (n,)."""
    return _joined([(a, b, v) for (a, b), v in zip(pairwise(times.tolist()), values[:, None], strict=True)])


def straight(times: Vector, values: Vector, error: float) -> Pieces:
    """Interpolate linearly through n points (arrays of shape (n,)), with polynomials within `error` where fewer do."""
    parts: list[tuple[float, float, Vector]] = []
    doubles = (np.flatnonzero(np.diff(times) == 0.0) + 1).tolist()
    for first, last in zip([0, *doubles], [*doubles, len(times)], strict=True):
        if last - first > 1:
            parts += _lines(times[first:last], values[first:last], error)
    return _joined(parts)


def _lines(times: Vector, values: Vector, error: float) -> list[tuple[float, float, Vector]]:
    """Approximate a polyline without jumps by polynomials, over intervals that are divided until they meet `error`."""
    parts: list[tuple[float, float, Vector]] = []
    stack = [(0, len(times) - 1)]
    while stack:
        i, j = stack.pop()
        if j - i <= _FEW:
            parts += _chords(times, values, i, j, error)
            continue
        a, b = float(times[i]), float(times[j])
        nodes = np.interp(between(a, b, INPUT_DEGREE), times[i : j + 1], values[i : j + 1])
        coefficients = fitted(nodes)
        at = np.append(times[i + 1 : j], 0.5 * (times[i:j] + times[i + 1 : j + 1]))
        errors = np.abs(
            value(coefficients, (2 * at - a - b) / (b - a)) - np.interp(at, times[i : j + 1], values[i : j + 1])
        )
        worst = float(errors.max())
        if worst <= error:
            parts.append((a, b, coefficients))
            continue
        # a large error suggests noise, for which halving would only waste fits
        count = 2 if worst <= 1e3 * error else 8
        marks = np.unique(np.linspace(i, j, count + 1).round().astype(int)).tolist()
        stack += list(pairwise(marks))[::-1]
    return parts


def _chords(times: Vector, values: Vector, i: int, j: int, error: float) -> list[tuple[float, float, Vector]]:
    """Straight lines, each over as many points as it fits within the error."""
    parts = []
    while i < j:
        end = j
        while end > i + 1:
            t, v = times[i : end + 1], values[i : end + 1]
            if (np.abs(v[0] + (v[-1] - v[0]) * ((t - t[0]) / (t[-1] - t[0])) - v) <= error).all():
                break
            end -= 1
        left, right = float(values[i]), float(values[end])
        parts.append((float(times[i]), float(times[end]), np.array([0.5 * (left + right), 0.5 * (right - left)])))
        i = end
    return parts


def sampled(signal: Signal, knots: Vector, error: float, name: str) -> Pieces:
    """Approximate a function within `error` at the sampled instants; it may have jumps or kinks at `knots` [s].

    Intervals are halved until the polynomial through eight values agrees at seven others; then neighbours are joined
    again as long as one polynomial fits both.

    Raises UsageError: AC044 for a function that varies on every time scale.
    """
    span = float(knots[-1] - knots[0])
    parts: list[tuple[float, float, Vector]] = []
    for a, b in zip(knots[:-1].tolist(), knots[1:].tolist(), strict=True):
        count = max(1, round(_FIRST * (b - a) / span))
        marks = np.linspace(a, b, count + 1)
        part: list[tuple[float, float, Vector]] = []
        for left, right in zip(marks[:-1].tolist(), marks[1:].tolist(), strict=True):
            part += _halved(signal, left, right, error, span, name)
        parts += _merged(signal, part, error)
    return _joined(_closed(parts, float(knots[0]), float(knots[-1])))


def _fit(signal: Signal, a: float, b: float) -> tuple[Vector, float]:
    """Coefficients on [a, b], and the largest error between the nodes."""
    inner = between(a, b, INPUT_DEGREE)
    # just inside, so that the value of this side counts at a jump
    inner[0], inner[-1] = np.nextafter(a, b), np.nextafter(b, a)
    coefficients = fitted(signal(inner))
    checked = 0.5 * (a + b) + 0.5 * (b - a) * _BETWEEN
    return coefficients, float(np.abs(value(coefficients, _BETWEEN) - signal(checked)).max())


def _halved(
    signal: Signal, a: float, b: float, error: float, span: float, name: str
) -> list[tuple[float, float, Vector]]:
    parts: list[tuple[float, float, Vector]] = []
    first, stack, fits = a, [(a, b)], 0
    while stack:
        a, b = stack.pop()
        fits += 1
        coefficients, largest_error = _fit(signal, a, b)
        if largest_error <= error:
            parts.append((a, b, coefficients))
        elif b - a > _SHORTEST * max(span, abs(a), abs(b)):
            middle = 0.5 * (a + b)
            stack += [(middle, b), (a, middle)]
        # else there is a jump inside, and `_closed` joins the neighbours there
        if fits > _MOST:
            raise UsageError(
                "AC044",
                f"{name} varies too fast between t = {first:.6g} s and {b:.6g} s: polynomials cannot follow it",
                cause="a function is sampled until polynomials of degree 7 agree with it between the samples",
                help="if it is noise, sample it yourself and give TimeSeries(time, value)",
            )
    return parts


def _merged(
    signal: Signal, parts: list[tuple[float, float, Vector]], error: float
) -> list[tuple[float, float, Vector]]:
    merged: list[tuple[float, float, Vector]] = []
    for part in parts:
        merged.append(part)
        while len(merged) > 1 and merged[-2][1] == merged[-1][0]:
            a, b = merged[-2][0], merged[-1][1]
            coefficients, largest_error = _fit(signal, a, b)
            if largest_error > error:
                break
            merged[-2:] = [(a, b, coefficients)]
    return merged


def _closed(parts: list[tuple[float, float, Vector]], first: float, last: float) -> list[tuple[float, float, Vector]]:
    """Close the gaps around jumps: each polynomial is extended to the beginning of the next one."""
    closed = []
    for k, (a, b, coefficients) in enumerate(parts):
        begin, end = a if k else first, parts[k + 1][0] if k + 1 < len(parts) else last
        if (begin, end) != (a, b):  # the same polynomial, a little further
            inside = (2.0 * between(begin, end, INPUT_DEGREE) - (a + b)) / (b - a)
            coefficients = fitted(value(coefficients, np.clip(inside, -1.0, 1.0)))
        closed.append((begin, end, coefficients))
    return closed
