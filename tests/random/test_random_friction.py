"""Random networks with more friction elements than degrees of freedom against a plain complementarity simulator."""

from __future__ import annotations

import numpy as np
import pytest

from tests.marks import seeds
from tests.random.friction_judge import ROWS, judged
from tests.random.friction_networks import STOP, Discard, random_network, simulated


def failures(seeds: range, *solvers: str) -> list[str]:
    """What goes wrong with these seeds, one sentence each; and that there were networks to try."""
    found, tried = [], 0
    for seed in seeds:
        network = random_network(seed)
        try:
            speeds = simulated(network, np.linspace(0.0, STOP, ROWS + 1))
        except Discard:
            continue
        tried += 1
        for solver in solvers:
            wrong = judged(network, speeds, solver)
            if wrong is not None:
                found.append(f"seed {seed}, {solver}: {wrong}")
    assert tried >= 0.8 * len(seeds)
    return found


def test_a_few_networks() -> None:
    assert not failures(range(3), "auto")


@pytest.mark.slow
@pytest.mark.parametrize("part", seeds("0:90", 2), ids=str)
def test_networks(part: range) -> None:
    assert not failures(part, "auto")


@pytest.mark.slow
def test_other_solvers() -> None:
    assert not failures(range(300, 312), "rosenbrock", "cvodes", "erk")
