"""Other parameters in a compiled model: results are those of its equations, or there are none."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, cos, der, fixed, parameter, step_function, variable
from acausal.arrays import Vector
from acausal.errors import AcausalError
from acausal.lower.cache.divisors import LOST, shrunken_divisor
from acausal.optimal_control import Problem
from acausal.simulate.native import cache


class Pair(Component):
    """Two linear equations; a b c d > 0, so that their determinant a d + b c does not cancel."""

    a: Real = parameter(default=0.3)
    b: Real = parameter(default=1.7)
    c: Real = parameter(default=0.9)
    d: Real = parameter(default=2.3)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable()
    w: Real = variable()

    def equations(self) -> Equations:
        size = self.size()
        yield self.a * size * self.v + self.b * size * self.w == self.x
        yield self.d * size * self.w - self.c * size * self.v == 1.0
        yield der(self.x) == -self.x

    def size(self) -> Any:
        return 1.0


class BentPair(Pair):
    """With an unknown that is left to Newton's method."""

    y: Real = variable(default=0.5)

    def equations(self) -> Equations:
        yield self.y + self.y**3 == self.x


class MovingPair(Pair):
    """With pivots that vary with x."""

    def size(self) -> Any:
        return 2.0 + cos(self.x)


def check(evaluate: Callable[[Vector], Vector], x: float) -> None:
    """Compare `(v, w)` with Cramer's rule where it is a number, for parameters of which one has shrunk."""
    random = np.random.default_rng(7)
    refused = 0
    for k in range(80):
        a, b, c, d = p = random.uniform(0.5, 2.0, 4)
        p[k % 4] *= 10.0 ** random.uniform(-18.0, 0.0)
        a, b, c, d = p
        exact = np.array([d * x - b, a + c * x]) / (a * d + b * c)
        found = evaluate(p)
        refused += bool(np.isnan(found).all())
        assert np.isnan(found).all() or np.abs(found - exact).max() < 1e-6 * np.abs(exact).max() + 1e-6, (p, found)
    assert 5 < refused < 40


@pytest.mark.parametrize("model", [Pair, BentPair])
def test_exported_functions_are_right_or_nan(model: type[Pair]) -> None:
    """The system is well-conditioned, but with a pivot of 1e-17 v was 0, or anything."""
    compiled = acausal.compile(model(), cache=False)
    made, stepped = compiled.casadi(outputs=["v", "w"]), step_function(compiled, 0.1, "rk2", ["v", "w"])

    def filled(p: Vector) -> Vector:
        return np.array([*p, *made.p.start[4:]])

    after, z = 0.8 * (1.0 - 0.1 + 0.1**2 / 2), made.z.start
    check(lambda p: np.array(made.ode([0.8], [], filled(p))[1]).ravel(), 0.8)
    check(lambda p: np.array(made.outputs([0.8], z, [], filled(p))).ravel(), 0.8)
    check(lambda p: np.array(stepped.function([0.8, *z], [], filled(p))[1]).ravel()[:2], after)
    for name, f in (*made.functions.items(), ("step_function", stepped.function)):
        for p, unusable in ((np.ones(4), np.isfinite), (np.array([1e-17, 1.0, 1.0, 1.0]), np.isnan)):
            results = f.call([ca.DM(filled(p)) if n == "p" else ca.DM.ones(f.sparsity_in(n)) for n in f.name_in()])
            assert all(unusable(np.array(r)).all() for r in results), name


def test_derivatives_do_not_see_the_check() -> None:
    """By Cramer's rule dv/da = -v d/(a d + b c)."""
    made = acausal.compile(Pair()).casadi(outputs=["v", "w"])
    slope = made.outputs.factory("slope", made.outputs.name_in(), ["jac:y:p"])
    p = made.p.start
    v = float(made.outputs([0.8], [], [], p)[0])
    assert float(slope([0.8], [], [], p)[0, 0]) == pytest.approx(-v * p[3] / (p[0] * p[3] + p[1] * p[2]), rel=1e-12)


@pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")
def test_exported_c_is_right_or_nan(tmp_path: Path) -> None:
    made = acausal.compile(Pair()).casadi(outputs=["v", "w"])
    for name, text in made.source().items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    library = tmp_path / "pair.so"
    subprocess.run([str(cache.compiler()), "-shared", "-fPIC", tmp_path / "pair.c", "-o", library, "-lm"], check=True)
    function: Any = ctypes.CDLL(str(library)).pair_ode
    vector = ctypes.c_double * len(made.p)

    def evaluate(p: Vector) -> Vector:
        rates, y = vector(), vector()
        failed = function(vector(0.8), vector(), vector(*p, *made.p.start[4:]), rates, y)
        assert failed == np.isnan(y[0])
        return np.array(y[:2])

    check(evaluate, 0.8)


def test_factors_of_pivots_that_vary() -> None:
    made = acausal.compile(MovingPair()).casadi(outputs=["v", "w"])
    size = 2.0 + np.cos(0.8)
    check(lambda p: size * np.array(made.outputs([0.8], [], [], [*p, *made.p.start[4:]])).ravel(), 0.8)


def test_runs_are_right_or_refused() -> None:
    compiled = acausal.compile(Pair())

    def evaluate(p: Vector) -> Vector:
        values = dict(zip("abcd", p, strict=True))
        if shrunken_divisor(compiled, [*p, *compiled.parameter_values[4:]], LOST):
            with pytest.raises(AcausalError, match="AC029"):
                acausal.simulate(compiled, parameters=values, stop_time=1e-3)
            return np.full(2, np.nan)
        result = acausal.simulate(compiled, parameters=values, stop_time=1e-3)
        return np.array([result["v"][0], result["w"][0]])

    check(evaluate, 1.0)


class Alone(Component):
    """A mass alone in its row, a time constant, and a small resistance, each as small as it likes."""

    m: Real = parameter(default=1.0)
    tau: Real = parameter(default=1.0)
    R: Real = parameter(default=1.0)
    v: Real = variable(default=fixed(0.0))
    a: Real = variable()
    i: Real = variable()

    def equations(self) -> Equations:
        yield self.m * self.a == self.m * self.i * self.R / self.tau
        yield self.R * self.i == 1.0 - self.v
        yield der(self.v) == self.a


@pytest.mark.parametrize("size", [1e-9, 1e-15])
def test_lone_divisors_may_be_as_small_as_they_like(size: float) -> None:
    """v = 1 - exp(-t/tau), whatever m and R are: nothing is added to a quotient by them."""
    compiled, tau = acausal.compile(Alone(tau=1.0)), size
    values = {"m": size, "R": size, "tau": tau}
    result = acausal.simulate(compiled, parameters=values, stop_time=3.0 * tau, tolerance=1e-9)
    assert result.final("v") == pytest.approx(1.0 - np.exp(-3.0), abs=1e-7)
    made = compiled.casadi(outputs=["v", "a"])
    assert float(made.ode([0.5], [], [size, tau, size, *made.p.start[3:]])[0]) == pytest.approx(0.5 / tau, rel=1e-14)


class Cancelled(Alone):
    """A lone divisor that is a difference."""

    b: Real = parameter(default=0.5)
    y: Real = variable()

    def equations(self) -> Equations:
        yield (0.3 - 0.2 - self.b) * self.y == self.v


def test_a_lone_difference_that_cancels_is_refused() -> None:
    """0.3 - 0.2 - 0.1 is -3e-17: the equation does not determine y."""
    compiled = acausal.compile(Cancelled())
    with pytest.raises(AcausalError, match="AC029"):
        acausal.simulate(compiled, parameters={"b": 0.1}, stop_time=0.1)
    made = compiled.casadi(outputs=["y"])
    p = [0.1 if n == "b" else v for n, v in zip(made.p.names, made.p.start, strict=True)]
    assert np.isnan(float(made.outputs([0.5], [], [], p)))


def test_optimal_parameters_are_refused_where_the_equations_lose_their_digits() -> None:
    """At the smallest a, v was a rounding error, with a note that nothing had been checked."""
    problem = Problem(acausal.compile(Pair()))
    problem.phase(duration=1.0)
    problem.minimize(problem.decide("a", min=1e-14, max=1.0))
    with pytest.raises(AcausalError, match="AC029"):
        problem.solve()
