"""A profile that acts only where something touches it is met, however narrow: until then no rate depends on it.

Law: at a steady speed of 1 m/s the momentum that a spring behind a profile p(s), s = (x - c)/w, transfers beyond its
threshold 1/2 is the integral of max(p(s) - 1/2, 0) over s, whatever w is. It is computed here by quadrature of the
closed form.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import acausal
from acausal import Component, Equations, Expr, Real, der, fixed, maximum, parameter, variable, where
from tests.marks import slow_but

_CENTRE = 0.51234


class Gaussian(Component):
    w: Real = parameter(default=1e-4)
    x: Real = variable(default=fixed(0.0))
    momentum: Real = variable(default=fixed(0.0))

    def profile(self, s: Any, f: Any) -> Any:
        return f.exp(-(s**2))

    def force(self, depth: Expr) -> Expr:
        return where(depth > 0, depth / self.w, 0.0)

    def equations(self) -> Equations:
        yield der(self.x) == 1
        yield der(self.momentum) == self.force(self.profile((self.x - _CENTRE) / self.w, acausal) - 0.5)


class Resonance(Gaussian):
    def profile(self, s: Any, f: Any) -> Any:
        return 1 / (1 + s**2)


class Plateau(Gaussian):
    def profile(self, s: Any, f: Any) -> Any:
        return (f.tanh(5 * (s + 1)) - f.tanh(5 * (s - 1))) / 2


class PowerOfTwo(Gaussian):
    def profile(self, s: Any, f: Any) -> Any:
        return 2.0 ** (-(s**2))


class Logarithm(Gaussian):
    def profile(self, s: Any, f: Any) -> Any:
        return -0.4 * f.log(s**2 + 0.1)


class TwoTops(Gaussian):
    def profile(self, s: Any, f: Any) -> Any:
        return 1 - (s**2 - 1) ** 2


class OneSided(Gaussian):
    def force(self, depth: Expr) -> Expr:
        return maximum(depth, 0) / self.w


class Switched(Gaussian):
    def force(self, depth: Expr) -> Expr:
        return where(depth > 0, 1.0, 0.0) * depth / self.w


_KINDS = [Gaussian, Resonance, Plateau, PowerOfTwo, Logarithm, TwoTops, OneSided, Switched]


@pytest.mark.parametrize(
    ("kind", "solver", "native"),
    slow_but(
        [(kind, *driver) for kind in _KINDS for driver in (("rosenbrock", False), ("erk", True), ("idas", False))],
        (Gaussian, "rosenbrock", False),
        (OneSided, "erk", True),
        (OneSided, "idas", False),
    ),
)
def test_momentum_does_not_depend_on_the_width(kind: type[Gaussian], solver: str, native: bool) -> None:
    """Without the search, solvers passed over profiles of a ten-thousandth of the run: no momentum, and no event."""
    model = kind()
    momentum = 2.0 * quad(lambda s: max(model.profile(s, np) - 0.5, 0.0), 0.0, 3.0, limit=200)[0]
    compiled = acausal.compile(model)
    for w in (1e-3, 1e-6):
        given: dict[str, Any] = {"solver": solver, "native": native, "tolerance": 1e-6, "output_interval": 0.1}
        r = acausal.simulate(compiled, parameters={"w": w}, stop_time=1.0, **given)
        assert float(r.final("momentum")) == pytest.approx(momentum, rel=1e-4)
