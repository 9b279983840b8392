"""Further workloads compared with hand-written programs: many events, many bodies, reading of results, many runs.

    python benchmarks/workloads.py [--only converter balls] [--json]

Every row runs its sides in turn in one process; times are medians of processor time, ratios are medians over the
rounds. To be fair, both sides read what they have computed, forces are evaluated, bodies move through air (every method
is exact for the parabola of a ball in a vacuum), and the hand-written side keeps its integrators. `fields.py` and
`contact.py` have the rows of fields and contacts, `sweep.py` that of sweeps.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import events
import numpy as np
import thick_block_vs_casadi
from measure import alternated, medians, ratios, report, rounded

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    parameter,
    part,
    pre,
    reset,
    structural,
    variable,
    when,
)
from acausal.models.clutches import ClutchChain
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_kinematic import ThinPlate
from acausal.models.rc_ladder import RCLadder
from acausal.simulate.equations.calls.raw import Kept
from acausal.simulate.solvers.base import SMOOTH_FRACTION

TOLERANCE = 1e-8
Job = Callable[[], float]


def in_turn(jobs: dict[str, Job], rounds: int) -> tuple[dict[str, list[float]], dict[str, float]]:
    """Processor seconds of every job, run in turn after an unmeasured round, and their results."""
    answers: dict[str, float] = {}

    def answered(name: str, job: Job) -> Callable[[], None]:
        def run() -> None:
            answers[name] = job()

        return run

    # `alternated` collects garbage between jobs, so that no side pays for what another one has left.
    return alternated({name: answered(name, job) for name, job in jobs.items()}, rounds), answers


# -- events --------------------------------------------------------------------------------------------------------


def clutches(n: int) -> dict[str, Job]:
    """A chain of clutches that break loose and stick, 2 s; no peer in this run, the growth with n counts."""
    compiled = acausal.compile(ClutchChain(n=n))

    def run(native: bool) -> float:
        r = acausal.simulate(compiled, stop_time=2.0, tolerance=TOLERANCE, output_interval=2.0, native=native)
        return float(r.final("inertias[0].w"))

    return {"acausal, compiled": lambda: run(True), "acausal, interpreted": lambda: run(False)}


def converter() -> dict[str, Job]:
    """4000 switchings; the matrix exponential assumes knowledge that the current never ends."""
    from scipy.linalg import expm

    def exactly() -> float:
        on, off, supply, coil, capacitor, load = 1e-3, 1e-6, 24.0, 1e-3, 100e-6, 6.0
        steps = []
        for switch, diode in ((1 / on, off), (off, 1 / on)):
            g = switch + diode  # voltage of the node: (switch * supply - i) / g
            a = np.array([[-1 / (g * coil), -1 / coil], [1 / capacitor, -1 / (load * capacitor)]])
            whole = np.zeros((3, 3))
            whole[:2, :2], whole[:2, 2] = a, [switch * supply / (g * coil), 0.0]
            steps.append(expm(0.5e-4 * whole))
        x = np.array([0.0, 0.0, 1.0])
        for k in range(round(2 * events.STOP * 10e3)):
            x = steps[k % 2] @ x
        return float(x[1])

    return {
        "acausal, compiled": events.converter_ours(True),
        "acausal, interpreted": events.converter_ours(False),
        "scipy RK45": events.converter_scipy,
        "matrix exponential": exactly,
    }


G, DRAG, E, BALLS, FLIGHT = 9.81, 0.1, 0.8, 64, 2.4


class Ball(Component):
    """A ball that falls through air and keeps 80 % of its speed at the floor."""

    h0: Real = parameter(unit="m")
    c: Real = parameter(default=DRAG, unit="1/m")
    g: Real = parameter(default=G, unit="m/s2")
    e: Real = parameter(default=E, unit="1")
    h: Real = variable(unit="m")
    v: Real = variable(unit="m/s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -self.g - self.c * self.v * abs(self.v)
        yield when(self.h < 0, reset(self.v, -self.e * pre(self.v)))

    def initial_equations(self) -> Equations:
        yield self.h == self.h0


class Balls(Component):
    """Many balls, dropped from different heights."""

    n: int = structural(default=BALLS)
    ball: list[Ball] = part()

    def build(self) -> None:
        self.ball = [Ball(h0=0.5 + 0.01 * k) for k in range(self.n)]


def balls_scipy(tolerance: float = TOLERANCE) -> float:
    """The same balls as one system, in which the lowest one ends a segment."""
    from scipy.integrate import solve_ivp

    def rate(t: float, y: Any) -> Any:
        v = y[BALLS:]
        return np.concatenate([v, -G - DRAG * v * np.abs(v)])

    def floor(t: float, y: Any) -> float:
        return float(np.min(np.where((y[:BALLS] > 1e-12) | (y[BALLS:] < 0), y[:BALLS], np.inf)))

    floor.terminal, floor.direction = True, -1  # type: ignore[attr-defined]
    t, y = 0.0, np.concatenate([0.5 + 0.01 * np.arange(BALLS), np.zeros(BALLS)])
    while t < FLIGHT:
        s = solve_ivp(rate, (t, FLIGHT), y, events=floor, rtol=tolerance, atol=1e-3 * tolerance)
        t, y = float(s.t[-1]), s.y[:, -1].copy()
        if t < FLIGHT:
            hit = (np.abs(y[:BALLS]) < 1e-9) & (y[BALLS:] < 0)
            y[BALLS:][hit] *= -E
            y[:BALLS][hit] = 0.0
    return float(y[:BALLS].sum())


def balls() -> dict[str, Job]:
    """64 balls in air."""
    compiled = acausal.compile(Balls())

    def run(native: bool) -> float:
        r = acausal.simulate(compiled, stop_time=FLIGHT, tolerance=TOLERANCE, output_interval=FLIGHT, native=native)
        return float(sum(float(r.final(f"ball[{k}].h")) for k in range(BALLS)))

    return {
        "acausal, compiled": lambda: run(True),
        "acausal, interpreted": lambda: run(False),
        "scipy RK45": balls_scipy,
    }


# -- reading -------------------------------------------------------------------------------------------------------


def reading(n: int = 10_000) -> dict[str, Job]:
    """Run the ladder and read one current, compared with the same ladder by hand, which keeps its integrator."""
    compiled = acausal.compile(RCLadder(n=n))
    experiment = compiled.flat.experiment
    tolerance = SMOOTH_FRACTION * experiment.tolerance
    x, none = ca.SX.sym("x", n), ca.SX(0, 1)
    ode = ca.vertcat(1.0, x[:-1]) - x - (x - ca.vertcat(x[1:], x[-1]))
    arguments = [ca.SX.sym("t"), x, ca.SX.sym("z", 0), ca.SX.sym("p", 0), ca.SX.sym("u", 0)]
    dae = ca.Function(
        "dae", arguments, [ode, none, none, none], ["t", "x", "z", "p", "u"], ["ode", "alg", "quad", "zero"]
    )
    grid = np.linspace(0.0, experiment.stop_time, 501)[1:]
    rate = np.zeros(n)
    rate[0] = 1.0
    settings: dict[str, Any] = {
        "reltol": tolerance,
        "abstol": 1e-3 * tolerance,
        "calc_ic": False,
        "init_xdot": rate.tolist(),
    }
    settings |= {"max_num_steps": 10**6, "linear_solver": "qr"}  # the faster one here
    integrator = Kept(ca.integrator("by_hand", "idas", dae, 0.0, grid.tolist(), settings))

    def ours() -> float:
        r = acausal.simulate(compiled)
        return float(r["source.i"][-1]) + float(r["resistors[7].i"][-1])

    def by_hand() -> float:
        (v, _), _ = integrator({"x0": np.zeros(n)}, ("xf", "zf"))
        source, seventh = v[:, 0] - 1.0, v[:, 6] - v[:, 7]
        return float(source[-1] + seventh[-1])

    return {"acausal": ours, "CasADi by hand": by_hand}


# A row of ThinPlate at which the drill cuts; the loop prints the same one.
ROW = 200
LOOP = """
#include <stdio.h>
#include <math.h>
#include <time.h>
static double s[10001], F[10001], M[10001];
int main(void) {
  volatile double v = %(v).17g, n = %(n).17g; int i;
  const double slope = tan(%(sigma).17g / 2), d = %(d).17g, t = %(t).17g, h = d / (2 * slope), dt = 1e-3;
  for (int r = 0; r < 20; ++r) {
    struct timespec a, b; clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
    double x = 0, k1, k2;
    for (i = 0; i <= 10000; ++i) {
      double outer = 2 * slope * fmin(fmax(x, 0), h), inner = 2 * slope * fmin(fmax(x - t, 0), h);
      double f = v / (%(z_E).17g * n), thick = fmax(f * sin(%(sigma).17g / 2), %(h_min).17g);
      double k_c = %(k_c11).17g * pow(thick / 1e-3, -%(z).17g);
      double F_c = %(z_E).17g * (outer - inner) / 2 * f * k_c;
      s[i] = x; F[i] = %(factor).17g * F_c; M[i] = F_c * (outer + inner) / 4;
      k1 = v; k2 = v; x += dt / 2 * (k1 + k2);
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
    printf("%%.9g\\n", (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec));
  }
  printf("%%.15g\\n", F[200] + 0 * M[200] + 0 * s[200]); return 0;
}
"""


def plate(rounds: int) -> dict[str, Any]:
    """ThinPlate with its force and torque at 10 001 rows, beside a C loop that computes the same rows."""
    compiled = acausal.compile(ThinPlate())
    r = acausal.simulate(compiled, native=True, output_interval=1e-3)

    def ours() -> float:
        r = acausal.simulate(compiled, native=True, output_interval=1e-3)
        return float((r["drill.F_f"] + 0.0 * r["drill.torque"])[ROW])

    names = ("sigma", "d", "t", "z_E", "k_c11", "h_min", "z")
    numbers = {name: float(r.final(f"drill.{name}")) for name in names}
    numbers |= {"v": float(r.final("drill.v_axial")), "n": abs(float(r.final("drill.n")))}
    numbers["factor"] = float(r["drill.F_f"][ROW]) / float(r["drill.F_c"][ROW])
    seconds: dict[str, list[float]] = {"acausal": [], "C by hand": []}
    force = other = 0.0
    with tempfile.TemporaryDirectory() as folder:
        source, binary = Path(folder) / "loop.c", Path(folder) / "loop"
        source.write_text(LOOP % numbers)
        subprocess.run(["cc", "-O2", "-o", binary, source, "-lm"], check=True)
        ours()
        for _ in range(rounds):
            began = time.process_time()
            force = ours()
            seconds["acausal"].append(time.process_time() - began)
            told = subprocess.run([binary], capture_output=True, text=True, check=True).stdout
            *each, other = map(float, told.split())
            seconds["C by hand"].append(float(np.median(each)))
    answers = {"acausal": force, "C by hand": other}
    return {"seconds": medians(seconds), "ratios": ratios(seconds, "acausal"), "answers": answers}


# -- many runs -----------------------------------------------------------------------------------------------------


def runs() -> dict[str, Job]:
    """One of many runs of ThickBlock with different masses; CasADi by hand keeps its integrators."""
    compiled, hand = acausal.compile(ThickBlock()), thick_block_vs_casadi.by_hand()
    made: dict[float, Any] = {}
    masses = iter(np.linspace(4.9, 5.1, 100_000))

    def ours(solver: str, native: bool) -> float:
        given = {"m": float(next(masses))}
        r = acausal.simulate(compiled, parameters=given, tolerance=TOLERANCE, solver=solver, native=native)
        return float(r["drill.s"][-1]) + 0.0 * float(r["drill.F_f"][-1])

    def by_hand() -> float:
        return float(hand.solve(0.1, 0.1 * TOLERANCE, made)[1][0, -1])

    return {
        "acausal, rosenbrock compiled": lambda: ours("rosenbrock", True),
        "acausal, idas": lambda: ours("idas", False),
        "CasADi idas by hand, integrators kept": by_hand,
    }


@cache
def rows() -> dict[str, Callable[[], dict[str, Job]]]:
    """The rows by name."""
    return {
        "clutches 10": lambda: clutches(10),
        "clutches 100": lambda: clutches(100),
        "converter": converter,
        "balls": balls,
        "reading": reading,
        "runs": runs,
    }


def main() -> None:
    """Run what is asked for, print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--only", nargs="*", choices=(*rows(), "plate"), default=(*rows(), "plate"))
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    record: dict[str, Any] = {}
    for name in given.only:
        if name == "plate":
            record[name] = plate(given.rounds)
        else:
            seconds, answers = in_turn(rows()[name](), given.rounds)
            first = next(iter(seconds))
            record[name] = {"seconds": medians(seconds), "ratios": ratios(seconds, first), "answers": answers}
        sides = "  ".join(f"{side} {1e3 * s:.2f} ms" for side, s in record[name]["seconds"].items())
        print(f"{name:14}{sides}   answers {list(record[name]['answers'].values())}", flush=True)
    report("rows that were not looked at first", f"{len(record)} rows above", rounded(record))


if __name__ == "__main__":
    main()
