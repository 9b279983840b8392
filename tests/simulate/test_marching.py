"""Mechanisms without inertia stay on their branch, whatever the outputs are."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, cos, guess, parameter, sin, time, variable


class Parallelogram(Component):
    """Cranks of length 1 on a base of length 2, joined by a rod of length 2; th is prescribed."""

    w: Real = parameter(default=1.0, unit="rad/s")
    th: Real = variable(unit="rad")
    p: Real = variable(unit="rad", default=guess(1e-9))
    q: Real = variable(unit="rad", default=guess(math.pi / 2 + 1e-9))

    def equations(self) -> Equations:
        yield self.th == math.pi / 2 + self.w * time
        yield cos(self.th) + 2 * cos(self.p) - cos(self.q) - 2 == 0
        yield sin(self.th) + 2 * sin(self.p) - sin(self.q) == 0


@pytest.mark.parametrize("outputs", [1, 7, 8, 500])
def test_a_parallelogram_passes_its_change_points(outputs: int) -> None:
    """The scene `change-point`: p = 0 and q = th for all th; the other branch is the antiparallelogram."""
    r = acausal.simulate(Parallelogram(), stop_time=4 * math.pi, output_interval=4 * math.pi / outputs)
    assert np.abs(r["p"]).max() < 1e-6
    assert np.abs(r["q"] - r["th"]).max() < 1e-6
