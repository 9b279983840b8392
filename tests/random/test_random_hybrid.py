"""Random models of `when`s, samples and discrete equations with every driver of events, against the plain reference."""

from __future__ import annotations

import random

import numpy as np
import pytest

import acausal
from tests.marks import seeds
from tests.random.hybrid_judge import DRIVERS, built, expected, judged
from tests.random.hybrid_models import opened, random_model
from tests.random.hybrid_reference import Discard, Reference

INTERPRETED = ("rosenbrock", "erk", "idas", "cvodes", "step_function")


def failures(seeds: range, drivers: tuple[str, ...]) -> list[str]:
    """What goes wrong with these seeds, one sentence each; and that there were models to try."""
    found, tried = [], 0
    for seed in seeds:
        model = random_model(seed)
        try:
            run = expected(model)
        except Discard:
            continue
        tried += 1
        compiled = acausal.compile(built(model))
        for driver in drivers:
            wrong = judged(model, compiled, driver, run)
            if wrong is not None:
                found.append(f"seed {seed}, {driver}: {wrong}")
    assert tried >= len(seeds) // 5
    return found


def openings(seeds: range, drivers: tuple[str, ...]) -> list[str]:
    """What goes wrong where `initial()` sets the start: it is a start like any other, and no event."""
    found, tried = [], 0
    for seed in seeds:
        model = random_model(seed)
        text = opened(model, random.Random(seed))
        try:
            run = expected(model)
        except Discard:
            continue
        if text is None or isinstance(run, str):
            continue
        tried += 1
        compiled = acausal.compile(built(model, text))
        for driver in drivers:
            wrong = judged(model, compiled, driver, run)
            if wrong is not None:
                found.append(f"seed {seed}, {driver}: {wrong}\n{text}")
    assert tried >= len(seeds) // 50
    return found


def unsaid(seeds: range, h: float, methods: tuple[str, ...]) -> list[str]:
    """What steps of a size that divides no sample period make of these seeds before the first flag of a step.

    Their states are cubics: exact in "rk4"; the others place events to the square of the step.
    """
    found, compared = [], 0
    for seed in seeds:
        model = random_model(seed)
        try:
            if isinstance(expected(model), str):
                continue
        except Discard:
            continue
        compiled = acausal.compile(built(model))
        names = [f"x{i}" for i in range(len(model.states))] + [f"d{j}" for j in range(len(model.discretes))]
        for method in methods:
            step = acausal.step_function(compiled, h, method)
            flags = [k for k, name in enumerate(step.y.names) if name.startswith("step.") and name != "step.error"]
            places = [step.x.position(name) for name in names]
            rows: list[np.ndarray] = []
            x, p = np.array(step.x.start), np.array(step.p.start)
            while h * (len(rows) + 1) < model.stop:
                x, y = (np.asarray(v).ravel() for v in step.function(x, np.zeros(0), p))
                if y[flags].any():
                    break
                rows.append(x[places])
            run = Reference(model).result([h * (k + 1) for k in range(len(rows))])
            for t, row, *wanted in zip(run.times, rows, run.states, run.discretes, strict=True):
                compared += 1
                want, close = np.concatenate(wanted), 2e-5 if method == "rk4" else 30 * h * h
                near = min((abs(t - e) for e in run.events), default=1.0) < close
                if not near and not (np.abs(row - want) < close * (1 + np.abs(want))).all():
                    found.append(f"seed {seed}, {method}: {row} at {t:g}, must be {want}")
                    break
    assert compared > 5 * len(seeds)
    return found


def test_steps_off_the_grid_are_right_until_they_say_otherwise() -> None:
    assert not unsaid(range(5), 0.0137, ("rk4", "sdirk"))


def test_what_initial_sets_is_the_start() -> None:
    assert not openings(range(200), ("rosenbrock", "idas"))


@pytest.mark.slow
def test_what_initial_sets_is_the_start_of_many() -> None:
    assert not openings(range(200, 500), ("rosenbrock", "rosenbrock native", "idas", "erk", "step_function"))


def test_a_few_models() -> None:
    assert not failures(range(5), INTERPRETED)


# Pieces of seeds, each with all drivers: the reference and the compiled model are made once for all of them.
@pytest.mark.slow
@pytest.mark.parametrize("part", seeds("5:365", 3), ids=str)
def test_models(part: range) -> None:
    assert not failures(part, INTERPRETED)


@pytest.mark.slow
def test_compiled_events() -> None:
    assert not failures(range(40, 80), tuple(d for d in DRIVERS if d.endswith("native")))
