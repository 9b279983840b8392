"""Steps of derivatives, explicit and implicit, and their lengths, against closed forms."""

from __future__ import annotations

import cmath
import random
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, cos, der, fixed, parameter, time, variable
from acausal.export.variation.control import Control
from acausal.export.variation.element import Accuracy
from acausal.export.variation.slopes import Slopes
from acausal.export.variation.tables import RADAU, STAGES
from acausal.simulate.native import cache

Method = Literal["forward", "adjoint"]
METHODS: tuple[Method, ...] = ("forward", "adjoint")
COMPILER = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
NATIVE = [False, pytest.param(True, marks=COMPILER)]


class Follower(Component):
    """x' = k (cos(a t) - x) from zero: stiff for large k. x = Re(k/(k + ja) e^(jat)) - k^2/(k^2 + a^2) e^(-kt)."""

    k: Real = parameter(default=1e4)
    a: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.k * (cos(self.a * time) - self.x)


def followed(k: complex, a: complex, t: float) -> complex:
    """x in the form without conjugates, for complex steps."""
    return (k * k * cmath.cos(a * t) + k * a * cmath.sin(a * t) - k * k * cmath.exp(-k * t)) / (k * k + a * a)


@pytest.mark.parametrize("native", NATIVE)
@pytest.mark.parametrize("method", METHODS)
def test_what_is_stiff_and_what_is_not(method: Method, native: bool) -> None:
    """Random parameters at 1e-8, right to 1e-6: of each derivative, by the size that its parameter gives it."""
    compiled = acausal.compile(Follower())
    chance = np.random.default_rng(5)
    for k in 10.0 ** chance.uniform(0.0, 5.0, 4):
        a = chance.uniform(0.5, 3.0)
        found = acausal.sensitivities(
            compiled, ["k", "a"], ["x"], values={"k": k, "a": a}, stop_time=3.0, tolerance=1e-8, method=method,
            native=native,
        )  # fmt: skip
        exact = [followed(k + 1e-30j, a, 3.0).imag / 1e-30, followed(k, a + 1e-30j, 3.0).imag / 1e-30]
        np.testing.assert_allclose(found.final[0] * [k, a], np.multiply(exact, [k, a]), atol=1e-6)


class Oscillators(Component):
    """Forty oscillators of different frequencies, without damping: too many variables for small matrices."""

    w: Real = parameter(default=2.0)
    x: Real = variable(default=fixed(1.0), shape=20)
    v: Real = variable(default=fixed(0.0), shape=20)

    def equations(self) -> Equations:
        for k in range(20):
            own = self.w * (1 + 0.1 * k)
            yield der(self.x[k]) == own * self.v[k]
            yield der(self.v[k]) == -own * self.x[k]


@pytest.mark.parametrize("native", NATIVE)
@pytest.mark.parametrize("method", METHODS)
def test_long_smooth_runs(method: Method, native: bool) -> None:
    """x[k] = cos(w_k t), over some turns: d x / d w = -t (1 + 0.1 k) sin(w_k t); and on the way."""
    times = [4.0, 8.0]
    found = acausal.sensitivities(
        Oscillators(),
        ["w"],
        ["x[0]", "x[19]"],
        stop_time=8.0,
        tolerance=1e-9,
        method=method,
        native=native,
        times=times,
    )
    for t, along in zip(times, found.along, strict=True):
        exact = [-t * s * np.sin(2.0 * s * t) for s in (1.0, 2.9)]
        np.testing.assert_allclose(along[:, 0], exact, atol=1e-6 * t)
    np.testing.assert_allclose(found.final, found.along[-1], rtol=1e-9)


class Root(Component):
    """x' = -k y where y + c y^3 == x, as the rate of an iterated variable."""

    k: Real = parameter(default=1.5)
    c: Real = parameter(default=0.3)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.y
        yield self.y + self.c * self.y**3 == self.x


@COMPILER
@pytest.mark.parametrize("method", METHODS)
def test_iterated_variables_compiled_and_not(method: Method) -> None:
    """k t = ln(y0/y) + 3 c (y0^2 - y^2)/2: at fixed c, dy/dk = -t / (1/y + 3 c y)."""
    compiled = acausal.compile(Root())
    for native in (False, True):
        found = acausal.sensitivities(compiled, ["k", "c"], ["y"], stop_time=2.0, method=method, native=native)
        y, y0 = found.values[0], 0.8
        for _ in range(6):
            y0 -= (y0 + 0.3 * y0**3 - 1.0) / (1.0 + 0.9 * y0**2)
        assert 3.0 == pytest.approx(np.log(y0 / y) + 0.45 * (y0**2 - y**2), abs=1e-8)
        start = -(y0**3) / (1.0 + 0.9 * y0**2)  # dy0/dc at x = 1
        by_c = ((1 / y0 + 0.9 * y0) * start + 1.5 * (y0**2 - y**2)) / (1 / y + 0.9 * y)
        np.testing.assert_allclose(found.final[0], [-2.0 / (1 / y + 0.9 * y), by_c], rtol=1e-7)


class Chained(Component):
    """a + a^2 = k x and b + 2 b^2 = a, each solved by written-out Newton steps, and der(x) = -b."""

    k: Real = parameter(default=3.0)
    x: Real = variable(default=fixed(1.0))
    a: Real = variable(monotone_above=0.0)
    b: Real = variable(monotone_above=0.0)

    def equations(self) -> Equations:
        yield self.a + self.a**2 == self.k * self.x
        yield self.b + 2.0 * self.b**2 == self.a
        yield der(self.x) == -self.b


def test_derivatives_of_monotone_blocks_are_those_of_one_step() -> None:
    """By the implicit function theorem, db = da / (1 + 4 b) and da = d(k x) / (1 + 2 a); also where all is zero."""
    compiled = acausal.compile(Chained())
    assert not compiled.algebraic
    slopes = Slopes(compiled, [0])
    for x, k in ((1.0, 3.0), (20.0, 0.1), (1e-6, 5.0), (0.0, 2.0)):
        a = (cmath.sqrt(1.0 + 4.0 * k * x).real - 1.0) / 2.0
        b = (cmath.sqrt(1.0 + 8.0 * a).real - 1.0) / 4.0
        slope = -1.0 / (1.0 + 4.0 * b) / (1.0 + 2.0 * a)
        _, entries = slopes.at(0.0, np.array([x]), np.array([k]), np.zeros(compiled.n_modes))
        np.testing.assert_allclose(entries, [slope * k, slope * x], rtol=1e-12)
    # each Newton step evaluates and divides; the derivatives of all of them would cost five times the rates
    assert slopes.slopes.n_instructions() < 2 * slopes.value.n_instructions()


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
