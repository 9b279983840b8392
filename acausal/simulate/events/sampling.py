"""Instants of `sample(start, interval)`."""

from __future__ import annotations

import numpy as np

from acausal.analyse.events.state_events import Clause
from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.events.errors import not_a_clock


def clocks(compiled: CompiledModel, p: Vector) -> list[tuple[float, float]]:
    """Start and interval of each sample [s]."""
    pool = compiled.solution.structure.reduced.pool
    leaves = {"par": p.__getitem__, "time": lambda _: 0.0}
    found = []
    for number in compiled.state_events.samples:
        _, a, b = pool.nodes[number]
        known = values(pool, [a, b], leaves)
        first, interval = float(known[a]), float(known[b])
        if not (np.isfinite(first) and 0.0 < interval < np.inf):
            raise not_a_clock(compiled.name, first, interval, users(compiled, number))
        found.append((first, interval))
    return found


def users(compiled: CompiledModel, sample: int) -> list[Clause]:
    """Clauses whose condition holds a sample."""
    pool = compiled.solution.structure.reduced.pool
    return [c for c in compiled.state_events.clauses if sample in pool.reachable(c.conditions)]


def sample_times(compiled: CompiledModel, p: Vector, start: float, stop: float) -> Vector:
    """All instants of samples between two times."""
    found = [np.zeros(0)]
    for first, interval in clocks(compiled, p):
        k = np.arange(
            max(0.0, np.ceil((start - first) / interval - 1e-9)), np.floor((stop - first) / interval + 1e-9) + 1
        )
        found.append(first + interval * k)
    return np.concatenate(found)


def due(compiled: CompiledModel, p: Vector, times: Vector) -> Vector:
    """Which samples are true at n instants, shape (n, samples)."""
    found = np.zeros((len(times), len(compiled.state_events.samples)))
    for k, (first, interval) in enumerate(clocks(compiled, p)):
        turns = (times - first) / interval
        found[:, k] = (np.abs(turns - np.round(turns)) <= 1e-9) & (np.round(turns) >= 0)
    return found
