"""The drive of `acausal.models.clutches.ThreeClutchDrive`, written by hand for integrators that stop at events.

Four speeds; each clutch is free, slides forward or backward, or is stuck. Every segment between two events is an ODE
with fixed modes and a guard for each clutch; at an event the modes are determined again, starting with the lowest
clutch. The compiler does the same automatically for the components.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Modes = tuple[int, ...]

FREE, STUCK, FORWARD, BACKWARD = 0, 2, 1, -1
STOP = 1.5
_PEAK, _FRICTION, _FORCE = 1.1, 0.5, 20.0
_STARTS = (0.0, 0.4, 0.9)


def limits(t: float, stretch: int) -> list[float]:
    """Torque that each clutch transmits when it slides, within the segment that begins at `_STARTS[stretch]`."""
    wave = math.sin(2 * math.pi * 0.2 * t + 1.57)
    forces = (wave, float(stretch >= 1), float(stretch >= 2))
    return [_FRICTION * _FORCE * max(force, 0.0) for force in forces]


def torques(t: float, modes: Modes, stretch: int) -> list[float]:
    """Torques of the clutches; those of stuck ones keep the speeds on both sides equal."""
    drive, most = 10.0 * math.sin(2 * math.pi * 5.0 * t), limits(t, stretch)
    found = [0.0 if mode in (FREE, STUCK) else mode * limit for mode, limit in zip(modes, most, strict=True)]
    stuck = [k for k in range(3) if modes[k] == STUCK]
    if not stuck:
        return found
    # Equal accelerations: 2*tau[k] - tau[k-1] - tau[k+1] is the torque that accelerates both sides apart.
    matrix, right = np.zeros((len(stuck), len(stuck))), np.zeros(len(stuck))
    for row, k in enumerate(stuck):
        right[row] = drive if k == 0 else 0.0
        for column, other in enumerate(stuck):
            matrix[row, column] = 2.0 if other == k else -1.0 if abs(other - k) == 1 else 0.0
        right[row] += sum(found[other] for other in (k - 1, k + 1) if 0 <= other < 3 and modes[other] != STUCK)
    for k, value in zip(stuck, np.linalg.solve(matrix, right), strict=True):
        found[k] = float(value)
    return found


def rates(t: float, w: Any, modes: Modes, stretch: int) -> list[float]:
    """Accelerations of the four inertias of 1 kg.m2."""
    a, b, c = torques(t, modes, stretch)
    return [10.0 * math.sin(2 * math.pi * 5.0 * t) - a, a - b, b - c, c]


def guards(t: float, w: Any, modes: Modes, stretch: int) -> list[float]:
    """For each clutch a function that falls to zero when its mode ends, and the force of the first one."""
    most, transmitted = limits(t, stretch), torques(t, modes, stretch)
    found = []
    for k, mode in enumerate(modes):
        if mode == STUCK:
            found.append(_PEAK * most[k] - abs(transmitted[k]))
        else:
            found.append(1.0 if mode == FREE else mode * (w[k] - w[k + 1]))
    return [*found, 1.0 if modes[0] == FREE else math.sin(2 * math.pi * 0.2 * t + 1.57)]


def decided(t: float, w: Vector, before: Modes, stretch: int, reached: int | None) -> Modes:
    """The modes after an event at guard `reached`, or at the start of a segment."""
    most = limits(t, stretch)
    modes = list(before)
    for k in range(3):
        apart = w[k] - w[k + 1]
        if most[k] <= 0.0 or (k == 0 and reached == 3):
            modes[k] = FREE
        elif modes[k] == FREE:
            modes[k] = STUCK if abs(apart) < 1e-9 else int(math.copysign(1, apart))
        elif reached == k:
            # A stuck clutch breaks loose in the direction in which it was driven; a sliding one may stick.
            driven = torques(t, tuple(modes), stretch)[k]
            modes[k] = int(math.copysign(1, driven)) if modes[k] == STUCK else STUCK
    for _ in range(10):
        transmitted = torques(t, tuple(modes), stretch)
        loose = [k for k in range(3) if modes[k] == STUCK and abs(transmitted[k]) > _PEAK * most[k] * (1 + 1e-9)]
        if not loose:
            break
        modes[loose[0]] = int(math.copysign(1, transmitted[loose[0]]))
    return tuple(modes)


Solve = Callable[[float, float, Vector, Modes, int], tuple[float, Vector, int | None]]


def drive(solve: Solve) -> tuple[Vector, int]:
    """Final speeds, and the number of events; `solve` integrates to the next event or to the end of a segment."""
    w, modes, events = np.array([10.0, 0.0, 0.0, 0.0]), (FREE, FREE, FREE), 0
    for stretch, (t, end) in enumerate(zip(_STARTS, (*_STARTS[1:], STOP), strict=True)):
        modes = decided(t, w, modes, stretch, None)
        while t < end:
            t, w, reached = solve(t, end, w, modes, stretch)
            if reached is not None:
                events += 1
                if reached < 3 and modes[reached] != STUCK:
                    w[reached] = w[reached + 1] = 0.5 * (w[reached] + w[reached + 1])
                modes = decided(t, w, modes, stretch, reached)
        events += end < STOP
    return w, events


def scipy_steps(tolerance: float) -> Solve:
    """SciPy's RK45 with terminal events."""
    from scipy.integrate import solve_ivp

    def solve(t: float, end: float, w: Vector, modes: Modes, stretch: int) -> tuple[float, Vector, int | None]:
        def watched(number: int) -> Callable[[float, Any], float]:
            def guard(t: float, w: Any) -> float:
                return guards(t, w, modes, stretch)[number]

            guard.terminal, guard.direction = True, -1  # type: ignore[attr-defined]
            return guard

        found = solve_ivp(
            lambda t, w: rates(t, w, modes, stretch),
            (t, end),
            w,
            events=[watched(k) for k in range(4)],
            rtol=tolerance,
            atol=1e-3 * tolerance,
        )
        reached = next((k for k, times in enumerate(found.t_events) if len(times)), None)
        return float(found.t[-1]), found.y[:, -1].copy(), reached

    return solve


def sundae_steps(tolerance: float) -> Solve:
    """scikit-sundae's IDA with an events function."""
    from sksundae.ida import IDA

    def solve(t: float, end: float, w: Vector, modes: Modes, stretch: int) -> tuple[float, Vector, int | None]:
        def residual(t: float, y: Any, yp: Any, res: Any) -> None:
            res[:] = yp - np.array(rates(t, y, modes, stretch))

        def watched(t: float, y: Any, yp: Any, events: Any) -> None:
            events[:] = guards(t, y, modes, stretch)

        watched.terminal, watched.direction = [True] * 4, [-1] * 4  # type: ignore[attr-defined]
        solver = IDA(residual, eventsfn=watched, num_events=4, rtol=tolerance, atol=1e-3 * tolerance)
        found = solver.solve(np.array([t, end]), w, np.array(rates(t, w, modes, stretch)))
        hits = None if found.i_events is None or not len(found.i_events) else np.flatnonzero(found.i_events[-1])
        return float(found.t[-1]), np.array(found.y[-1]), None if hits is None or not len(hits) else int(hits[0])

    return solve
