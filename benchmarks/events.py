"""Time per event, compared with peers that locate events: 100 bounces of a ball, three clutches, a 10 kHz converter.

    python benchmarks/events.py [--json]

The peers get equations written by hand, with a terminal event and a restart: scipy `solve_ivp` (RK45) and scikit-sundae
IDA (events function). Acausal runs the compiled model with the default solver for events; C is compiled beforehand and
not counted. The ball moves through air, since in a vacuum every method follows its parabolas exactly in one step.
Errors are those of the instant of the last bounce, the final speeds, and the capacitor's voltage, relative to runs of
SciPy at 1e-12.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import three_clutches_by_hand as clutches
from scipy.integrate import solve_ivp

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, pre, quantity, reset, variable, when
from acausal.models.clutches import ThreeClutchDrive
from acausal.models.switched_converter import BuckConverter

G, E, DRAG, BOUNCES = 9.81, 0.99, 0.05, 100
TOLERANCE = 1e-8


class Ball(Component):
    """A ball dropped from 1 m through air that keeps 99 % of its speed at the floor."""

    e: Real = parameter(default=E, unit="1")
    c: Real = parameter(default=DRAG, unit="1/m")
    h: Real = variable(unit="m", default=fixed(1.0))
    v: Real = variable(unit="m/s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -quantity(G, "m/s2") - self.c * self.v * abs(self.v)
        yield when(self.h < 0, reset(self.v, -self.e * pre(self.v)))


def timed(run: Callable[[], Any], repetitions: int) -> tuple[float, Any]:
    """Median of the processor times, which other load hardly affects, and the last result."""
    run()
    found = []
    for _ in range(repetitions):
        began = time.process_time()
        answer = run()
        found.append(time.process_time() - began)
    return float(np.median(found)), answer


def ball_ours(native: bool, last: float) -> Callable[[], float]:
    compiled = acausal.compile(Ball())
    stop = last + 1e-3
    acausal.simulate(compiled, stop_time=stop, tolerance=TOLERANCE, output_interval=stop, native=native)

    def run() -> float:
        r = acausal.simulate(compiled, stop_time=stop, tolerance=TOLERANCE, output_interval=stop, native=native)
        return float(r.events[-1].time)

    return run


def ball_scipy(tolerance: float = TOLERANCE) -> float:
    def floor(t: float, y: Any) -> float:
        return float(y[0])

    def rate(t: float, y: Any) -> tuple[float, float]:
        return y[1], -G - DRAG * y[1] * abs(y[1])

    floor.terminal, floor.direction = True, -1  # type: ignore[attr-defined]
    t, y = 0.0, np.array([1.0, 0.0])
    for _ in range(BOUNCES):
        s = solve_ivp(rate, (t, 1e3), y, events=floor, rtol=tolerance, atol=1e-3 * tolerance)
        t, y = s.t[-1], np.array([0.0, -E * s.y[1, -1]])
    return float(t)


def ball_sundae() -> float:
    from sksundae.ida import IDA

    def residual(t: float, y: Any, yp: Any, res: Any) -> None:
        res[0], res[1] = yp[0] - y[1], yp[1] + G + DRAG * y[1] * abs(y[1])

    def floor(t: float, y: Any, yp: Any, events: Any) -> None:
        events[0] = y[0]

    floor.terminal, floor.direction = [True], [-1]  # type: ignore[attr-defined]
    solver = IDA(residual, eventsfn=floor, num_events=1, rtol=TOLERANCE, atol=1e-3 * TOLERANCE)
    t, y = 0.0, np.array([1.0, 0.0])
    for _ in range(BOUNCES):
        s = solver.solve(np.array([t, t + 10.0]), y, np.array([y[1], -G - DRAG * y[1] * abs(y[1])]))
        t, y = float(s.t[-1]), np.array([0.0, -E * s.y[-1, 1]])
    return t


STOP = 0.2


def converter_ours(native: bool) -> Callable[[], float]:
    compiled = acausal.compile(BuckConverter())

    def run() -> float:
        r = acausal.simulate(
            compiled, stop_time=STOP, tolerance=TOLERANCE, output_interval=STOP, solver="rosenbrock", native=native
        )
        return float(r.final("load.v"))

    run()
    return run


def converter_scipy(tolerance: float = TOLERANCE) -> float:
    ron, goff, supply, inductance, capacitance, load = 1e-3, 1e-6, 24.0, 1e-3, 100e-6, 6.0

    def node(i: float, closed: bool, blocks: bool) -> float:
        """Voltage between switch, diode and coil: the currents into it sum to zero."""
        switch, diode = 1 / ron if closed else goff, goff if blocks else 1 / ron
        return (switch * supply - i) / (switch + diode)

    t, y = 0.0, np.array([0.0, 0.0])
    half = 0.5 / 10e3
    for k in range(round(STOP / half)):
        closed, end = k % 2 == 0, (k + 1) * half
        while t < end * (1 - 1e-12):
            blocks = node(y[0], closed, True) > 0

            def rate(t: float, y: Any, closed: bool = closed, blocks: bool = blocks) -> tuple[float, float]:
                return (node(y[0], closed, blocks) - y[1]) / inductance, (y[0] - y[1] / load) / capacitance

            def flips(t: float, y: Any, closed: bool = closed, blocks: bool = blocks) -> float:
                v = node(y[0], closed, blocks)
                return v if blocks else -v

            flips.terminal, flips.direction = True, -1  # type: ignore[attr-defined]
            s = solve_ivp(rate, (t, end), y, events=flips, rtol=tolerance, atol=1e-3 * tolerance)
            t, y = float(s.t[-1]), s.y[:, -1]
    return float(y[1])


def clutches_ours(native: bool) -> Callable[[], float]:
    compiled = acausal.compile(ThreeClutchDrive())

    def run() -> float:
        r = acausal.simulate(
            compiled, stop_time=clutches.STOP, tolerance=TOLERANCE, output_interval=clutches.STOP, native=native
        )
        return float(r.final("J1.w"))

    run()
    return run


def main() -> None:
    """Run all, print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--repetitions", type=int, default=3)
    given = parser.parse_args()
    last, reference = ball_scipy(1e-13), converter_scipy(1e-12)
    speeds, switchings = clutches.drive(clutches.scipy_steps(1e-12))
    rows = []
    for scene, events, truth, runs in (
        (
            "ball, 100 bounces",
            BOUNCES,
            last,
            {
                "acausal, compiled": ball_ours(True, last),
                "acausal, interpreted": ball_ours(False, last),
                "scipy RK45": ball_scipy,
                "scikit-sundae IDA": ball_sundae,
            },
        ),
        (
            "drive with 3 clutches",
            switchings,
            float(speeds[0]),
            {
                "acausal, compiled": clutches_ours(True),
                "acausal, interpreted": clutches_ours(False),
                "scipy RK45": lambda: float(clutches.drive(clutches.scipy_steps(TOLERANCE))[0][0]),
                "scikit-sundae IDA": lambda: float(clutches.drive(clutches.sundae_steps(TOLERANCE))[0][0]),
            },
        ),
        (
            "10 kHz converter, 0.2 s",
            round(2 * STOP * 10e3),
            reference,
            {
                "acausal, compiled": converter_ours(True),
                "acausal, interpreted": converter_ours(False),
                "scipy RK45": converter_scipy,
            },
        ),
    ):
        for name, run in runs.items():
            seconds, answer = timed(run, given.repetitions)
            rows.append(
                {
                    "scene": scene,
                    "tool": name,
                    "seconds": seconds,
                    "events_per_second": events / seconds,
                    "error": abs(answer - truth),
                }
            )
    if given.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        print(
            f"{row['scene']:26}{row['tool']:24}{1e3 * row['seconds']:10.1f} ms"
            f"{row['events_per_second']:10.0f} /s   error {row['error']:.1e}"
        )


if __name__ == "__main__":
    main()
