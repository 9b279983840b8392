"""Claim: compile time grows linearly with the model, and the solve costs the same as the hand-written reduced system.

Three families from library components: the RC ladder, the chain of masses with springs and dampers, the chain of hinged
links in three dimensions. Every size is compiled in a fresh process, after a model of two elements has loaded all code,
so that its memory can be measured. The first run makes the functions that later runs share; the solve is a later run.

The solve is compared with the same ladder or chain written by hand as its reduced ODE in CasADi, integrated by the same
IDAS at the tolerance that acausal passes to it, to the same 500 output times, with results read without copies as
acausal reads them. Both are timed in turn; chains and ladders therefore run with IDAS, and "default" is a run with the
solver that the program selects. The hand-written side makes its integrator once and keeps it: its time is that of
stepping and of one column; that of acausal is a whole `simulate` of the compiled model and the reading of one signal
that is not a state.

Times are seconds of processor time of the process, which equal wall time on an idle machine; goals are judged by them.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

SIZES = {"chain": (20, 400, 5000), "ladder": (1000, 4000, 10_000, 100_000), "pendulum": (4, 16, 64)}
QUICK = {"chain": (20, 400), "ladder": (1000,), "pendulum": (4, 16)}
# Largest seconds for creating and compiling.
GOALS = {
    ("chain", 20): 0.1,
    ("chain", 400): 1.0,
    ("ladder", 1000): 1.0,
    ("ladder", 10_000): 12.0,
    ("ladder", 100_000): 60.0,
    ("pendulum", 4): 0.3,
    ("pendulum", 16): 1.2,
}
RATIO, EXPONENT, MEMORY = 1.3, 1.05, 3000.0


@dataclass
class Stop:
    """Stopwatch of processor and wall time since its creation."""

    def __post_init__(self) -> None:
        self.processor, self.wall = time.process_time(), time.perf_counter()

    def read(self) -> dict[str, float]:
        """Seconds since the creation."""
        return {"cpu": time.process_time() - self.processor, "wall": time.perf_counter() - self.wall}


def peak() -> float:
    """Largest resident size of this process so far, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)


def model_of(family: str, n: int) -> Any:
    """A model of the family."""
    from acausal.models.mass_chain import MassSpringDamperChain
    from acausal.models.pendulum_chain import PendulumChain
    from acausal.models.rc_ladder import RCLadder

    return {"chain": MassSpringDamperChain, "ladder": RCLadder, "pendulum": PendulumChain}[family](n=n)


def measured(family: str, n: int, repetitions: int) -> dict[str, Any]:
    """All measurements of one size; to be called once per process."""
    import acausal

    acausal.simulate(model_of(family, 2)).final("time")
    empty = peak()
    stop = Stop()
    model = model_of(family, n)
    making = stop.read()
    stop = Stop()
    compiled = acausal.compile(model)
    compiling = stop.read()
    memory = {"before": empty, "compiled": peak()}
    stop = Stop()
    result = acausal.simulate(compiled)
    first = stop.read()
    stop = Stop()
    observed = {"chain": "springs[0].f", "ladder": "source.i", "pendulum": "links[0].frame_b.r_0[0]"}[family]
    result.final(observed)
    first_signal = stop.read()
    memory["run"] = peak()
    found: dict[str, Any] = {
        "equations": len(compiled.flat.equations),
        "states": len(compiled.states),
        "algebraic": len(compiled.algebraic),
        "make": making,
        "compile": compiling,
        "stages (wall)": dict(compiled.timings),
        "first run": first,
        "first signal": first_signal,
        "memory MB": memory,
        "steps": result.stats.get("steps"),
    }
    hand = by_hand(family, n, compiled)
    same: dict[str, Any] = {} if hand is None else {"solver": "idas"}
    jobs: dict[str, Callable[[], Any]] = {
        "acausal": lambda: (acausal.simulate(compiled, **same)[observed], None)[1],
        "default": lambda: (acausal.simulate(compiled)[observed], None)[1],
    }
    if hand is not None:
        jobs["by hand"] = hand
    times, stepping = alternated(jobs, repetitions)
    found["solve"] = times
    if hand is not None:
        found["stepping"] = stepping
        found["ratio"] = times["acausal"] / times["by hand"]
    found["default solver"] = result.stats["solver"]
    return found


def alternated(jobs: Mapping[str, Callable[[], Any]], repetitions: int) -> tuple[dict[str, float], float]:
    """Median processor seconds of every job, run in turn, and of the stepping time reported by one of them."""
    whole: dict[str, list[float]] = {name: [] for name in jobs}
    inner: list[float] = []
    for k in range(repetitions + 1):
        for name, job in jobs.items():
            gc.collect()
            stop = Stop()
            answer = job()
            spent = stop.read()["cpu"]
            if k:
                whole[name].append(spent)
                if isinstance(answer, float):
                    inner.append(answer)
    return {name: statistics.median(v) for name, v in whole.items()}, statistics.median(inner or [0.0])


def by_hand(family: str, n: int, compiled: Any) -> Callable[[], float] | None:
    """The reduced system as typically written for CasADi; a call integrates it and returns the seconds of stepping."""
    import casadi as ca
    import numpy as np

    from acausal.simulate.equations.calls.raw import Kept
    from acausal.simulate.options import options
    from acausal.simulate.solvers.base import SMOOTH_FRACTION

    if family == "pendulum":
        return None
    opts = options(compiled.flat.experiment)
    grid = (opts.grid() - opts.start_time)[1:].tolist()
    x0, p, ode_of = (ladder if family == "ladder" else chain)(n)

    x, parameters = ca.SX.sym("x", len(x0)), ca.SX.sym("p", len(p))
    none = ca.SX(0, 1)
    arguments = [ca.SX.sym("t"), x, ca.SX.sym("z", 0), parameters, ca.SX.sym("u", 0)]
    results = [ode_of(x, parameters), none, none, none]
    dae = ca.Function("dae", arguments, results, ["t", "x", "z", "p", "u"], ["ode", "alg", "quad", "zero"])
    settings = {
        "reltol": SMOOTH_FRACTION * opts.tolerance,
        "abstol": SMOOTH_FRACTION * opts.tolerance * opts.absolute_factor,
        "calc_ic": False,
        "init_xdot": np.array(dae(0.0, x0, [], p, [])[0]).ravel().tolist(),
        "max_num_steps": 10**6,
    }

    def runner(linear: str) -> Callable[[], float]:
        integrator = Kept(ca.integrator("byhand", "idas", dae, 0.0, grid, {**settings, "linear_solver": linear}))

        def run() -> float:
            began = time.process_time()
            (trajectories, _), _ = integrator({"x0": x0, "p": p}, ("xf", "zf"))
            assert np.isfinite(trajectories).all(), "the hand-written system did not integrate"
            return time.process_time() - began

        return run

    # A program by hand would use the faster one; which one that is depends on the size.
    return min(map(runner, ("qr", "csparse")), key=lambda run: min(run() for _ in range(3)))


def ladder(n: int) -> tuple[Any, Any, Callable[[Any, Any], Any]]:
    """C*dv[k]/dt = (v[k-1] - 2*v[k] + v[k+1])/R with V before the first section, nothing after the last."""
    import casadi as ca
    import numpy as np

    def ode(v: Any, p: Any) -> Any:
        before, behind = ca.vertcat(p[2], v[:-1]), ca.vertcat(v[1:], v[-1])
        return ((before - v) / p[0] - (v - behind) / p[0]) / p[1]

    return np.zeros(n), np.ones(3), ode


def chain(n: int) -> tuple[Any, Any, Callable[[Any, Any], Any]]:
    """m*a[k] = c*(s[k-1] - 2*s[k] + s[k+1]) + d*(v[k-1] - 2*v[k] + v[k+1]), wall before the first."""
    import casadi as ca
    import numpy as np

    def ode(x: Any, p: Any) -> Any:
        s, v = x[:n], x[n:]
        force = p[1] * (ca.vertcat(0.0, s[:-1]) - s) + p[2] * (ca.vertcat(0.0, v[:-1]) - v)
        return ca.vertcat(v, (force - ca.vertcat(force[1:], 0.0)) / p[0])

    return np.concatenate([[0.1], np.zeros(2 * n - 1)]), np.array([1.0, 100.0, 1.0]), ode


def row(family: str, n: int, r: Mapping[str, Any]) -> str:
    """One readable line."""
    whole, wall = (r["make"][kind] + r["compile"][kind] for kind in ("cpu", "wall"))
    goal = GOALS.get((family, n))
    judged = "" if goal is None else f" (goal {goal:g}: {'met' if whole <= goal else 'MISSED'})"
    stages = " ".join(f"{k} {v:.2f}" for k, v in r["stages (wall)"].items())
    text = (
        f"{family:8} {n:6}  {r['equations']:7} equations {r['states']:6} states {r['algebraic']} algebraic  "
        f"make {r['make']['cpu']:.3f} compile {r['compile']['cpu']:.3f}, both {whole:.3f}{judged}, "
        f"wall {wall:.3f} s  [{stages}]  "
        f"first run {r['first run']['cpu']:.3f}, first signal {r['first signal']['cpu']:.3f}, "
        f"solve {r['solve']['acausal']:.4f} s (default, {r['default solver']}: {r['solve']['default']:.4f})  "
        f"memory {r['memory MB']['compiled']:.0f} / {r['memory MB']['run']:.0f} MB"
    )
    if "ratio" in r:
        text += (
            f"  by hand {r['solve']['by hand']:.4f} (stepping {r['stepping']:.4f}), "
            f"ratio {r['ratio']:.2f} (goal {RATIO:g})"
        )
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="leave out what takes more than a few seconds")
    parser.add_argument("--only", nargs="*", choices=tuple(SIZES), default=tuple(SIZES))
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--case", nargs=2, metavar=("FAMILY", "N"), help="one size, in this process")
    given = parser.parse_args()
    if given.case:
        print(json.dumps(measured(given.case[0], int(given.case[1]), given.repetitions)))
        return
    from measure import report, rounded

    record: dict[str, Any] = {}
    for family in given.only:
        for n in (QUICK if given.quick else SIZES)[family]:
            repetitions = given.repetitions if n <= 10_000 else 2
            command = [sys.executable, __file__, "--case", family, str(n), "--repetitions", str(repetitions)]
            answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            record[f"{family} {n}"] = json.loads(answer)
            print(row(family, n, record[f"{family} {n}"]), flush=True)
    closing = "every goal is in the lines above"
    one, ten, largest = (record.get(f"ladder {n}") for n in (1000, 10_000, 100_000))
    grown = [(a, b) for a, b in ((one, ten), (ten, largest)) if a and b]
    if grown:
        exponents = [math.log10(b["compile"]["cpu"] / a["compile"]["cpu"]) for a, b in grown]
        told = ", ".join(f"{e:.2f}" for e in exponents)
        closing = f"exponents of compiling a ladder from 1000 to 10 000 sections and on: {told} (goal {EXPONENT:g})"
        record["exponents from 1000 on"] = exponents
    if largest:
        peak_of_it = largest["memory MB"]["compiled"]
        closing += f"; peak with 100 000 {peak_of_it:.0f} MB ({'met' if peak_of_it <= MEMORY else 'MISSED'})"
    report("size", closing, rounded(record))


if __name__ == "__main__":
    main()
