"""Derivatives through samples, whose instants move with their parameters, against complex steps."""

from __future__ import annotations

import cmath
from typing import Literal

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fixed,
    parameter,
    pre,
    reset,
    sample,
    variable,
    when,
    where,
)
from acausal.simulate.native import cache

Method = Literal["forward", "adjoint"]
METHODS: tuple[Method, ...] = ("forward", "adjoint")
COMPILER = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
# events in Python and in compiled flights
WAYS = [(None, False), ("idas", False), pytest.param("rosenbrock", True, marks=COMPILER)]
START = {"K": 1.5, "T": 0.3, "t0": 0.1}


class Held(Component):
    """x' = u, and u = -K x is taken at t0 + k T."""

    K: Real = parameter(default=START["K"])
    T: Real = parameter(default=START["T"], unit="s")
    t0: Real = parameter(default=START["t0"], unit="s")
    x: Real = variable(default=fixed(1.0))
    u: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield when(sample(self.t0, self.T), reset(self.u, -self.K * self.x))


def held(K: complex, T: complex, t0: complex, stop: float) -> tuple[complex, complex]:
    """x and u at `stop`: straight lines between the ticks."""
    x, u, t = 1.0 + 0j, 0j, t0
    while True:
        u = -K * x
        if (t + T).real > stop:
            return x + u * (stop - t), u
        x, t = x + u * T, t + T


def slopes(stop: float) -> np.ndarray:
    """d (x, u) / d (K, T, t0) by complex steps."""
    columns = []
    for name in START:
        given = {k: v + 1e-30j * (k == name) for k, v in START.items()}
        columns.append([value.imag / 1e-30 for value in held(**given, stop=stop)])
    return np.array(columns).T


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("solver", "native"), WAYS)
def test_sample_instants_move_with_their_parameters(method: Method, solver: str | None, native: bool) -> None:
    found = acausal.sensitivities(
        Held(), list(START), ["x", "u"], stop_time=2.0, method=method, solver=solver, native=native
    )
    np.testing.assert_allclose(found.final, slopes(2.0), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.values, [v.real for v in held(1.5 + 0j, 0.3 + 0j, 0.1 + 0j, 2.0)], rtol=1e-9)


class Equation(Held):
    """The same loop with a discrete equation beside the clause of its base."""

    v: Real = discrete()
    y: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield self.v == where(sample(self.t0, self.T), -self.K * self.y, pre(self.v))
        yield der(self.y) == self.v


@pytest.mark.parametrize("method", METHODS)
def test_discrete_equations_are_differentiated(method: Method) -> None:
    found = acausal.sensitivities(Equation(), list(START), ["y", "v"], stop_time=2.0, method=method)
    np.testing.assert_allclose(found.final, slopes(2.0), rtol=1e-8, atol=1e-10)


class Accumulated(Component):
    """s = s / 2 + x at every tick, with what it was before as `pre`."""

    K: Real = parameter(default=1.5)
    T: Real = parameter(default=0.3, unit="s")
    x: Real = variable(default=fixed(1.0))
    s: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == -self.K * self.x
        yield when(sample(self.T, self.T), reset(self.s, 0.5 * pre(self.s) + self.x))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("solver", "native"), WAYS)
def test_what_pre_remembers_is_differentiated(method: Method, solver: str | None, native: bool) -> None:
    """x = exp(-K t), six ticks before t = 2."""

    def total(K: complex, T: complex) -> complex:
        s = 0j
        for k in range(1, 7):
            s = 0.5 * s + cmath.exp(-K * k * T)
        return s

    asked = {"stop_time": 2.0, "method": method, "solver": solver, "native": native}
    found = acausal.sensitivities(Accumulated(), ["K", "T"], ["s"], **asked)  # type: ignore[arg-type]
    exact = [total(1.5 + 1e-30j, 0.3).imag / 1e-30, total(1.5, 0.3 + 1e-30j).imag / 1e-30]
    np.testing.assert_allclose(found.final[0], exact, rtol=1e-8)
