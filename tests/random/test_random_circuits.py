"""Random circuits with one to five ideal diodes, thyristors and switches against their exact solutions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import acausal
from tests.marks import seeds
from tests.random.circuit_judge import ROWS, built, judged
from tests.random.switched_circuits import Discard, exact, random_circuit


def failures(seeds: range, *solvers: str) -> list[str]:
    """What goes wrong with these seeds, one sentence each; and that there were circuits to try."""
    found, tried = [], 0
    for seed in seeds:
        circuit = random_circuit(seed)
        try:
            truth = exact(circuit, ROWS)
        except Discard:
            continue
        tried += 1
        compiled = acausal.compile(built(circuit))
        for solver in solvers:
            wrong = judged(circuit, compiled, truth, solver)
            if wrong is not None:
                found.append(f"seed {seed}, {solver}: {wrong}")
    assert tried >= len(seeds) // 3
    return found


def test_a_few_circuits() -> None:
    assert not failures(range(4), "auto", "idas")


@pytest.mark.parametrize(
    ("seed", "solver"),
    [(k, "auto") for k in (213, 365, 419, 486)] + [(k, "idas") for k in (211, 292, 365)] + [(211, "cvodes")],
)
def test_instants_that_are_found_early_or_late(seed: int, solver: str) -> None:
    """Diodes of 1e-5 ohm at their zero crossing: one mode holds nanoseconds more, or begins late.

    In 211 a capacitor discharges through one in a nanosecond, and both diodes beside it rest on zero from then on.
    """
    assert not failures(range(seed, seed + 1), solver)


def instants_without_resistance() -> list[float]:
    """Events of circuit 17 before 0.05 s with diodes of no resistance [s], in closed form.

    The source is u = -5 sin(w t + 1). Through two opposite diodes it acts on an inductor, whose current is the integral
    of u from 0 and changes sign where that is zero. Through a third it charges a capacitor beside a resistor, from the
    zero of u until that current is zero; what remains discharges (a blocking diode has 1e-3 or 1e-5 S) until the
    fourth, across it, conducts.
    """
    w, period = 100.0 * np.pi, 0.02
    rises = (np.pi - 1.0) / w
    charge, load, leak = 1e-4, 1.0 / 33.0 + 1e-5, 1e-3
    blocks = rises + (np.pi / 2.0 + np.arctan(load / (w * charge))) / w

    def remaining(t: float) -> float:
        """Of C v' = leak u - (leak + load) v from v = u at `blocks`."""
        rate = (leak + load) / charge
        steady = -5.0 * leak / charge / complex(rate, w) * np.exp(1j * (w * np.array([t, blocks]) + 1.0))
        at_first = -5.0 * np.sin(w * blocks + 1.0) - steady[1].imag
        return float(steady[0].imag + at_first * np.exp(-rate * (t - blocks)))

    empty = brentq(remaining, blocks, rises + period, xtol=1e-15)
    each = [rises, 2.0 * rises, float(blocks), period, empty]
    return sorted(t + k * period for t in each for k in range(3) if t + k * period < 0.05)


def test_events_of_tiny_resistances_are_listed_once() -> None:
    """With 1e-7 ohm d1 was listed six times at one zero crossing of the source.

    Its mode was kept for a moment more, as the instant was found early: five of six changed nothing. 1e-7 ohm change
    the instants by 1e-8 s. The exact solution by matrices does not know them: a current through 1e-5 ohm is the
    difference of voltages, and its zero was 2e-6 s off.
    """
    circuit = random_circuit(17)
    branches = tuple(replace(b, values=(1e-7, *b.values[1:])) if b.kind == "diode" else b for b in circuit.branches)
    circuit = replace(circuit, branches=branches)
    r = acausal.simulate(built(circuit), stop_time=circuit.stop, output_interval=circuit.stop / ROWS, tolerance=1e-8)
    found = [(e.time, name) for e in r.events for name in e.condition.split("; ")]
    expected = np.array(instants_without_resistance())
    for t in expected:
        names = [name for time, name in found if abs(time - t) < 1e-7]
        assert names
        assert len(names) == len(set(names))
    assert all(np.abs(expected - time).min() < 1e-7 for time, _ in found)


# Pieces of seeds, each with all solvers: the exact solution and the compiled circuit are made once for all of them.
@pytest.mark.slow
@pytest.mark.parametrize("part", seeds("0:210", 3), ids=str)
def test_100_circuits(part: range) -> None:
    """About half of them are drawn again as their exact solution is not sure."""
    assert not failures(part, "idas", "rosenbrock")  # "auto" is one of them
