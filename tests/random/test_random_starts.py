"""Starts taken from one consistent point of a model: as many of them as one likes, in any order.

The law: what is found holds every `fixed`; it is that point where the starts given determine it; and permuting
declarations changes nothing, however few are given. Where one order has constraints that are stabilised and the other
has not, they may differ (docs/known-gaps.md).
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import Component, fixed, guess
from acausal.errors import AcausalError
from acausal.lower.compiled import CompiledModel
from tests.marks import seeds, slow_but
from tests.random.start_models import SIGNALS, circuit, pendulum, pendulum_point, random_circuit

Vector = NDArray[np.float64]


def started(model: Component | CompiledModel, names: Sequence[str], **start: float) -> Vector:
    """Values at the start, shape (n,)."""
    result = acausal.simulate(model, stop_time=1e-9, start=start, solver="rosenbrock")
    return np.array([result[n][0] for n in names])


def wrong_circuit(seed: int, trials: int = 4) -> list[str]:
    """What breaks the law on one random circuit."""
    r = random.Random(seed)
    elements = random_circuit(r)
    order = list(range(len(elements)))
    names = [f"e{k}.{f}" for k in order for f in "vi"]
    try:
        bare = acausal.compile(circuit(elements, order, {}))
        states = bare.states
        if not states:
            return []
        base = started(bare, names, **dict.fromkeys(states, 0.0))
        # circuits are linear: values at the start are base + slope @ states
        unit = [{s: float(s == own) for s in states} for own in states]
        slope = np.array([started(bare, names, **u) - base for u in unit]).T
    except AcausalError:
        return []  # sources in a loop
    point = base + slope @ [round(r.uniform(-2.0, 2.0), 3) for _ in states]
    found = []
    for _ in range(trials):
        share = r.choice([0.2, 0.4, 0.7])
        given = [k for k in range(len(names)) if r.random() < share]
        starts: dict[str, Any] = {names[k]: fixed(float(point[k])) for k in given}
        for k in set(range(len(names))) - set(given):
            if r.random() < 0.3:
                starts[names[k]] = guess(float(point[k]) + r.choice([0.0, 1.0]) * r.uniform(-1.0, 1.0))
        reached = []
        for _ in range(2):
            try:
                reached.append(started(circuit(elements, order, starts), names))
            except AcausalError as error:
                found.append(f"circuit {seed}: {str(error)[:200]}")
            order = r.sample(order, len(order))
            starts = {n: starts[n] for n in r.sample(list(starts), len(starts))}
        determined = np.linalg.matrix_rank(slope[given], tol=1e-9) == len(states)
        for values in reached:
            off = np.abs(values - point)
            if off[given].max(initial=0.0) > 1e-6 or (determined and off.max() > 1e-6):
                found.append(f"circuit {seed}: off by {off.max():g}")
            if np.abs(values - reached[0]).max() > 1e-6:
                found.append(f"circuit {seed}: the order of declaration makes {np.abs(values - reached[0]).max():g}")
    return found


def wrong_pendulum(seed: int) -> list[str]:
    """The same on a double pendulum in angles and coordinates; guesses of the others are near."""
    r = random.Random(seed)
    own = [r.uniform(-1.2, 1.2), r.uniform(-1.2, 1.2), r.uniform(-2.0, 2.0), r.uniform(-2.0, 2.0)]
    point = pendulum_point(*own)
    values = np.array(list(point.values()))
    share = r.choice([0.2, 0.4, 0.7])
    given = [n for n in SIGNALS if r.random() < share]
    starts = {n: fixed(point[n]) if n in given else guess(point[n] + r.uniform(-0.03, 0.03)) for n in SIGNALS}
    order = [*SIGNALS, "f1", "f2"]
    reached, bound = [], set()
    for _ in range(2):
        try:
            model = acausal.compile(pendulum(order, starts))
            bound.add(len(model.solution.structure.invariants))
            reached.append(started(model, SIGNALS))
        except AcausalError as error:
            return [f"pendulum {seed}: {str(error)[:200]}"]
        r.shuffle(order)
    places = [SIGNALS.index(n) for n in given]
    off = max(float(np.abs(v - values)[places].max(initial=0.0)) for v in reached)
    away = max(float(np.abs(v - values).max()) for v in reached)
    apart = float(np.abs(reached[0] - reached[1]).max()) if len(bound) == 1 else 0.0
    slope = np.array([_values(own, k, 1e-6) - _values(own, k, -1e-6) for k in range(4)]).T / 2e-6
    sizes = np.linalg.svd(slope[places], compute_uv=False)
    determined = len(sizes) == 4 and sizes[-1] > 0.05
    if off > 1e-6 or apart > 1e-5 or (determined and away > 1e-5):
        return [f"pendulum {seed}: off by {off:g}, away by {away:g}, {apart:g} by order"]
    return []


def _values(own: Sequence[float], k: int, more: float) -> Vector:
    """All variables of the pendulum with one of its four coordinates moved."""
    return np.array(list(pendulum_point(*(v + more * (j == k) for j, v in enumerate(own))).values()))


@pytest.mark.parametrize("seed", slow_but([0, 4, 5, 17, 37, 124, 208, 251], 5, 37, 208))
def test_circuits(seed: int) -> None:
    """37 held a fixed start by 0.9 A less, without a word; 5, 17 were contradictions; 4, 208, 251 went by order."""
    assert not wrong_circuit(seed)


@pytest.mark.parametrize("seed", range(6))
def test_pendulums(seed: int) -> None:
    assert not wrong_pendulum(seed)


@pytest.mark.parametrize("seed", [64, 85])
def test_guesses_that_cannot_be_kept_are_met_best(seed: int) -> None:
    """Where the energy alone is given (85), angles and rates at their guesses contradict it, and the order decided."""
    assert not wrong_pendulum(seed)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [wrong_circuit, wrong_pendulum], ids=["circuits", "pendulums"])
def test_random_starts(kind: Callable[[int], list[str]]) -> None:
    assert not [text for seed in seeds("0:36")[0] for text in kind(seed)]
