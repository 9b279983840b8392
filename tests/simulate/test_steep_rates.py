"""Compiled flights take a steep function to be at rest by its relative rate: that must bound what it does."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, atan, cosh, der, exp, fixed, parameter, tanh, variable, where
from acausal.simulate.equations.arguments import arguments


class Steep(Component):
    """A rate of each kind of function of one state."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        u = 3.0 * self.x - 1.0
        yield der(self.x) == 1.0
        kinds = [tanh(9.0 * u), atan(9.0 * u), exp(-9.0 * u), cosh(2.0 * u), 2.0 ** (5.0 * u), u**12]
        yield der(self.y) == sum(kinds) + 1.0 / (1e-6 + u * u) + (1e-6 + u * u) ** 0.5


def test_a_relative_rate_bounds_what_a_function_changes_by() -> None:
    """By the mean value theorem: |ln h(b) - ln h(a)| <= (b - a) max |h'/h|, of both heights of every function."""
    compiled = acausal.compile(Steep())
    known = arguments(compiled)
    assert known is not None
    look, count = known.along(), known.levels.count
    assert {"tanh", "atan", "exp", "cosh"} <= {k for k in known.levels._kinds if isinstance(k, str)}

    def at(x: float) -> tuple[np.ndarray, np.ndarray]:
        given = [np.zeros(look.numel_in(k)) for k in range(look.n_in())]
        given[1][compiled.states.index("x")] = x
        given[-1][compiled.states.index("x")] = 1.0
        found = look.call([ca.DM(v) for v in given])
        return np.array(found[2]).reshape(count, 2), np.array(found[3]).ravel()

    step = 1e-6
    for x in np.random.default_rng(1).uniform(-0.4, 1.0, 60):
        (before, low), (after, high) = at(x), at(x + step)
        own = (before > 0.0) & (after > 0.0)
        change = np.abs(
            np.log(after, out=np.zeros_like(after), where=own) - np.log(before, out=before * 0.0, where=own)
        )
        rounding = 1e-13
        assert (change <= (1.0 + 1e-3) * step * np.maximum(low, high)[:, None] + rounding).all()


class Braked(Component):
    """A rate whose denominator jumps from its floor to about one, where an event is."""

    x: Real = variable(default=fixed(0.0))
    floor: Real = parameter(default=1e-3)

    def equations(self) -> Equations:
        yield der(self.x) == 1.0 / (self.floor + where(self.x > 0.5, 1.0, 0.0))


def test_a_denominator_that_jumps_is_no_steep_function() -> None:
    """Both rates are constant: x = t / floor up to 1/2, and from there x = 1/2 + (t - floor / 2) / (1 + floor)."""
    compiled = acausal.compile(Braked())
    assert not compiled.is_steep
    r = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-8)
    assert float(r.final("x")) == pytest.approx(0.5 + (1.0 - 0.5e-3) / (1.0 + 1e-3), rel=1e-7)
