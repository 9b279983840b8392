"""Claim: ThinPlate, 10 s in 10 000 RK2 steps of 1 ms, solves in less than 5 ms, interpreted.

A whole call of `simulate` is compared with a single call of a hand-written CasADi function of the same method on the
same two states, which checks neither contacts nor events. Processor times, in turn.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import casadi as ca
import numpy as np
from measure import alternated, medians, ratios, report, rounded

import acausal
from acausal.models.drilling_kinematic import ThinPlate

LIMIT, STEPS, STEP = 5e-3, 10_000, 1e-3
PER_CALL = 20


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
    rates = np.array([1.672e-3, 2 * math.pi * 9.28])
    jobs = {
        "simulate": lambda: acausal.simulate(compiled, native=False),
        "by hand": lambda: np.array(hand(np.zeros(2), rates)),
    }
    seconds = alternated(jobs, args.repetitions)
    middle, slower = medians(seconds), ratios(seconds, "simulate")["by hand"]
    run = acausal.simulate(compiled, native=False)
    met = middle["simulate"] < LIMIT
    report(
        f"ThinPlate at 1 ms RK2, 10 s, solves in less than {1e3 * LIMIT:.0f} ms",
        f"a run {1e3 * middle['simulate']:.1f} ms ({'met' if met else 'MISSED'}), "
        f"steps alone by hand {1e3 * middle['by hand']:.2f} ms, ratio {slower:.0f}",
        rounded(
            {
                "met": met,
                "median seconds": middle,
                "ratio": slower,
                "stats": {k: run.stats[k] for k in ("solver", "steps", "states", "segments")},
                # s = v t
                "error of drill.s at 10 s in m": abs(float(run.final("drill.s")) - 1.672e-2),
                "repetitions": args.repetitions,
            }
        ),
    )


if __name__ == "__main__":
    main()
