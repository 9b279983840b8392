"""Derivatives through contacts whose force is a power of the depth: slopes without bounds or with steep ends.

Law: x'' = k d**p for the depth d = -x, from the height b at the speed -v on, gives the speed back, so that
x(T) = v (T - c) - b with the duration c = 2 m/v B(1/n, 1/2)/n for n = p + 1 and the depth m = (n v^2/(2 k))^(1/n), by
the integral of dd/sqrt(v^2 - 2 k d^n/n). As c goes with k^(-1/n) v^(2/n - 1), its derivatives follow.
"""

from __future__ import annotations

from itertools import product
from typing import Any, Literal

import numpy as np
import pytest
from scipy.special import beta

import acausal
from acausal import Component, Equations, Real, der, fixed, maximum, parameter, structural, variable
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.driver.run import Run
from acausal.simulate.native import cache
from tests.marks import slow_but

COMPILER = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
STOP = 0.5


class Contact(Component):
    """A unit mass that falls on a spring without gravity."""

    p: float = structural(default=1.5)
    k: Real = parameter(default=1e4)
    b: Real = parameter(default=0.1)
    speed: Real = parameter(default=1.0)
    x: Real = variable()
    v: Real = variable()

    def initial_equations(self) -> Equations:
        yield self.x == self.b
        yield self.v == -self.speed

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == self.k * maximum(-self.x, 0.0) ** self.p


def closed(p: float) -> list[float]:
    """d x(STOP) by k, b and speed."""
    n, k, v = p + 1.0, 1e4, 1.0
    c = 2.0 * (n * v**2 / (2.0 * k)) ** (1.0 / n) / v * beta(1.0 / n, 0.5) / n
    return [v * c / n / k, -1.0, STOP - c - c * (2.0 / n - 1.0)]


@pytest.mark.parametrize(
    ("solver", "method"),
    slow_but(product(["rosenbrock", "idas", "cvodes", "erk"], ["forward", "adjoint"]), ("rosenbrock", "forward")),
)
@pytest.mark.parametrize("p", [1.2, 1.5, 2.0])
def test_a_power_of_the_depth(p: float, solver: str, method: Literal["forward", "adjoint"]) -> None:
    """Relative errors of a hundred tolerances; before steps knew of the variations, 6e-4 (p = 1.2) at 1e-10."""
    for tolerance in (1e-8, 1e-10):
        found = acausal.sensitivities(
            Contact(p=p), ["k", "b", "speed"], ["x"], stop_time=STOP, tolerance=tolerance, solver=solver, method=method,
            native=False, times=[STOP],
        )  # fmt: skip
        np.testing.assert_allclose(found.final[0], closed(p), rtol=100 * tolerance)
        np.testing.assert_allclose(found.along[0], found.final, rtol=100 * tolerance)


@COMPILER
@pytest.mark.parametrize("method", ["forward", "adjoint"])
def test_the_same_compiled(method: Literal["forward", "adjoint"]) -> None:
    compiled = acausal.compile(Contact(p=1.5))
    for tolerance in (1e-6, 1e-8, 1e-10, 1e-12):
        found = acausal.sensitivities(
            compiled, ["k", "b", "speed"], ["x"], stop_time=STOP, tolerance=tolerance, method=method, native=True
        )
        np.testing.assert_allclose(found.final[0], closed(1.5), rtol=100 * tolerance)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
def test_an_infinite_slope_at_an_event_is_noted(tolerance: float) -> None:
    """The root of the depth: what it adds to derivatives within the error of the touch is not known."""
    found = acausal.sensitivities(Contact(p=0.5), ["k", "b"], ["x"], stop_time=STOP, tolerance=tolerance, native=False)
    notes: Any = found.result.stats["notes"]
    error = np.abs(found.final[0] / closed(0.5)[:2] - 1.0).max()
    assert error < 1e-5 or any("derivatives are uncertain" in note for note in notes)
    assert not np.isnan(error)


@pytest.mark.slow
def test_a_touch_on_a_row_is_no_jump() -> None:
    """A drill whose force is steep at its touch; `idas` has a row there, which was taken for a jump (AC615)."""
    model = acausal.compile(ThickBlock())
    names, outputs = ("drill.d", "drill.k_c11"), ("slide.s",)
    found = [
        acausal.sensitivities(model, names, outputs, tolerance=1e-8, solver=solver, native=False).final
        for solver in ("idas", "rosenbrock")
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-5)


class Forgetful(Component):
    """A contact with an infinite slope, and what follows `a` in a hundredth of a second, pushed by the contact."""

    b: Real = parameter(default=0.1)
    a: Real = parameter(default=2.0)
    x: Real = variable()
    v: Real = variable(default=fixed(-1.0))
    y: Real = variable(default=fixed(0.0))

    def initial_equations(self) -> Equations:
        yield self.x == self.b

    def equations(self) -> Equations:
        depth = maximum(-self.x, 0.0)
        yield der(self.x) == self.v
        yield der(self.v) == 1e4 * depth**0.5
        yield der(self.y) == 100.0 * (self.a - self.y) + depth


@pytest.mark.parametrize(
    ("method", "native"),
    [pytest.param("forward", False, marks=pytest.mark.slow), pytest.param("adjoint", True, marks=COMPILER)],
)
def test_what_has_decayed_needs_no_second_run(
    method: Literal["forward", "adjoint"], native: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the touch leaves uncertain decays by e**-35 in y, where y is a to that; in x it stays."""
    runs = []

    def counted(*arguments: Any, **named: Any) -> Run:
        runs.append(Run(*arguments, **named))
        return runs[-1]

    monkeypatch.setattr("acausal.export.sensitivity.sensitivities.Run", counted)
    for output, count in (("y", 1), ("x", 2)):
        runs.clear()
        found = acausal.sensitivities(
            Forgetful(), ["b", "a"], [output], stop_time=STOP, tolerance=1e-8, native=native, method=method
        )
        assert len(runs) == count
        if output == "y":
            np.testing.assert_allclose(found.final[0], [0.0, 1.0], atol=1e-8)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
def test_derivatives_on_the_way_are_right_or_noted(tolerance: float) -> None:
    """y = a (1 - exp(-100 t)) + Y(t - b), as the touch is at b: dy/db = -Y', which the end has forgotten."""
    times = [0.05, 0.102, 0.11, 0.2]
    found = acausal.sensitivities(
        Forgetful(), ["b"], ["y"], times=times, stop_time=STOP, tolerance=tolerance, native=False
    )
    x, y = (found.result.at(np.array(times), name) for name in ("x", "y"))
    exact = np.array(times) > 0.1, 100.0 * (2.0 - y) + np.maximum(-x, 0.0) - 200.0 * np.exp(-100.0 * np.array(times))
    error = np.abs(found.along[:, 0, 0] + exact[0] * exact[1]).max() / np.abs(found.along[:, 0, 0]).max()
    notes: Any = found.result.stats["notes"]
    assert error < 100 * tolerance or any("derivatives are uncertain" in note for note in notes)
