"""How much functions of guards change between mesh points, by the bounds of their arguments there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.events.location.between import lower_bounds
from acausal.simulate.events.resolution.windings import FACTOR, WINDING

# The largest logarithmic change of a steep function between two mesh points, that of a quotient, power or logarithm,
# and that beyond both points, where a pulse is, if anywhere.
_LARGEST_CHANGE, _LARGEST_RATIO, _LARGEST_TURN = 0.5, 5.0, 0.05
# Where exponentials and steps have ended; the least size of a denominator, relative to its largest; and any.
_FADED, _STEPPED, _LEAST, _FAR = 40.0, 20.0, 1e-12, 1e100
# How far the parabolas of an interval may differ, in the changes around it, which are none below that; and the least
# size of a factor, relative to its largest.
_LARGEST_BEND, _ROUNDED, _NEAREST = 0.1, 1e-12, 1e-7
_MONOTONE, _RATIOS = frozenset(("exp", "tanh", "atan")), frozenset(("div", "pow", "log", FACTOR))


def changes(times: Vector, arguments: Vector, operations: Sequence[str], exponents: Vector, chosen: Truth) -> Vector:
    """The largest change of any of the `chosen` functions in each of n intervals, relative to the one allowed; (n,).

    `arguments`, `operations`, `exponents`: See `guard_arguments.Arguments`; shapes (n + 1, k), (k,) and (k,).
    """
    change = np.zeros(len(times) - 1)
    if not chosen.any():
        return change
    arguments = np.nan_to_num(np.clip(arguments, -_FAR, _FAR))
    low, high = lower_bounds(times, arguments), -lower_bounds(times, -arguments)
    for k in np.flatnonzero(chosen).tolist():
        op, values = operations[k], arguments[:, k]
        found = _bend(times, values) / _LARGEST_BEND if op == WINDING else _change(op, values, low[:, k], high[:, k])
        change = np.fmax(change, exponents[k] * found)
    return change


def _change(op: str, values: Vector, low: Vector, high: Vector) -> Vector:
    """The change of a function in each of n intervals, from bounds of its argument there; shape (n,)."""
    both = np.stack([values[:-1], values[1:]])
    least, most = np.fmin(low, both.min(axis=0)), np.fmax(high, both.max(axis=0))
    if op not in _MONOTONE:
        passes_zero, both = np.sign(least) * np.sign(most) < 0.0, np.abs(both)
        least, most = np.where(passes_zero, 0.0, np.fmin(np.abs(least), np.abs(most))), np.fmax(-least, most)
    nearest = max((_NEAREST if op == FACTOR else _LEAST) * float(both.max()), 1e-300)
    levels = [_level(op, v, nearest) for v in (least, both.min(axis=0), both.max(axis=0), most)]
    turn = np.fmax(levels[1] - levels[0], levels[3] - levels[2]) / _LARGEST_TURN
    between = (levels[3] - levels[0]) / (_LARGEST_RATIO if op in _RATIOS else _LARGEST_CHANGE)
    return np.fmax(between, turn)


def _bend(times: Vector, values: Vector) -> Vector:
    """How far the two parabolas of each of n intervals differ, in its changes; shape (n,)."""
    h = np.diff(times)
    if len(h) < 3:
        return np.full(len(h), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.diff(values) / h
        curves = np.diff(slopes) / (h[1:] + h[:-1])
        differences = np.abs(np.diff(curves)) * h[1:-1] ** 2
        around = np.lib.stride_tricks.sliding_window_view(values, 4)
        ranges = around.max(axis=1) - around.min(axis=1)
        bend = np.where(ranges > _ROUNDED * np.abs(around).max(axis=1), differences / ranges, 0.0)
    bends: Vector = np.nan_to_num(np.concatenate([bend[:1], bend, bend[-1:]]))
    return bends


def _level(op: str, argument: Vector, least: float) -> Vector:
    """The logarithm of a function, or of what a step has left to its end, where it matters; grows with `argument`.

    Functions that are not monotone are given magnitudes, of which `least` counts as zero.
    """
    if op == "exp":
        return np.maximum(argument, -_FADED)
    if op == "tanh":
        return np.clip(argument, -_STEPPED, _STEPPED)
    if op == "atan":
        return np.arcsinh(argument)
    if op in ("cosh", "sinh"):
        return np.clip(argument, 1.0, _FADED)
    return np.minimum(np.log(np.maximum(argument, least)), _FADED)
