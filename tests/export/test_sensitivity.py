"""Derivatives through events against closed forms, differentiated by complex steps."""

from __future__ import annotations

import cmath
import math
from typing import Literal

import numpy as np
import pytest
import scipy.stats

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    maximum,
    parameter,
    pre,
    quantity,
    reset,
    sign,
    time,
    variable,
    when,
    where,
)
from acausal.errors import ExportError, UsageError
from acausal.simulate.native import cache

Method = Literal["forward", "adjoint"]
METHODS: tuple[Method, ...] = ("forward", "adjoint")
COMPILER = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
# events in Python and in compiled flights
WAYS = [(None, False), ("idas", False), pytest.param("rosenbrock", True, marks=COMPILER)]


class Ball(Component):
    """A ball dropped from h0 on a floor."""

    e: Real = parameter(default=0.8, unit="1")
    g: Real = parameter(default=9.81, unit="m/s2")
    h0: Real = parameter(default=1.0, unit="m")
    h: Real = variable(unit="m")
    v: Real = variable(unit="m/s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -self.g
        yield when(self.h < 0, reset(self.v, -self.e * pre(self.v)))

    def initial_equations(self) -> Equations:
        yield self.h == self.h0


def fall(e: complex, g: complex, h0: complex, stop: float) -> tuple[complex, complex, list[complex]]:
    """Height and speed at `stop`, and the instants of the impacts."""
    t = cmath.sqrt(2 * h0 / g)
    v, times = g * t, [t]
    while True:
        v *= e
        following = times[-1] + 2 * v / g
        if following.real > stop:
            rest = stop - times[-1]
            return v * rest - g * rest**2 / 2, v - g * rest, times
        times.append(following)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("solver", "native"), WAYS)
def test_a_bouncing_ball(method: Method, solver: str | None, native: bool) -> None:
    found = acausal.sensitivities(
        Ball(), ["e", "g", "h0"], ["h", "v"], stop_time=2.0, method=method, solver=solver, native=native
    )
    start = 0.8 + 0j, 9.81 + 0j, 1.0 + 0j
    steps = []
    for j in range(3):
        e, g, h0 = (value + 1e-30j * (k == j) for k, value in enumerate(start))
        steps.append(fall(e, g, h0, 2.0))
    final = np.array([[h.imag, v.imag] for h, v, _ in steps]).T / 1e-30
    times = np.array([[t.imag for t in ts] for _, _, ts in steps]).T / 1e-30
    np.testing.assert_allclose(found.final, final, rtol=1e-8)
    np.testing.assert_allclose(found.of_event_times, times, rtol=1e-8, atol=1e-12)
    height, speed, _ = fall(*start, 2.0)
    assert found.values == pytest.approx([height.real, speed.real], rel=1e-9)


class Braked(Component):
    """v' = -mu sign(v) from v0: stops at v0 / mu after v0^2 / (2 mu), and stays there."""

    mu: Real = parameter(default=5.0, unit="m/s2")
    v0: Real = parameter(default=1.0, unit="m/s")
    x: Real = variable(unit="m", default=fixed(0.0))
    v: Real = variable(unit="m/s")

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.mu * sign(self.v)

    def initial_equations(self) -> Equations:
        yield self.v == self.v0


@pytest.mark.parametrize("method", METHODS)
def test_what_sticks_keeps_its_place(method: Method) -> None:
    found = acausal.sensitivities(Braked(), ["mu", "v0"], ["x", "v"], stop_time=3.0, method=method)
    np.testing.assert_allclose(found.final, [[-0.5 / 25, 1 / 5], [0.0, 0.0]], atol=1e-8)
    np.testing.assert_allclose(found.of_event_times, [[-1 / 25, 1 / 5]], rtol=1e-8)


class Pulse(Component):
    """x' = a between t0 and t0 + d, a lag y behind it."""

    a: Real = parameter(default=2.0, unit="1/s")
    t0: Real = parameter(default=0.3, unit="s")
    d: Real = parameter(default=0.2, unit="s")
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == where(time < self.t0, 0.0, where(time < self.t0 + self.d, self.a, 0.0))
        yield der(self.y) == (self.x - self.y) / 1.0


@pytest.mark.parametrize("method", METHODS)
def test_known_instants_move_with_their_parameters(method: Method) -> None:
    """x(1) = a d; y(1) = a (d - exp(-(1 - t0 - d)) + exp(-(1 - t0))): the response of a lag to two ramps."""
    found = acausal.sensitivities(Pulse(), ["a", "t0", "d"], ["x", "y"], stop_time=1.0, method=method)
    early, late = np.exp(-0.7), np.exp(-0.5)
    expected = [[0.2, 0.0, 2.0], [0.2 - late + early, 2.0 * (early - late), 2.0 * (1 - late)]]
    np.testing.assert_allclose(found.final, expected, rtol=1e-8, atol=1e-12)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(UsageError, match="no parameter 'h1'"):
        acausal.sensitivities(Ball(), ["h1"], ["h"])
    with pytest.raises(UsageError, match="AC010"):
        acausal.sensitivities(Ball(), ["e"], ["height"])


def test_no_parameter_at_all_is_refused() -> None:
    with pytest.raises(UsageError, match="AC020"):
        acausal.sensitivities(Ball(), [], ["h"])


class Charged(Component):
    """C u' = (U - u)/R with a nonlinear current drawn: 0 == i + 0.2 i^3 - u, and a bounce of u at 1."""

    R: Real = parameter(default=2.0)
    U: Real = parameter(default=3.0)
    k: Real = parameter(default=0.4)
    u: Real = variable(default=fixed(0.0))
    i: Real = variable()

    def equations(self) -> Equations:
        yield der(self.u) == (self.U - self.u) / self.R - 0.3 * self.i
        yield self.i + 0.2 * self.i**3 == self.u
        yield when(self.u > 1.0, reset(self.u, self.k * pre(self.u)))


def test_trajectories_through_events_are_those_of_differences_of_tight_runs() -> None:
    """Central differences of runs at 1e-12, steps of 1e-5: right to 1e-8, away from events."""
    times, names = [0.0, 0.3, 1.1, 2.0, 2.9], ["R", "U", "k"]
    compiled = acausal.compile(Charged())
    found = acausal.sensitivities(compiled, names, ["u", "i"], stop_time=3.0, times=times)
    assert found.along.shape == (5, 2, 3)
    assert len(found.event_times) >= 2
    for j, name in enumerate(names):
        value = dict(zip(compiled.parameters, compiled.parameter_values, strict=True))[name]
        runs = [
            acausal.simulate(
                compiled, parameters={name: value + d}, stop_time=3.0, tolerance=1e-12, solver="rosenbrock"
            )
            for d in (1e-5, -1e-5)
        ]
        for row, output in enumerate(("u", "i")):
            high, low = (np.array([run.at(t, output) for t in times]) for run in runs)
            np.testing.assert_allclose(found.along[:, row, j], (high - low) / 2e-5, atol=1e-6)
    np.testing.assert_allclose(found.along[0], 0.0)


def test_trajectories_end_at_the_final_values() -> None:
    found = acausal.sensitivities(Ball(), ["e", "g"], ["h", "v"], stop_time=2.0, times=[0.2, 2.0])
    np.testing.assert_allclose(found.along[1], found.final, rtol=1e-9)
    np.testing.assert_allclose(found.along[0], [[0.0, -0.02], [0.0, -0.2]], rtol=1e-9, atol=1e-12)  # free fall
    with pytest.raises(UsageError, match="AC044"):
        acausal.sensitivities(Ball(), ["e"], ["h"], stop_time=2.0, times=[2.5])


class Lags(Component):
    """Forty equal lags in a row behind a one, and what the last is worth by a nonlinear equation."""

    T: Real = parameter(default=0.1, unit="s")
    x: Real = variable(default=fixed(0.0), shape=40)
    y: Real = variable()

    def equations(self) -> Equations:
        for k in range(40):
            yield self.T * der(self.x[k]) == (self.x[k - 1] if k else 1.0) - self.x[k]
        yield self.y + self.y**3 == self.x[39]


@pytest.mark.parametrize("method", METHODS)
def test_many_states_go_by_sparse_matrices(method: Method) -> None:
    """x[39] is the incomplete gamma function P(40, t/T), whose slope is that of the density; y' = x'/(1 + 3 y^2)."""
    stop, last = 4.0, "x[39]"
    found = acausal.sensitivities(Lags(), ["T"], [last, "y"], stop_time=stop, method=method)
    density = scipy.stats.gamma.pdf(stop / 0.1, 40)
    y = found.values[1]
    assert y + y**3 == pytest.approx(scipy.stats.gamma.cdf(stop / 0.1, 40), rel=1e-8)
    slope = -density * stop / 0.1**2
    np.testing.assert_allclose(found.final[:, 0], [slope, slope / (1 + 3 * y**2)], rtol=1e-6)


class Throw(Component):
    """A ball thrown up at 9.81 m/s, whose apex is `depth` above a height: how long it is above, and how far in sum."""

    depth: Real = parameter(default=1e-6, unit="m")
    h: Real = variable(unit="m", default=fixed(0.0))
    v: Real = variable(unit="m/s", default=fixed(9.81))
    area: Real = variable(unit="m.s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -quantity(9.81, "m/s2")
        yield der(self.area) == maximum(self.h - (quantity(9.81 / 2, "m") - self.depth), quantity(0.0, "m"))


class Seen(Throw):
    """The same, which counts the time above."""

    above: Real = variable(unit="s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.above) == where(self.h > quantity(9.81 / 2, "m") - self.depth, 1.0, 0.0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_a_grazed_relation_is_refused_where_its_rate_is_noise(solver: str, method: Method) -> None:
    """It is above from 1 - w to 1 + w, w = sqrt(2 depth/g): at a tolerance of 1e-10 1e-6 m is known, 1e-11 m is not."""
    compiled = acausal.compile(Seen())

    def found(depth: float) -> acausal.Sensitivities:
        return acausal.sensitivities(
            compiled, ["depth"], ["above"], stop_time=1.7, solver=solver, method=method, values={"depth": depth}
        )

    slope = 1 / np.sqrt(2 * 9.81 * 1e-6)
    # an error of h within the tolerance is one of the depth, on whose root the slope depends
    exact = 1e-10 / (2 * 1e-6)
    np.testing.assert_allclose(found(1e-6).of_event_times[:, 0], [-slope, slope], rtol=exact)
    np.testing.assert_allclose(found(1e-6).final[:, 0], [2 * slope], rtol=exact)
    with pytest.raises(ExportError, match=r"AC615(.|\n)*t = (0\.99999\d*|1(\.00000\d*)?) s(.|\n)*h > ") as caught:
        found(1e-11)
    assert caught.value.where


def test_a_grazed_kink_is_no_event_and_is_not_refused() -> None:
    """area = 4/3 sqrt(2/g) depth^1.5, whose slope is the time above."""
    found = acausal.sensitivities(Throw(), ["depth"], ["area"], stop_time=1.7, values={"depth": 1e-11})
    assert len(found.event_times) == 0
    assert found.final[0, 0] == pytest.approx(2 * np.sqrt(2e-11 / 9.81), abs=5e-6)


class Thrown(Component):
    """x = t - t^2/2 comes up to 1/2 at t = 1; y is the time above h."""

    h: Real = parameter(default=0.5)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -1.0
        yield der(self.y) == where(self.x > self.h, 1.0, 0.0)


@pytest.mark.parametrize("method", ["forward", "adjoint"])
def test_what_is_passed_or_missed_by_its_error_has_no_derivative(method: Method) -> None:
    """y = 2 sqrt(1 - 2 h) up to h = 1/2, and 0 beyond: its slope by h goes to minus infinity, and then is 0."""
    for h in (0.5 - 1e-11, 0.5 + 1e-13):
        with pytest.raises(ExportError, match="AC615"):
            acausal.sensitivities(Thrown(h=h), ["h"], ["y"], stop_time=2.0, method=method)
    for h, slope in ((0.499, -2.0 / math.sqrt(2e-3)), (0.501, 0.0)):
        found = acausal.sensitivities(Thrown(h=h), ["h"], ["y"], stop_time=2.0, method=method)
        assert found.final[0][0] == pytest.approx(slope, rel=1e-4)
