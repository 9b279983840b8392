"""Derivatives of what is awake for a moment only: the steps of a variation end where the run has found it.

Law: the integral of k F((x - c)/w), as x passes c at the rate 1, is k w times the integral of F: so are its derivatives
by k and w, and that by c is zero. The states know little of it where k is small, and nothing where it is zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import Any, Literal

import pytest

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
from tests.marks import slow_but

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
    slow_but(
        product(["rosenbrock", "idas", "cvodes", "erk"], ["forward", "adjoint"]),
        ("rosenbrock", "forward"),
        ("idas", "adjoint"),
    ),
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
