"""Lengths of steps whose variations have an error that is known: of a smooth solution, of rounding, of a pulse.

Steps are tried as the methods of order 3 do it: longer or shorter by the fourth root of their error. Expected values
follow from these laws of the error; nothing is integrated.
"""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest

from acausal.export.variation.control import Control
from acausal.export.variation.element import Accuracy
from acausal.export.variation.tables import RADAU, STAGES

STOP = 1.0


def _steps(error: Callable[[float, float], float], h: float) -> tuple[list[tuple[float, float]], int, Control, float]:
    """(Start and length of each step over a second, number of attempts, control, errors noted); `error` by both."""
    one, x = np.ones((1, 1)), np.array([[1.0, 0.0]])
    control = Control(Accuracy(one, 0.0), 1e-8, x, 0.0)
    t, attempts, accepted = 0.0, 0, []
    while t < STOP:
        h, attempts = min(h, STOP - t), attempts + 1
        found = control.judged(t, h, error(t, h), 0.0 * one, error(t, h) * 1e-8 * one)
        growth = 0.9 * found**-0.25 if found > 0 else 8.0
        if found > 1:
            h *= control.shorter(max(0.2, min(growth, 0.9)))
            continue
        accepted.append((t, h))
        x = control.accepted(x)
        t, h = t + h, control.longer(h, h, growth)
    return accepted, attempts, control, float(x[0, 1])


@pytest.mark.parametrize("length", [1e-3, 1e-2])
def test_smooth_steps_are_as_long_as_their_error_allows(length: float) -> None:
    """The error of a length is one, so that steps come to about 0.9 of it; nothing is taken for rounding."""
    accepted, attempts, control, missed = _steps(lambda t, h: (h / length) ** 4, 0.1)
    assert max(h for _, h in accepted) <= length
    assert attempts <= 1.3 * STOP / length + 20
    assert control.noise == 0.0
    assert missed == 0.0


def test_rounding_does_not_shorten_steps() -> None:
    """An error in proportion to the length is the same in sum for steps of every length: a second takes it once.

    With steps of an error below one it would take 1000 of them; the smooth error of a tenth of a second is one.
    """
    chance = random.Random(7)
    accepted, attempts, _, missed = _steps(lambda t, h: 1e3 * h * chance.uniform(0.1, 1.0) + (h / 0.1) ** 4, 1e-3)
    assert attempts < 250
    assert max(h for _, h in accepted) > 0.03
    # of the errors of all steps, 1e3 * 1e-8 at most by rounding, is said what was accepted above what was allowed
    assert 1e-7 < missed < 2e-5


def test_steps_do_not_stay_where_rounding_is_just_allowed() -> None:
    """Without chance, steps grow until rounding is two thirds of what is allowed; none of 1500 in a second is refused.

    They are longer once a shorter one shows that the error is in proportion to the length.
    """
    accepted, attempts, control, _ = _steps(lambda t, h: 1e3 * h + (h / 0.1) ** 4, 1e-4)
    assert attempts < 250
    assert max(h for _, h in accepted) > 0.03
    assert control.noise >= 1e3


@pytest.mark.parametrize("width", [1e-3, 1e-5])
@pytest.mark.parametrize("noise", [0.0, 1e3])
def test_a_pulse_is_resolved_beside_rounding(width: float, noise: float) -> None:
    """A step that holds a pulse and is longer than it is wrong by a million, or by the fourth power of its length."""
    chance, place = random.Random(11), 0.7

    def error(t: float, h: float) -> float:
        beside = noise * h * chance.uniform(0.1, 1.0)
        if t <= place + width and t + h >= place:
            beside += min(1e6, (10.0 * h / width) ** 4)
        return beside + (h / 0.1) ** 4

    accepted, *_ = _steps(error, 1e-3)
    inside = [h for t, h in accepted if t <= place + width and t + h >= place]
    assert max(inside) <= width


def test_embedded_errors_of_radau_have_their_orders() -> None:
    """They vanish for rates t**k, whose integral is t**(k + 1)/(k + 1), below order 5 and 3, and not at it.

    Laws of quadrature; from x(0) = 0 over a step of one.
    """
    for weights, order in zip(RADAU.weights, (STAGES, 3), strict=True):
        errors = [weights @ RADAU.nodes ** (k + 1) / (k + 1) + (k == 0) for k in range(order + 1)]
        np.testing.assert_allclose(errors[:-1], 0.0, atol=1e-13)
        assert abs(errors[-1]) > 1e-3
