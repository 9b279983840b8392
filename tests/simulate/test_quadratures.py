"""Integrals of time solved apart, against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, time, variable, where
from acausal.simulate.record.quadratures import integrals
from acausal.simulate.solvers.segment import Tolerances

Array = NDArray[np.float64]


def test_smooth_rates_to_rounding() -> None:
    """Wave, constant, decay and a steep rise, over one panel or many."""
    times = np.linspace(0.03, 10.0, 333)
    found = integrals(
        lambda t, _: np.vstack([np.sin(40 * t), 3.0 + 0 * t, np.exp(-t), 1 / np.cosh(50 * (t - 5)) ** 2]),
        np.zeros(1),
        times,
        np.zeros(len(times), dtype=np.int64),
        Tolerances(1e-10),
    )
    expected = [
        (1 - np.cos(40 * times)) / 40,
        3 * times,
        1 - np.exp(-times),
        (np.tanh(50 * (times - 5)) + np.tanh(250)) / 50,
    ]
    np.testing.assert_allclose(found, np.vstack(expected), rtol=0, atol=1e-10)


def test_a_jump_inside_is_enclosed() -> None:
    """A step at pi integrates to max(t - pi, 0)."""
    times = np.linspace(0.1, 10.0, 100)
    stretches = np.zeros(len(times), dtype=np.int64)
    found = integrals(
        lambda t, _: np.where(t < np.pi, 0.0, 1.0)[None, :], np.zeros(1), times, stretches, Tolerances(1e-8)
    )
    np.testing.assert_allclose(found[0], np.maximum(times - np.pi, 0.0), atol=1e-10)


def test_one_output_time() -> None:
    found = integrals(lambda t, _: 2 * t[None, :], np.ones(1), np.array([3.0]), np.array([0]), Tolerances(1e-8))
    np.testing.assert_allclose(found, [[8.0]])


def test_several_stretches_at_once() -> None:
    """k*t over [0, 1] and [2, 4] with k = 1, 2, and a step inside the third stretch."""

    def rates(t: Array, stretch: NDArray[np.int64]) -> Array:
        return np.where(stretch < 2, (1.0 + stretch) * t, np.where(t < 0.3, 0.0, 1.0))[None, :]

    times, stretches = np.array([0.5, 1.0, 3.0, 4.0, 0.2, 0.4, 1.0]), np.array([0, 0, 1, 1, 2, 2, 2])
    found = integrals(rates, np.array([0.0, 2.0, 0.0]), times, stretches, Tolerances(1e-10, 0.01))
    np.testing.assert_allclose(found, [[0.125, 0.5, 5.0, 12.0, 0.0, 0.1, 0.7]], atol=1e-10)


def test_a_pole_is_an_error() -> None:
    def pole(t: Array, _: NDArray[np.int64]) -> Array:
        with np.errstate(divide="ignore"):
            return 1 / np.round(t - 2.0, 12)[None, :]

    with pytest.raises(RuntimeError, match="not finite"):
        integrals(pole, np.zeros(1), np.array([4.0]), np.array([0]), Tolerances(1e-8))


class Shaft(Component):
    """A decay that is integrated, and an angle driven by time alone that nothing reads."""

    x: Real = variable(default=fixed(1.0), unit="1")
    angle: Real = variable(default=fixed(0.5), unit="rad", nominal=100.0)
    rise: Real = parameter(default=2.0, unit="rad/s2")
    tau: Real = parameter(default=1.0, unit="s")

    def equations(self) -> Equations:
        yield self.tau * der(self.x) == -self.x
        yield der(self.angle) == where(time < 1.0, 0.0 * self.rise * time, self.rise * (time - 1.0))


def test_island_of_a_model() -> None:
    """rise/2 (t - 1)**2 after 1 s, on top of the start; the state beside it decays."""
    run = acausal.simulate(Shaft(), stop_time=4.0, tolerance=1e-8)
    assert (run.stats["states"], run.stats["quadratures"]) == (1, 1)
    np.testing.assert_allclose(run["angle"], 0.5 + np.maximum(run.time - 1.0, 0.0) ** 2, atol=1e-12)
    assert run.at(2.345, "angle") == pytest.approx(0.5 + 1.345**2, abs=1e-12)
    np.testing.assert_allclose(run["x"], np.exp(-run.time), atol=1e-7)


def test_nothing_grows_in_no_time() -> None:
    """An event at the very start of its stretch: the integral over no time is 0."""

    def rates(times: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        return np.ones((1, len(times)))

    one = np.array([0.5])
    assert integrals(rates, one, one, np.zeros(1, dtype=np.int64), Tolerances(1e-8, 0.01)).tolist() == [[0.0]]
