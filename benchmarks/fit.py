"""Cost of fitting k_c1.1 and z to three noisy data sets, in units of runs: 20 random steels and noises.

    python benchmarks/fit.py

Cutting forces of `ThinPlate` at three feed rates, 151 values each with a noise of 20 N; guesses 1.7 GPa and 0.3. "in
time" is the process time of the whole fit divided by that of one of its runs, after a first fit. "inside" counts the
true values within their 95 % intervals, of 20: 19 are expected, and fewer than 17 once in 60 times.
"""

from __future__ import annotations

import time

import numpy as np

import acausal
from acausal import Dataset
from acausal.lower.compiled import CompiledModel
from acausal.models.drilling_kinematic import ThinPlate

GUESS = {"drill.k_c11": 1.7e9, "drill.z": 0.3}
FEEDS = (0.8e-3, 1.672e-3, 3.5e-3)


def experiments(model: CompiledModel, truth: dict[str, float], seed: int) -> list[Dataset]:
    """Three runs with noise in place of measurements."""
    rng = np.random.default_rng(seed)
    found = []
    for v in FEEDS:
        run = acausal.simulate(model, parameters={"v": v, **truth}, stop_time=3.0, output_interval=0.02)
        force = run["drill.F_c"] + rng.normal(0.0, 20.0, len(run.time))
        found.append(Dataset({"drill.F_c": (run.time, force)}, parameters={"v": v}))
    return found


def one_run(model: CompiledModel) -> float:
    """Process time of one run of a fit [s], the mean of ten."""
    began = time.process_time()
    for _ in range(10):
        acausal.simulate(
            model, parameters={"v": FEEDS[0], **GUESS}, stop_time=3.0, output_interval=0.02, tolerance=1e-8
        )
    return (time.process_time() - began) / 10


def main() -> None:
    model = acausal.compile(ThinPlate())
    rng = np.random.default_rng(11)
    inside, rows = np.zeros(2, dtype=int), []
    acausal.fit(model, experiments(model, {}, 0), list(GUESS), parameters=GUESS)
    for seed in range(20):
        truth = {"drill.k_c11": float(rng.uniform(1.5e9, 2.8e9)), "drill.z": float(rng.uniform(0.15, 0.32))}
        data, run = experiments(model, truth, seed), one_run(model)
        began = time.process_time()
        found = acausal.fit(model, data, list(GUESS), parameters=GUESS)
        rows.append((found.runs, found.gradients, (time.process_time() - began) / run))
        true = np.array(list(truth.values()))
        inside += (found.interval[:, 0] <= true) & (true <= found.interval[:, 1])
    for name, values in zip(("runs", "differentiated", "in time"), np.array(rows).T, strict=True):
        print(f"{name:15} {values.min():5.1f} to {values.max():5.1f}, median {np.median(values):5.1f}")
    print(f"inside: k_c1.1 {inside[0]}, z {inside[1]} of 20")


if __name__ == "__main__":
    main()
