"""Compiled flights take a steep function to be at rest by its relative rate: that must bound what it does."""

from __future__ import annotations

import casadi as ca
import numpy as np

import acausal
from acausal import Component, Equations, Real, atan, cosh, der, exp, fixed, tanh, variable
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
