"""Algebraic variables as functions of time alone: followed along their branch, step by step.

Where two branches meet, a parallelogram that folds flat, Newton's method started from the last position takes either;
started from where the motion leads, it stays on the one it is on. Steps are as short as the extrapolation needs, not as
the outputs ask. Source: E. L. Allgower, K. Georg, Numerical Continuation Methods (1990), chapter 2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acausal.arrays import Vector

# Largest distance between prediction and solution, in nominal magnitudes; below a tenth of it steps grow.
CLOSE = 0.02
_ZERO = 1e-9
_SMALLEST = 1e-9


def followed(
    solve: Callable[[float, Vector], Vector],
    residual: Callable[[float, Vector], float],
    start: float,
    times: Vector,
    z: Vector,
) -> Vector:
    """The solution at `times`, shape (nz, n), from its value `z` at `start`.

    `solve(t, guess)` gives a solution, `residual(t, z)` the largest one.

    Raises RuntimeError where the branch ends.
    """
    found = np.empty((len(z), len(times)))
    past: list[tuple[float, Vector]] = [(start, z)]
    span = float(times[-1]) - start
    step = (float(times[0]) - start) / 4
    here = start
    for k, wanted in enumerate(times):
        while here < wanted:
            to = min(here + step, float(wanted))
            if wanted - to < 1e-3 * step:
                to = float(wanted)
            guess = _extrapolated(past, to)
            value = solve(to, guess)
            off = float(np.max(np.abs(value - guess) / (1.0 + np.abs(guess)), initial=0.0))
            if not (off <= CLOSE and residual(to, value) <= _ZERO):  # nan is not good either
                if to - here > _SMALLEST * span:
                    step = (to - here) / 4
                    continue
                if not residual(to, guess) <= _ZERO:
                    raise RuntimeError(f"CONV_FAIL: the algebraic variables end at t = {here:g}")
                value = guess  # where branches cross, Newton's method knows nothing of where it came from
            if to - past[-1][0] >= 0.1 * step or len(past) < 3:
                past = [*past[-2:], (to, value)]
            here, z = to, value
            if off <= 0.1 * CLOSE:
                step *= 1.6
        found[:, k] = z
    return found


def _extrapolated(past: list[tuple[float, Vector]], t: float) -> Vector:
    """The polynomial through up to three points, at `t` (Lagrange)."""
    total = np.zeros_like(past[0][1])
    for i, (ti, zi) in enumerate(past):
        weight = 1.0
        for j, (tj, _) in enumerate(past):
            if i != j:
                weight *= (t - tj) / (ti - tj)
        total = total + weight * zi
    return total
