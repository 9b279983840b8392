"""Claim: a sweep costs at most 1.2 times a plain loop of compiled runs, and scales linearly with its workers.

ThinPlate (10 000 RK2 steps of 1 ms, compiled to C) with many feed rates. The plain loop calls `simulate` of the
compiled model and reads one signal; the sweep does the same with one worker, two and so on, and stores all signals in a
file.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from measure import report, rounded

import acausal
from acausal.models.drilling_kinematic import ThinPlate

ALLOWED = 1.2
SIGNAL = "drill.F_f"


def clock() -> float:
    """Processor seconds of this process and of its finished children."""
    return sum(os.times()[:4])


def bare(feeds: np.ndarray) -> tuple[float, float, list[float]]:
    """Processor and wall seconds of a loop over compiled runs, and the largest force of each."""
    compiled = acausal.compile(ThinPlate())
    acausal.simulate(compiled, native=True)
    busy, began = clock(), time.perf_counter()
    largest = [
        float(acausal.simulate(compiled, parameters={"v": v}, native=True)[SIGNAL].max()) for v in feeds.tolist()
    ]
    return clock() - busy, time.perf_counter() - began, largest


def swept(feeds: np.ndarray, workers: int, file: Path) -> tuple[float, float, acausal.Sweep]:
    """Processor and wall seconds of the whole sweep."""
    busy, began = clock(), time.perf_counter()
    found = acausal.sweep(ThinPlate(), {"v": feeds}, signals=[SIGNAL], workers=workers, native=True, file=file)
    return clock() - busy, time.perf_counter() - began, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--members", type=int, default=10_000)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    feeds = np.linspace(1e-3, 2e-3, options.members)
    bare(feeds[:10])
    counts = [1, *(n for n in (2, 4, 8, 16) if n <= (os.cpu_count() or 1))]
    costs: dict[int, list[float]] = {n: [] for n in counts}
    speeds: dict[int, list[float]] = {n: [] for n in counts}
    each = 0.0
    for _ in range(options.repeat):
        busy, wall, largest = bare(feeds)
        each = busy / options.members
        for n in counts:
            with tempfile.TemporaryDirectory() as folder:
                own, seconds, found = swept(feeds, n, Path(folder) / "plates.sweep")
            costs[n].append(own / busy)
            speeds[n].append(wall / seconds)
            # A run has rows at its events in addition to those of the grid that all members of a sweep share.
            assert np.allclose(found[SIGNAL].max(axis=1), largest, rtol=1e-12, atol=0.0)
    cost, speed = ({n: statistics.median(r) for n, r in found.items()} for found in (costs, speeds))
    shares = ", ".join(f"{n} worker{'s' if n > 1 else ''} {cost[n]:.2f} ({speed[n]:.2f} times as fast)" for n in counts)
    report(
        f"a sweep of ThinPlate within {ALLOWED} of the bare compiled loop, linear in workers",
        f"{options.members} members, {1e3 * each:.2f} ms each in the bare loop; processor time by that: {shares}",
        rounded({"met": max(cost.values()) <= ALLOWED, "members": options.members, "cost": cost, "speed": speed}),
    )


if __name__ == "__main__":
    main()
