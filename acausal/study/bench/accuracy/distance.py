"""Errors of a run relative to a reference: at the end, along the run, and of the phase.

Conventions of the published test sets for initial value problems (F. Mazzia, C. Magherini, Test Set for Initial Value
Problem Solvers, release 2.4, University of Bari): scd is -log10 of the largest relative error of the end values, mescd
that of the mixed error |y - r| / (f + |r|). `f` is the nominal magnitude of a variable. If the variable never becomes
so large, `f` is its largest magnitude in the reference, but at least a thousandth of the nominal magnitude, below which
absolute tolerances do not require any digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.study.bench.accuracy.trajectory import Trajectory

_LEAST_FLOOR = 1e-3
# A variable oscillates if its slope changes sign at least this often.
_TURNS = 4
# Final fraction of the run in which the phase is compared.
_WINDOW = 0.25


@dataclass(frozen=True)
class Distance:
    """Errors of one run.

    `end` and `series` are mixed errors of the end values and of all points, `worst` is the variable with the largest
    one of the latter; `absolute` is the largest absolute error of the end values, in the units of the variables;
    `phase` is the delay of oscillations at the end [s], None if nothing oscillates; `shape` is the error over the last
    quarter of the run that remains when this delay is removed, relative to the largest magnitude of each variable.
    """

    end: float
    series: float
    scd: float
    mescd: float
    absolute: float
    worst: str
    phase: float | None = None
    shape: float | None = None


def floors(reference: Trajectory, nominal: Vector) -> Vector:
    """`f` of each variable, shape (k,), from its nominal magnitudes, shape (k,)."""
    largest = np.abs(reference.values).max(axis=0)
    return np.asarray(np.clip(largest, _LEAST_FLOOR * nominal, nominal))


def mixed(values: Vector, reference: Vector, floor: Vector) -> Vector:
    """Mixed errors, shape (n, k), of `values` against `reference`, shapes (n, k), with `floor`, shape (k,)."""
    return np.asarray(np.abs(values - reference) / (floor + np.abs(reference)))


def distance(found: Trajectory, fine: Trajectory, floor: Vector, trusted: float) -> Distance:
    """Errors of `found` relative to the reference `fine`, whose grid contains that of `found`.

    `floor`: `f` of each variable, shape (k,). Digits beyond `trusted` do not count in scd and mescd.
    """
    stride = (len(fine.times) - 1) // (len(found.times) - 1)
    reference = fine.every(stride)
    errors = mixed(found.values, reference.values, floor)
    end, last = float(errors[-1].max()), reference.values[-1]
    gap = np.abs(found.values[-1] - last)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(last != 0, gap / np.abs(last), 0.0)
    phase, shape = _phase(found, fine, floor)
    return Distance(
        end=end,
        series=float(errors.max()),
        scd=min(_digits(float(relative.max())), trusted),
        mescd=min(_digits(end), trusted),
        absolute=float(gap.max()),
        worst=found.names[int(errors.max(axis=0).argmax())],
        phase=phase,
        shape=shape,
    )


def _digits(error: float) -> float:
    return -math.log10(error) if error > 0 else math.inf


def _phase(found: Trajectory, fine: Trajectory, floor: Vector) -> tuple[float | None, float | None]:
    """(Delay of the oscillating variables at the end [s], remaining error): least squares of y(t) = r(t - delay).

    None for both if nothing oscillates.
    """
    swings = np.flatnonzero([_turns(fine.values[:, k]) >= _TURNS for k in range(len(fine.names))])
    if not swings.size or not np.isfinite(found.values).all():
        return None, None
    from scipy.interpolate import CubicSpline

    first, last, step = fine.times[0], fine.times[-1], fine.times[1] - fine.times[0]
    inside = found.times >= last - _WINDOW * (last - first)
    times, y = found.times[inside], found.values[inside][:, swings]
    scale = floor[swings] + np.abs(fine.values[:, swings]).max(axis=0)
    curve = CubicSpline(fine.times, fine.values[:, swings])
    slope = curve.derivative()

    def gap(delay: float) -> Vector:
        # compare only where the shifted reference exists
        exists = (times - delay <= last)[:, None]
        return np.asarray(np.where(exists, y - curve(np.clip(times - delay, first, last)), 0.0) / scale)

    # Gauss-Newton finds the nearest of many minima: start from the best shift by whole steps, at most a sixteenth of
    # the run
    most = int((last - first) / 16 / step)
    shifts = [float(step) * k for k in range(-most, most + 1)]
    delay = min(shifts, key=lambda d: float((gap(d) ** 2).sum()))
    for _ in range(4):
        exists = (times - delay <= last)[:, None]
        slopes = np.where(exists, slope(np.clip(times - delay, first, last)), 0.0) / scale
        power = float((slopes**2).sum())
        if power == 0.0:
            return None, None
        delay -= float((slopes * gap(delay)).sum()) / power
    return delay, float(np.abs(gap(delay)).max())


def _turns(values: Vector) -> int:
    """Number of reversals of a trajectory by more than a hundredth of its range."""
    span = float(np.ptp(values))
    if span == 0.0:
        return 0
    turns, extreme, direction = 0, float(values[0]), 0
    for v in values:
        if (v - extreme) * direction > 0 or direction == 0:
            if direction == 0 and abs(v - extreme) > 0.01 * span:
                direction = 1 if v > extreme else -1
                extreme = float(v)
            elif direction:
                extreme = float(v)
        elif abs(v - extreme) > 0.01 * span:
            turns, direction, extreme = turns + 1, -direction, float(v)
    return turns
