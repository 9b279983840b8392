"""The dynamic drilling force written by hand for one axis: plain Python, integrated by SciPy, sharing no code.

The contact force of equation (20) is found by bracketing, without the regularisation of the library, so that a mistake
in either formulation shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Profile = Sequence[tuple[float, float]]
Array = NDArray[np.float64]
Line = Callable[[float], float]
Event = Callable[[float, Array], float]


@dataclass(frozen=True)
class PlainDrilling:
    """One mass, one plate; units SI, names as in docs/drilling.md."""

    force: Profile
    speed: Profile
    gap: float = 1e-3
    t: float = 0.05
    m: float = 5.0
    k: float = 1e8
    d_c: float = 2e4
    d: float = 0.016
    sigma: float = math.radians(118.0)
    z_E: float = 2.0
    k_c11: float = 2240e6
    z: float = 0.21
    h_min: float = 1e-6
    factor: float = math.sin(math.radians(118.0))

    def width(self, s: float) -> float:
        """Difference of outer and inner diameter [m] at depth `s`."""
        slope = math.tan(self.sigma / 2)
        h_c = self.d / (2 * slope)
        return 2 * slope * (min(max(s, 0.0), h_c) - min(max(s - self.t, 0.0), h_c))

    def law(self, width: float, feed: float) -> float:
        """Feed force [N] of a feed per edge [m]."""
        h = max(feed * math.sin(self.sigma / 2), self.h_min)
        k_c: float = self.k_c11 * (h / 1e-3) ** -self.z
        return self.factor * self.z_E * width / 2 * feed * k_c

    def inverse(self, width: float, force: float) -> float:
        """Feed per edge [m] of a feed force [N]."""
        straight = force / self.law(width, 1e-30) * 1e-30
        sine = math.sin(self.sigma / 2)
        share = 2 * force / (self.factor * self.z_E * width * self.k_c11 * 1e-3) * sine**self.z
        return float(max(straight, 1e-3 * share ** (1 / (1 - self.z))))

    def contact(self, s: float, v: float, s_tar: float, n: float, inside: bool) -> tuple[float, float]:
        """Force on the drill [N] and target feed rate [m/s]; `inside` says on which side of the face, where s is 0."""
        pressed = self.k * (s - s_tar) + self.d_c * v
        width = self.width(s)
        rate = self.z_E * n
        if pressed <= 0 or not inside:
            return 0.0, 0.0
        if width <= 0:
            return 0.0, pressed / self.d_c if n > 0 else 0.0
        high = self.inverse(width, pressed)
        if n == 0:
            return pressed, 0.0
        high = min(high, pressed / (self.d_c * rate)) * (1 + 1e-12)
        feed = brentq(
            lambda x: pressed - self.d_c * rate * x - self.law(width, x), 0.0, high, xtol=1e-18, rtol=1e-14, maxiter=200
        )
        return pressed - self.d_c * rate * feed, rate * feed

    def depths(self, times: Sequence[float], tolerance: float = 1e-9) -> Array:
        """Columns s, v, s_tar at ascending `times`, from rest at time 0; shape (len(times), 3)."""
        corners = {t for t, _ in (*self.force, *self.speed) if t < times[-1]}
        breaks = sorted({0.0, *times} | corners)
        state = np.array([-self.gap, 0.0, 0.0])
        rows = {0.0: state}
        for begin, end in pairwise(breaks):
            rows[end] = state = self._segment(state, begin, end, tolerance)
        return np.array([rows[t] for t in times])

    def _segment(self, state: Array, begin: float, end: float, tolerance: float) -> Array:
        h_c = self.d / (2 * math.tan(self.sigma / 2))
        levels = (0.0, h_c, self.t, self.t + h_c)
        force, speed = _line(self.force, begin, end), _line(self.speed, begin, end)
        while begin < end:
            inside = bool(state[0] > 1e-14 or (state[0] > -1e-14 and state[1] >= 0))
            found = solve_ivp(
                self._rates(force, speed, inside),
                (begin, end),
                state,
                method="Radau",
                rtol=tolerance,
                atol=[1e-12, 1e-8, 1e-12],
                events=_crossings(levels, state),
                first_step=min(1e-7, (end - begin) / 10),
            )
            if found.status < 0:
                raise RuntimeError(f"the reference solution stops at {found.t[-1]} s: {found.message}")
            begin, state = float(found.t[-1]), found.y[:, -1]
        return np.asarray(state)

    def _rates(self, force: Line, speed: Line, inside: bool) -> Callable[[float, Array], list[float]]:
        def rates(t: float, x: Array) -> list[float]:
            F_N, v_tar = self.contact(x[0], x[1], x[2], speed(t), inside)
            return [x[1], (force(t) - F_N) / self.m, v_tar]

        return rates


def _line(profile: Profile, begin: float, end: float) -> Line:
    """The straight piece of a profile between two times without a corner between them."""
    for (t0, y0), (t1, y1) in pairwise(profile):
        if t0 <= begin and end <= t1:
            return lambda t: y0 + (y1 - y0) / (t1 - t0) * (t - t0)
    raise ValueError(f"the profile does not cover {begin} to {end} s")


def _crossings(levels: Sequence[float], state: Array) -> list[Event]:
    """Events that end a step: the tip at a kink of the geometry, or back at the ground of the hole."""
    # Where it stands at a kink, the crossing is behind it.
    found = [_level(level) for level in levels if abs(state[0] - level) > 1e-14]
    if state[0] < state[2] - 1e-12:
        # A long step through the air may miss the impact altogether.
        found.append(lambda t, x: float(x[0] - x[2]))
    for event in found:
        event.terminal = True  # type: ignore[attr-defined]
    return found


def _level(level: float) -> Event:
    return lambda t, x: float(x[0] - level)
