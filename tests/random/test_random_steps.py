"""Steps of random models: the sum of their estimated errors bounds the error of the run, or a flag is set."""

from __future__ import annotations

from math import isfinite

import pytest

from tests.random.step_judge import Told, told

METHODS = ("rk2", "rk4", "rosenbrock", "sdirk")
# How far an error may exceed the sum: parts hand it on, and speeds are large where places are not.
_MOST = 30.0


def silent(seeds: range, methods: tuple[str, ...], steps: tuple[float, ...]) -> tuple[list[Told], int]:
    """Runs whose error is larger than their steps have said before any flag, and the number of all runs."""
    runs = [one for seed in seeds for one in told(seed, methods, steps)]
    assert sum(one.error > 1e-5 for one in runs) > len(runs) / 3
    return [one for one in runs if one.ratio > _MOST or not (isfinite(one.estimate) or one.flagged)], len(runs)


def test_errors_of_a_few_models_are_told() -> None:
    wrong, tried = silent(range(2), METHODS, (0.025,))
    assert tried > 5
    assert not wrong


@pytest.mark.slow
def test_errors_of_more_models_are_told() -> None:
    wrong, tried = silent(range(2, 7), METHODS, (0.0125,))
    assert tried > 11
    assert not wrong
