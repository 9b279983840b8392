"""Errors against closed forms, on trajectories made here."""

from __future__ import annotations

import math

import numpy as np
import pytest

from acausal.study.bench.accuracy.distance import Distance, distance, floors
from acausal.study.bench.accuracy.trajectory import Trajectory

SPAN, COARSE, FINE = 10.0, 200, 2000


def wave(delay: float = 0.0, size: float = 1.0, points: int = COARSE) -> Trajectory:
    t = np.linspace(0.0, SPAN, points + 1)
    return Trajectory(t, ("x", "v"), np.stack([size * np.cos(3 * (t - delay)), -3 * size * np.sin(3 * (t - delay))], 1))


def judged(found: Trajectory, trusted: float = 15.0, nominal: float = 1.0) -> Distance:
    fine = wave(points=FINE)
    return distance(found, fine, floors(fine, np.full(2, nominal)), trusted)


@pytest.mark.parametrize("delay", [1e-9, -1e-6, 1e-3, 0.02, -0.3])
def test_a_delay_is_found_as_phase_and_leaves_no_shape(delay: float) -> None:
    # Both variables are shifted by construction; cubic interpolation between points 0.005 s apart is good to 1e-8.
    found = judged(wave(delay))
    assert found.shape is not None
    assert found.phase == pytest.approx(delay, rel=1e-5)
    assert found.shape < 1e-8


def test_an_amplitude_is_no_phase() -> None:
    found = judged(wave(size=1.01))
    assert found.phase is not None
    # over a window that holds no whole number of periods the two are not quite apart
    assert abs(found.phase) < 3e-4
    # 1 % of v, whose size is 3, against f = 1 and its size
    assert found.shape == pytest.approx(0.03 / (1 + 3), rel=0.01)


def test_mixed_error_and_digits_are_those_of_the_test_sets() -> None:
    fine = wave(points=FINE)
    found = wave()
    values = found.values.copy()
    values[-1] += (1e-5, 0.0)
    at_end = math.cos(3 * SPAN)
    d = distance(Trajectory(found.times, found.names, values), fine, floors(fine, np.ones(2)), 15.0)
    assert d.absolute == pytest.approx(1e-5, rel=1e-6)
    assert d.end == pytest.approx(1e-5 / (1 + abs(at_end)), rel=1e-6)
    assert d.mescd == pytest.approx(-math.log10(d.end))
    assert d.scd == pytest.approx(-math.log10(1e-5 / abs(at_end)), rel=1e-6)
    assert d.worst == "x"


def test_digits_beyond_the_reference_do_not_count() -> None:
    found = judged(wave(), trusted=7.0)
    assert found.mescd == 7.0
    assert found.scd == 7.0


def test_the_floor_follows_small_variables_down_to_a_thousandth() -> None:
    t = np.linspace(0.0, 1.0, 3)
    values = np.array([[1e-9, 1e-2, 50.0]] * 3)
    f = floors(Trajectory(t, ("a", "b", "c"), values), np.ones(3))
    np.testing.assert_allclose(f, [1e-3, 1e-2, 1.0])


def test_what_does_not_swing_has_no_phase() -> None:
    t = np.linspace(0.0, SPAN, COARSE + 1)
    fine = np.linspace(0.0, SPAN, FINE + 1)
    decay = Trajectory(t, ("x",), np.exp(-t)[:, None])
    d = distance(decay, Trajectory(fine, ("x",), np.exp(-fine)[:, None]), np.ones(1), 15.0)
    assert d.phase is None
    assert d.series < 1e-15
