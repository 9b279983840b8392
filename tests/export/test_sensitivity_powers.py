"""Derivatives through bursts and through contacts whose force is a power of the depth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from scipy.special import beta

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    der,
    exp,
    fabs,
    fixed,
    maximum,
    no_event,
    parameter,
    structural,
    tanh,
    variable,
    where,
)
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.driver.run import Run
from acausal.simulate.native import cache
from tests.marks import slow_but

COMPILER = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
STOP = 0.5
# The solver makes the run and the method its derivatives, which are integrated again: pairs need not all be tried.
PAIRS = [("rosenbrock", "forward"), ("idas", "adjoint"), ("cvodes", "forward"), ("erk", "adjoint")]


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
    slow_but([*PAIRS, ("rosenbrock", "adjoint")], ("rosenbrock", "forward")),
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


# Pulses and their integrals.
PULSES: dict[str, tuple[Callable[[Any], Expr], float]] = {
    "tent": (lambda v: maximum(1.0 - fabs(v), 0.0), 1.0),
    "Gauss": (lambda v: exp(-(v**2)), math.sqrt(math.pi)),
    "logistic": (lambda v: 1.0 - tanh(v) ** 2, 2.0),
}


class Pulse(Component):
    """x' = 1 and y' = k F((x - c)/w), from zero on."""

    pulse: str = structural(default="tent")
    k: Real = parameter(default=1.0)
    c: Real = parameter(default=0.4)
    w: Real = parameter(default=1e-3)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == self.k * PULSES[self.pulse][0]((self.x - self.c) / self.w)


@pytest.mark.parametrize(
    ("solver", "method"),
    slow_but(PAIRS, ("rosenbrock", "forward"), ("idas", "adjoint")),
)
@pytest.mark.parametrize("pulse", PULSES)
def test_what_is_awake_for_a_moment_is_differentiated(
    pulse: str, solver: str, method: Literal["forward", "adjoint"]
) -> None:
    area = PULSES[pulse][1]
    compiled = acausal.compile(Pulse(pulse=pulse))
    for k, c, w in ((1.0, 0.3713, 1e-4), (0.0, 0.6137, 2e-3), (1e-6, 0.2, 3e-5)):
        values = {"k": k, "c": c, "w": w}
        found = acausal.sensitivities(
            compiled, ["k", "w", "c"], ["y"], stop_time=1.0, solver=solver, values=values, method=method
        )
        assert found.values[0] == pytest.approx(k * w * area, rel=1e-5, abs=1e-11)
        assert found.final[0] == pytest.approx([w * area, k * area, 0.0], rel=1e-5, abs=1e-8)


class Woken(Component):
    """A spring that begins to be bent at x = 0.3 and is let go at x = 0.3 + 2 d."""

    k: Real = parameter(default=1e3)
    d: Real = parameter(default=1e-3)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == self.k * maximum(self.d - fabs(self.x - 0.3 - self.d), 0.0)


def test_a_run_that_is_differentiated_sleeps_through_nothing() -> None:
    """y = k d^2, by k d^2, by d 2 k d: at a loose tolerance, too."""
    for tolerance in (1e-10, 1e-8, 1e-6):
        found = acausal.sensitivities(Woken(), ["k", "d"], ["y"], stop_time=1.0, tolerance=tolerance)
        assert found.result["y"][-1] == pytest.approx(1e-3, rel=1e-4)
        assert found.final[0] == pytest.approx([1e-6, 2.0], rel=1e-4)


class Unwatched(Component):
    """A tent squared, the power of which is no kink of a rate, among more choices than are watched (AC414)."""

    k: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        tent = maximum(1.0 - fabs(self.x - 0.3713) / 1e-3, 0.0)
        far = sum((where(no_event(self.x > 5.0 + 0.01 * i), self.x, 0.0) for i in range(130)), start=0.0 * self.x)
        yield der(self.x) == 1.0
        yield der(self.y) == self.k * tent * tent + far * far


@pytest.mark.slow
def test_where_kinks_cannot_be_watched_no_step_is_longer_than_those_of_the_run() -> None:
    """y(1) = k 2 w/3, by k 2 w/3."""
    found = acausal.sensitivities(Unwatched(), ["k"], ["y"], stop_time=1.0, tolerance=1e-6)
    assert "AC414" in str(found.result.stats["notes"])
    assert found.final[0, 0] == pytest.approx(2e-3 / 3.0, rel=1e-3)
