"""Second derivatives of variables that turn out to be another variable, or a function of time."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, sin, time, variable


class TwiceDifferentiated(Component):
    a: Real = variable()
    y: Real = variable()
    z: Real = variable()

    def equations(self) -> Equations:
        yield self.a == der(der(self.y))
        yield self.y == self.z
        yield self.z == 0.5 + sin(3 * time)


def test_the_second_derivative_of_an_alias_of_a_function_of_time() -> None:
    result = acausal.simulate(TwiceDifferentiated(), stop_time=1.0)
    assert result["a"] == pytest.approx(-9.0 * np.sin(3.0 * result.time), abs=1e-12)
