"""States far below their nominal magnitude: absolute tolerances know nothing of them, and the run says so.

A linear oscillation has no size of its own: its closed form A cos(t) scales with A.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, variable, where
from acausal.lower.compiled import CompiledModel
from acausal.models.components.multibody import BallAndCardan
from acausal.models.stability.contact import ExplicitPenalty
from acausal.result.result import Result
from tests.marks import slow_but

STOP = 12.0


class Swing(Component):
    """x'' = -x from A; `up` is how long x was above 0.3 A."""

    A: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    up: Real = variable(default=fixed(0.0))

    def build(self) -> None:
        self.x = fixed(self.A)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield der(self.up) == where(self.x > 0.3 * self.A, 1.0, 0.0)


class SmallSwing(Component):
    """The same of a nanometre, with nominal values that say so."""

    x: Real = variable(default=fixed(1e-9), nominal=1e-9)
    v: Real = variable(default=fixed(0.0), nominal=1e-9)
    up: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield der(self.up) == where(self.x > 0.3e-9, 1.0, 0.0)


def error(r: Result, A: float) -> float:
    """Of x relative to A, and of the duration."""
    half = math.acos(0.3)
    whole, rest = divmod(STOP, 2 * math.pi)
    up = whole * 2 * half + min(rest, half) + max(rest - (2 * math.pi - half), 0.0)
    return max(float(np.abs(r["x"] / A - np.cos(r.time)).max()), abs(float(r.final("up")) - up))


@cache
def swing() -> CompiledModel:
    return acausal.compile(Swing())


def noted(r: Result) -> bool:
    return any("does not resolve" in n for n in r.stats["notes"])  # type: ignore[attr-defined]


@pytest.mark.parametrize("solver", slow_but(["idas", "rosenbrock", "erk", "cvodes"], "idas", "rosenbrock"))
@pytest.mark.parametrize("A", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_small_oscillation_is_known_or_noted(solver: str, A: float) -> None:
    for tolerance in (1e-4, 1e-6, 1e-8):
        r = acausal.simulate(swing(), parameters={"A": A}, tolerance=tolerance, stop_time=STOP, solver=solver)
        assert noted(r) or error(r, A) < max(300 * tolerance, 3e-3)  # three digits, as the page on numerics says


def test_a_declared_nominal_value_makes_it_right() -> None:
    r = acausal.simulate(SmallSwing(), tolerance=1e-6, stop_time=STOP, solver="idas")
    assert error(r, 1e-9) < 1e-4
    assert not noted(r)


def test_what_is_zero_by_symmetry_is_not_noted() -> None:
    """Bars that swing in one plane do not leave it, but for rounding."""
    r = acausal.simulate(BallAndCardan(), tolerance=1e-6, stop_time=0.2)
    assert not noted(r)


def test_what_moves_between_rows_is_not_noted() -> None:
    """A stiff contact is at rest again before the second row."""
    r = acausal.simulate(ExplicitPenalty(), tolerance=1e-6)
    assert np.abs(r["v"]).max() < 1e-9
    assert not noted(r)
