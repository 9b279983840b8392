"""Equations, relations and states far below or above one are solved, located and told of like others."""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    der,
    fabs,
    fixed,
    guess,
    integer,
    maximum,
    parameter,
    pre,
    reset,
    sin,
    time,
    variable,
    when,
    where,
)
from acausal.lower.compiled import CompiledModel
from acausal.models.components.multibody import BallAndCardan
from acausal.models.stability.contact import ExplicitPenalty
from acausal.result.result import Result
from tests.marks import slow_but
from tests.stepping import walk


class Scaled(Component):
    """Two iterated unknowns, an open start, and a relation of one of them; each equation times a factor."""

    a: Real = parameter(default=1.0)
    b: Real = parameter(default=1.0)
    c: Real = parameter(default=1.0)
    x: Real = variable()
    y: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(0.1))
    w: Real = variable(default=guess(0.1))
    late: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.a * (self.z + self.z**3) == self.a * (2.0 + 0.2 * self.w + sin(3.0 * time))
        yield self.b * (self.w + sin(self.w)) == self.b * (self.z**2 + self.y)
        yield der(self.y) == -self.z
        yield der(self.x) == self.w - self.x
        yield der(self.late) == where(self.w < 0.5, 1.0, 0.0)

    def initial_equations(self) -> Equations:
        yield self.c * (self.x**3 + self.x) == self.c * 3.0 * self.z


Z_AT_START = 1.0264563309805055
FACTORS = [(1e-9, 1.0, 1.0), (1e-14, 1e-14, 1e-14), (1.0, 1e-11, 1e-9), (1e-17, 1e-18, 1e-16), (1e9, 1e-9, 1e6)]


@pytest.fixture(scope="module")
def plain() -> acausal.Result:
    return acausal.simulate(Scaled(), stop_time=1.0, tolerance=1e-9)


@pytest.mark.parametrize(("a", "b", "c"), FACTORS)
@pytest.mark.parametrize("solver", ["erk", "rosenbrock"])
def test_factors_of_equations_change_no_run(plain: acausal.Result, a: float, b: float, c: float, solver: str) -> None:
    run = acausal.simulate(Scaled(a=a, b=b, c=c), stop_time=1.0, solver=solver, tolerance=1e-9)
    z, w, x = (np.asarray(run[name]) for name in ("z", "w", "x"))
    np.testing.assert_allclose(z + z**3, 2.0 + 0.2 * w + np.sin(3.0 * run.time), atol=1e-7)
    np.testing.assert_allclose(w + np.sin(w), z**2 + np.asarray(run["y"]), atol=1e-7)
    assert x[0] ** 3 + x[0] == pytest.approx(3.0 * z[0], abs=1e-8)
    for name in ("x", "y", "late"):
        assert run.final(name) == pytest.approx(plain.final(name), abs=1e-7)
    assert not run.stats["notes"]


@pytest.mark.parametrize(("a", "b", "c"), FACTORS)
def test_factors_of_equations_change_no_exported_function(a: float, b: float, c: float) -> None:
    made = acausal.compile(Scaled(a=a, b=b, c=c)).casadi()
    x0, z0 = made.init(made.p.start)
    values = dict(zip((port.name for port in (*made.x, *made.z)), np.array(ca.vertcat(x0, z0)).ravel(), strict=True))
    assert values["x"] ** 3 + values["x"] == pytest.approx(3.0 * Z_AT_START, abs=1e-9)
    away = np.array(made.x.start)
    away[made.x.position("y")] = -0.7
    rates = np.array(made.ode(0.5, away, [], made.p.start)[0]).ravel()
    z = -rates[made.x.position("y")]
    w = rates[made.x.position("x")] + away[made.x.position("x")]
    assert z + z**3 == pytest.approx(2.0 + 0.2 * w + np.sin(1.5), abs=1e-9)
    assert w + np.sin(w) == pytest.approx(z**2 - 0.7, abs=1e-9)


class Compared(Component):
    """An oscillator with relations in `where`, `when`, a boolean, and kinks; both sides of each times c."""

    c: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    fast: Real = boolean()
    y: Real = variable(default=fixed(0.0))
    f: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        c = self.c
        yield der(self.x) == self.v
        yield der(self.v) == -9.0 * self.x - where(c * self.x > c * 0.3, 0.5, -0.2) * self.v
        yield self.fast == (c * self.v > c * 0.4)
        yield der(self.y) == where(self.fast, 1.0, 0.0)
        yield der(self.f) == maximum(c * (self.x - 0.5), 0.0) / c + fabs(c * self.v) / c
        yield when(
            c * sin(self.x) >= c * 0.1 * (1.0 + time),
            reset(self.n, pre(self.n) + 1),
            reset(self.v, 0.9 * pre(self.v)),
        )


SIGNALS = ["x", "v", "y", "f", "n"]


@pytest.fixture(scope="module")
def unscaled() -> acausal.Result:
    return acausal.simulate(Compared(), stop_time=4.0, tolerance=1e-8)


@pytest.mark.parametrize("c", [1e-22, 1e12])
@pytest.mark.parametrize(("solver", "native"), [("erk", False), ("rosenbrock", True), ("idas", False)])
def test_factors_of_relations_change_no_run(unscaled: acausal.Result, c: float, solver: str, native: bool) -> None:
    run = acausal.simulate(Compared(), stop_time=4.0, tolerance=1e-8, solver=solver, native=native, parameters={"c": c})
    assert len(run.events) == len(unscaled.events)
    for name in SIGNALS:
        assert run.final(name) == pytest.approx(unscaled.final(name), abs=1e-6)


@pytest.mark.parametrize("c", [1e-15, 1e-22])
def test_factors_of_relations_change_no_exported_step(c: float) -> None:
    step = acausal.step_function(acausal.compile(Compared()), 1e-3, "rk4", SIGNALS)
    runs = [walk(step, 2000, p={"c": factor}) for factor in (1.0, c)]
    found = [[run[name][-1] for name in SIGNALS] for run in runs]
    assert found[0][-1] >= 1.0
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)


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
