"""Events seen from outside: for solvers that only deliver points, the guards are looked at between the outputs.

A stretch is integrated with frozen modes, smoothly through an event, and its guards are looked at on a grid of its own,
so that events do not depend on the outputs. Where one is passed, the interval is integrated again on a finer grid, the
crossing is found on the polynomial through the nearest points, and a last integration ends there; one step of Newton's
method on the guard corrects what is left. A guard that dips below zero and returns between two looks is found by the
parabola through three of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.simulate.guards import Guards, Moment
from acausal.simulate.solvers.base import Piece, Segment
from acausal.simulate.stopping import Stop

Vector = NDArray[np.float64]
Integrate = Callable[[Segment], Piece]
LOOKS = 64
_FINE = 24
_NEAREST = 8
_MOST_LOOKS = 60
# Each divides the time in which a short hop may have ended by 24.
_MOST_RETURNS = 6


def first_crossing(times: Vector, g: Vector, band: Vector) -> tuple[int, bool] | None:
    """The first of n looks (after the start, row 0) at which a guard is passed; and whether it was seen there.

    `times` has shape (n + 1,), `g` (n + 1, guards). Looks need not be evenly spaced. The second is False where a guard
    may dip below zero within the interval that ends at this look, or in the one before it.
    """
    seen = (g < -band).any(axis=1)
    at = int(np.argmax(seen)) if seen.any() else len(g)
    if len(g) >= 3:
        a, b, c = g[:-2], g[1:-1], g[2:]
        before, after = np.diff(times)[:-1, None], np.diff(times)[1:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            rise, fall = (b - a) / before, (c - b) / after
            # the parabola b + slope*t + curve*t**2 through the three
            curve, slope = (fall - rise) / (before + after), (rise * after + fall * before) / (before + after)
            where, lowest = -slope / (2 * curve), b - slope**2 / (4 * curve)
            inside = (curve > 0) & (where > -before) & (where < after)
            dips = (inside & (lowest < -band) & (b >= -band)).any(axis=1)
        if np.any(dips) and int(np.argmax(dips)) + 2 < at:
            return int(np.argmax(dips)) + 2, False
    return (at, True) if seen.any() else None


def locate(guards: Guards, moment: Moment, segment: Segment, band: Vector, integrate: Integrate) -> Stop:
    """Cross the interval from `segment.start` to `segment.times[0]`, in which a guard is passed, up to the event.

    `time` of the answer is None when a closer look finds nothing.
    """
    end = float(segment.times[0])
    if end - segment.start <= 16 * _FINE * np.spacing(max(abs(end), guards.span)):  # nothing fits in between
        none = Piece(np.zeros((len(segment.x), 0)), np.zeros((len(segment.z), 0)), {})
        return Stop(none, segment.times[:0], segment.start, segment.x, segment.z)
    fine = _FINE
    for turn in range(_MOST_LOOKS):
        times = segment.start + (end - segment.start) * np.arange(1, fine + 1) / fine
        times[-1] = end
        piece = integrate(replace(segment, times=times))
        g = _with_start(guards, moment, segment, times, piece)
        found = first_crossing(np.append(segment.start, times), g, band)
        if found is None or (not found[1] and fine > 4 * _FINE):
            last = Piece(piece.x[:, -1:], piece.z[:, -1:], piece.counters)
            return Stop(last, times[-1:], None, piece.x[:, -1], piece.z[:, -1])
        k, seen = found
        if seen and not (k == 1 and turn < _MOST_RETURNS and _returns(guards, moment, segment.start, g, band)):
            return _ended(guards, moment, segment, times, piece, g, k, band, integrate)
        end, fine = float(times[k - 1]), min(fine * 2, 64 * _FINE)
    raise AssertionError("an interval is halved until its crossing is seen")


def _returns(guards: Guards, moment: Moment, start: float, g: Vector, band: Vector) -> bool:
    """Whether all guards that are passed at the first look have started at zero upward, and passed it on the way back.

    A short hop: its end is not its beginning.
    """
    passed = (g[1] < -band) & (g[0] <= 0.0)
    rate, noise = guards.rates(start, moment)
    return bool(passed.any() and (rate[passed] > noise[passed]).all() and not ((g[1] < -band) & ~passed).any())


def _ended(
    guards: Guards,
    moment: Moment,
    segment: Segment,
    times: Vector,
    piece: Piece,
    g: Vector,
    k: int,
    band: Vector,
    integrate: Integrate,
) -> Stop:
    """The stop at the earliest root between looks k-1 and k."""
    all_times = np.append(segment.start, times) - segment.start
    low = max(0, min(k - _NEAREST // 2, len(all_times) - _NEAREST))
    near = slice(low, low + _NEAREST)
    root = all_times[k]
    # not the barycentric form: SciPy permutes its nodes at random, and two equal runs differ in the last digit
    from scipy.interpolate import KroghInterpolator  # half a second, for a crossing only
    from scipy.optimize import brentq

    bracketed: Any = brentq
    for j in np.flatnonzero(g[k] < -band[: g.shape[1]]):
        curve = KroghInterpolator(all_times[near], g[near, j] + band[j])
        a, b = all_times[k - 1], all_times[k]
        if curve(a) > 0 > curve(b):
            root = min(root, float(bracketed(curve, a, b, xtol=1e-15 * b, rtol=1e-15)))
        else:
            root = min(root, a)
    x, z = segment.x, segment.z
    t = segment.start + root
    counters = dict(piece.counters)
    if t > segment.start:
        last = integrate(replace(segment, times=np.array([t])))
        x, z = last.x[:, -1], last.z[:, -1]
        for name, count in last.counters.items():
            counters[name] = counters.get(name, 0.0) + count
    problem = moment.regime.problem
    for _ in range(1 if len(z) else 3):
        here = replace(moment, x=x, z=z)
        value, (rate, _) = guards.distances(t, here) + band, guards.rates(t, here)
        nearest = int(np.argmin(np.abs(value) / np.maximum(np.abs(rate), 1e-30)))
        step = float(-value[nearest] / rate[nearest]) if rate[nearest] else 0.0
        if abs(step) > 1e-3 * (all_times[k] - all_times[k - 1]):
            break
        ode = np.array(problem.compiled.rhs(t, x, z, problem.u, problem.p, moment.m)[0]).ravel()
        x, t = x + step * ode, max(t + step, segment.start)
    return Stop(Piece(np.zeros((len(x), 0)), np.zeros((len(z), 0)), counters), times[:0], float(t), x, z)


def _with_start(guards: Guards, moment: Moment, segment: Segment, times: Vector, piece: Piece) -> Vector:
    """Guards at the start and at all looks; a start that is past its guard by noise counts as on it."""
    first = np.maximum(guards.distances(segment.start, moment), 0.0)
    return np.vstack([first, guards.along(times, piece.x, piece.z, moment.m, moment.regime)])
