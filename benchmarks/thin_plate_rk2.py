"""Claim: ThinPlate, 10 s in 10 000 RK2 steps of 1 ms, solves in less than 5 ms, interpreted.

Three times stand side by side: the calls of the accumulated steps alone, the whole integration (which makes these
functions first and takes them apart afterwards), and a hand-written CasADi function of the same method on the same two
states, called only.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np
from measure import alternated, medians, report, rounded

import acausal
from acausal.models.drilling_kinematic import ThinPlate

LIMIT, STEPS, STEP = 5e-3, 10_000, 1e-3
PER_CALL = 20


@contextmanager
def calls_of(name: str, into: list[float]) -> Iterator[None]:
    """Add up the seconds spent in calls of the CasADi functions of this name."""
    original = ca.Function.__call__
    into.append(0.0)

    def timed(self: Any, *args: Any, **keywords: Any) -> Any:
        if self.name() != name:
            return original(self, *args, **keywords)
        began = time.perf_counter()
        found = original(self, *args, **keywords)
        into[-1] += time.perf_counter() - began
        return found

    ca.Function.__call__ = timed
    try:
        yield
    finally:
        ca.Function.__call__ = original


def by_hand() -> Any:
    """`steps(x0, rates) -> x`, all 500 points of the output grid, for depth and angle at given rates."""
    x, rates = ca.SX.sym("x", 2), ca.SX.sym("rates", 2)
    slope = ca.Function("slope", [x, rates], [rates])
    end: Any = x
    for _ in range(PER_CALL):
        k1 = slope(end, rates)
        k2 = slope(end + STEP * k1, rates)
        end = end + STEP / 2 * (k1 + k2)
    return ca.Function("steps", [x, rates], [end]).mapaccum("by_hand", STEPS // PER_CALL, 1, {"base": 4})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--repetitions", type=int, default=21)
    args = parser.parse_args()
    compiled, hand = acausal.compile(ThinPlate()), by_hand()
    inside: list[float] = []
    stages: list[dict[str, float]] = []

    def ours() -> None:
        with calls_of("run", inside):
            run = acausal.simulate(compiled)
        stages.append(run.stats["time"])  # type: ignore[arg-type]

    rates = np.array([1.672e-3, 2 * math.pi * 9.28])
    jobs = {"simulate": ours, "by hand, call": lambda: np.array(hand(np.zeros(2), rates))}
    seconds = alternated(jobs, args.repetitions)
    seconds["calls"] = inside[1:]
    for stage in ("initialize", "integrate"):
        seconds[stage] = [s[stage] for s in stages[1:]]
    middle = medians(seconds)
    run = acausal.simulate(compiled)
    depth = float(run.final("drill.s"))
    stats = {k: run.stats[k] for k in ("solver", "steps", "states", "segments")}
    report(
        f"ThinPlate at 1 ms RK2, 10 s, solves in less than {1e3 * LIMIT:.0f} ms",
        f"integration {1e3 * middle['integrate']:.1f} ms ({'met' if middle['integrate'] < LIMIT else 'MISSED'}), "
        f"CasADi calls {1e3 * middle['calls']:.2f} ms, by hand {1e3 * middle['by hand, call']:.2f} ms",
        rounded(
            {
                "met": {"calls": middle["calls"] < LIMIT, "integrate": middle["integrate"] < LIMIT},
                "median seconds": middle,
                "fastest": {name: min(values) for name, values in seconds.items()},
                "stats": stats,
                # s = v t
                "error of drill.s at 10 s in m": abs(depth - 1.672e-2),
                "repetitions": args.repetitions,
            }
        ),
    )


if __name__ == "__main__":
    main()
