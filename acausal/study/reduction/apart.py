"""Islands: parts of a model that share no state and no unknown, and can be solved each with its own steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.flatten.connections.connections import UnionFind
from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel
from acausal.reduce.cone import dependence, restrict
from acausal.reduce.outputs import output_scalars
from acausal.result.result import Result, Signal
from acausal.simulate.run import simulate

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Island:
    """Outputs, and the states behind them that no other output needs."""

    outputs: tuple[str, ...]
    states: tuple[str, ...]


def islands(compiled: CompiledModel, outputs: Sequence[str]) -> tuple[Island, ...]:
    """Groups of outputs by the states and unknowns they depend on; outputs without any are in none.

    Models with events are one island: what happens in one part of them stops the run of all.
    """
    solution = compiled.solution
    reduced = solution.structure.reduced
    depends = dependence(solution)
    dynamic = {*solution.structure.states, *solution.algebraic}
    behind: dict[str, frozenset[int]] = {}
    for name, scalar in output_scalars(reduced.flat, outputs).items():
        found = depends.closure(solution, reduced.pool.variables_in(reduced.image[scalar])) & dynamic
        if found:
            behind[name] = frozenset(found)
    names = list(behind)
    sets = UnionFind(len(names))
    owner: dict[int, int] = {}
    for k, name in enumerate(names):
        for v in behind[name]:
            sets.union(k, owner.setdefault(v, k))
    if compiled.state_events.clauses:
        for k in range(1, len(names)):
            sets.union(0, k)
    groups: dict[int, list[str]] = {}
    for k, name in enumerate(names):
        groups.setdefault(sets.find(k), []).append(name)
    found_islands = []
    for group in groups.values():
        own = frozenset().union(*(behind[name] for name in group))
        states = tuple(reduced.name(x) for x in solution.structure.states if x in own)
        found_islands.append(Island(tuple(group), states))
    return tuple(found_islands)


def simulate_apart(compiled: CompiledModel, parts: Sequence[Island], options: Mapping[str, Any]) -> Result:
    """A run of every island by itself, put together; one run when there is one island only."""
    if len(parts) < 2:
        return simulate(compiled, **options)
    flat = compiled.flat
    results = []
    for part in parts:
        own = restrict(compiled.solution, tuple(output_scalars(flat, part.outputs).values()))
        results.append(simulate(replace(lower(own), selection=compiled.selection), **options))
    return _joined(results)


def _joined(results: Sequence[Result]) -> Result:
    """One result at all times of all runs; a time at which one of them has an event occurs twice."""
    time = _union([r.time for r in results])
    columns: list[Vector] = []
    signals: dict[str, Signal] = {}
    for result in results:
        rows = np.empty((len(time), result.matrix.shape[1]))
        for k, row in enumerate(_rows(result, time)):
            rows[k] = row
        first = sum(c.shape[1] for c in columns)
        columns.append(rows)
        for name, signal in result.signals.items():
            moved = signal if signal.column is None else replace(signal, column=signal.column + first)
            if name not in signals or signal.column is not None:
                signals[name] = moved
    stats = {**results[0].stats, "islands": [dict(r.stats) for r in results]}
    events = tuple(sorted((e for r in results for e in r.events), key=lambda e: e.time))
    return Result(results[0].model, time, np.hstack(columns), signals, events, stats)


def _union(times: Sequence[Vector]) -> Vector:
    """All times, each as often as it occurs in the run in which it occurs most."""
    most: dict[float, int] = {}
    for one in times:
        values, count = np.unique(one, return_counts=True)
        for t, n in zip(values.tolist(), count.tolist(), strict=True):
            most[t] = max(most.get(t, 0), n)
    return np.array([t for t in sorted(most) for _ in range(most[t])])


def _rows(result: Result, time: Vector) -> list[Vector]:
    """Rows of a result at times that contain its own."""
    found = []
    k = -1
    for i, t in enumerate(time):
        if k + 1 < len(result.time) and result.time[k + 1] == t:
            k += 1
            found.append(result.matrix[k])
        elif k >= 0 and result.time[k] == t:
            found.append(result.matrix[k])
        else:
            assert result.dense is not None, "a run just made can be asked at any time"
            found.append(result.dense(np.array([time[i]]))[0])
    return found
