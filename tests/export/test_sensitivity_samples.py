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
    initial,
    parameter,
    pre,
    reset,
    sample,
    terminate,
    time,
    variable,
    when,
    where,
)
from acausal.errors import ExportError
from acausal.simulate.native import cache
from tests.expected import fails_with

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


class Begun(Component):
    """What happens at the start depends on a parameter: x is reset, d and y are set."""

    K: Real = parameter(default=1.5)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    d: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield der(self.y) == self.d
        yield self.d == where(initial(), self.K**2, pre(self.d))
        yield when(initial(), reset(self.x, 2 * self.K))


class Remembered(Component):
    """A rate, an algebraic equation, a relation and an output read what `pre` remembers."""

    K: Real = parameter(default=1.5)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable()
    w: Real = variable()
    d: Real = discrete()
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 1 + pre(self.d)
        yield self.z + self.z**3 == pre(self.d)
        yield der(self.y) == self.z
        yield when(sample(0.5, 10.0), reset(self.d, self.K**3 + self.K))
        yield when(self.x > 2 * pre(self.d), reset(self.n, self.x))
        yield self.w == pre(self.d) * self.x


class AtTheEnd(Component):
    """The last sample is that of the stop time."""

    K: Real = parameter(default=1.5)
    x: Real = variable(default=fixed(1.0))
    d: Real = discrete()
    e: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == -self.K * self.x
        yield self.e == where(sample(0.5, 0.5), self.x, pre(self.e))
        yield when(sample(0.5, 0.5), reset(self.d, self.x))


# d is K^3 + K from 0.5 s on, so that z is K; x passes 2 d as soon as d is remembered, at the slope 1 + d
CARRIED = [
    (Begun(), {"x": 2 * np.exp(-1.0), "y": 3.0, "d": 3.0}),
    (Remembered(), {"x": 7.75 / 2, "y": 0.5, "z": 1.0, "d": 7.75, "w": 7.75 * (0.5 + 0.5 * 5.875) + 4.875 * 7.75 / 2}),
    (AtTheEnd(), {"x": -np.exp(-1.5), "d": -np.exp(-1.5), "e": -np.exp(-1.5)}),
]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("solver", "native"), WAYS)
@pytest.mark.parametrize(("model", "exact"), CARRIED, ids=lambda v: type(v).__name__)
def test_starts_memories_and_the_last_instant_are_differentiated(
    model: Component, exact: dict[str, float], solver: str | None, native: bool, method: Method
) -> None:
    """By the closed forms: exponentials, straight lines, and Cardano's root."""
    asked = {"stop_time": 1.0, "method": method, "solver": solver, "native": native}
    found = acausal.sensitivities(model, ["K"], list(exact), **asked)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.final[:, 0], list(exact.values()), rtol=1e-7)


class Second(Component):
    """x passes what is remembered at an instant that moves with it."""

    K: Real = parameter(default=1.5)
    x: Real = variable(default=fixed(0.0))
    d: Real = discrete()
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 1
        yield when(sample(0.1, 10.0), reset(self.d, self.K / 3))
        yield when(self.x > pre(self.d), reset(self.n, time**2))


@pytest.mark.parametrize("method", METHODS)
def test_the_instant_of_a_relation_moves_with_what_it_remembers(method: Method) -> None:
    """From 0.1 s on it is passed at x = t = K / 3."""
    found = acausal.sensitivities(Second(), ["K"], ["n"], stop_time=1.0, method=method)
    np.testing.assert_allclose(found.of_event_times[-1], [1 / 3], rtol=1e-9)
    np.testing.assert_allclose(found.final, [[2 * 0.5 / 3]], rtol=1e-8)


@pytest.mark.parametrize(("t0", "stop", "meets"), [(0.1, 0.7, "stop time"), (0.2, 2.0, "meet")])
def test_instants_that_have_no_derivative_are_refused(t0: float, stop: float, meets: str) -> None:
    """A tick that moves across the stop time, and one that moves across another one which stays."""

    class Two(Held):
        n: Real = discrete()

        def equations(self) -> Equations:
            yield when(sample(0.8, 5.0), reset(self.n, self.u))

    with fails_with(ExportError, "AC615", match=meets):
        acausal.sensitivities(Two(t0=t0), ["T"], ["n"], stop_time=stop)
    if meets == "meet":  # by what moves none of both there is one
        assert np.isfinite(acausal.sensitivities(Two(t0=t0), ["K"], ["n"], stop_time=stop).final).all()


class Arriving(Component):
    """x passes 1 at t = 1."""

    K: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == self.K
        yield when(self.x > 1.0, reset(self.n, pre(self.n) + 1))


def test_a_relation_that_is_passed_at_the_stop_time_is_refused() -> None:
    with pytest.raises(ExportError, match=r"AC615[\s\S]*stop time[\s\S]*x > 1"):
        acausal.sensitivities(Arriving(), ["K"], ["n"], stop_time=1.0)
    assert acausal.sensitivities(Arriving(), ["K"], ["x"], stop_time=1.01).final[0, 0] == pytest.approx(1.01)


class Ended(Component):
    """x = K t and y = K t^2 / 2 until x is 1; z reads the time."""

    K: Real = parameter(default=0.8)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.K
        yield der(self.y) == self.x
        yield self.z == time * self.y
        yield when(self.x > 1, terminate("there"))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("solver", "native"), WAYS)
def test_final_values_of_a_run_that_ends_itself_are_those_where_it_ends(
    method: Method, solver: str | None, native: bool
) -> None:
    """At t = 1/K: x = 1, y = 1/(2 K), z = 1/(2 K^2)."""
    asked = {"stop_time": 3.0, "method": method, "solver": solver, "native": native}
    found = acausal.sensitivities(Ended(), ["K"], ["x", "y", "z"], **asked)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.final[:, 0], [0.0, -0.5 / 0.64, -1 / 0.512], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.of_event_times, [[-1 / 0.64]], rtol=1e-8)
