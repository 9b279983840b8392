"""Random circuits with one to five ideal diodes, thyristors and switches against their exact solutions."""

from __future__ import annotations

import pytest

import acausal
from tests.random.circuit_judge import ROWS, built, judged
from tests.random.switched_circuits import Discard, exact, random_circuit


def failures(seeds: range, solver: str) -> list[str]:
    """What goes wrong with these seeds, one sentence each; and that there were circuits to try."""
    found, tried = [], 0
    for seed in seeds:
        circuit = random_circuit(seed)
        try:
            truth = exact(circuit, ROWS)
        except Discard:
            continue
        tried += 1
        wrong = judged(circuit, acausal.compile(built(circuit)), truth, solver)
        if wrong is not None:
            found.append(f"seed {seed}, {solver}: {wrong}")
    assert tried >= len(seeds) // 3
    return found


@pytest.mark.parametrize("solver", ["auto", "idas"])
def test_a_few_circuits(solver: str) -> None:
    assert not failures(range(12), solver)


@pytest.mark.parametrize(
    ("seed", "solver"),
    [(k, "auto") for k in (213, 365, 419, 486)] + [(k, "idas") for k in (211, 292, 365)] + [(211, "cvodes")],
)
def test_instants_that_are_found_early_or_late(seed: int, solver: str) -> None:
    """Diodes of 1e-5 ohm at their zero crossing: one mode holds nanoseconds more, or begins late.

    In 211 a capacitor discharges through one in a nanosecond, and both diodes beside it rest on zero from then on.
    """
    assert not failures(range(seed, seed + 1), solver)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["auto", "idas", "rosenbrock"])
@pytest.mark.parametrize("first", [0, 130, 260, 390])
def test_250_circuits(solver: str, first: int) -> None:
    assert not failures(range(first, first + 130), solver)
