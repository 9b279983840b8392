"""The estimated error of a step against closed forms: contacts, kinks, stiff parts, bodies at rest, and its C."""

from __future__ import annotations

import math
import random
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    cos,
    der,
    fixed,
    parameter,
    pre,
    reset,
    sin,
    tanh,
    time,
    variable,
    when,
    where,
)
from acausal.export.step.source import StepFunction
from acausal.simulate.native import cache
from tests.stepping import walk

METHODS = ("rk2", "rk4", "rosenbrock", "sdirk")


def run(step: StepFunction, count: int) -> tuple[NDArray[np.float64], float, bool]:
    """(x after `count` steps, sum of the estimated errors, whether a flag was set)."""
    found = walk(step, count)
    x = np.array([found[name][-1] for name in step.x.names])
    return x, float(found["step.error"].sum()), any(found[name].any() for name in step.y.names[:-1])


class Struck(Component):
    """A mass that flies against a spring, and is back with its speed after half a period."""

    w: Real = parameter(default=100.0 * math.sqrt(10.0), unit="rad/s")
    x: Real = variable(default=fixed(0.1))
    v: Real = variable(default=fixed(-1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where(self.x < 0.0, -self.w * self.w * self.x, 0.0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("h", [1e-3, 3e-3, 5e-3, 1.39e-2])
def test_a_contact_that_a_step_does_not_resolve_is_told(method: str, h: float) -> None:
    # half a period is 10 ms; sdirk gives back 0.91 in steps of 3 ms, 0.15 in one of 14 ms
    step = acausal.step_function(acausal.compile(Struck()), h, method, [])
    x, total, flagged = run(step, math.ceil(0.12 / h))
    off = abs(x[step.x.position("v")] - 1.0)
    assert off > 5e-5
    assert flagged or off / 5 < total < 30 * off


class Bent(Component):
    """The integral of |x - s| with x = t."""

    s: Real = parameter(default=0.5)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == abs(self.x - self.s)


@pytest.mark.parametrize("method", METHODS)
def test_a_kink_shows_wherever_in_a_step_it_is(method: str) -> None:
    step, draw = acausal.step_function(acausal.compile(Bent()), 1.0, method, []), random.Random(method)
    place, p = step.x.position("y"), np.array(step.p.start)
    functions = acausal.compile(Bent()).casadi()
    for _ in range(100):
        s = p[step.p.position("s")] = draw.random()
        x, y = (np.asarray(v).ravel() for v in step.function(step.x.start, [], p))
        off = abs(x[place] - (s * s + (1 - s) ** 2) / 2)
        assert off <= 1.5 * y[-1] <= 1.0
        if method == "rk4":
            assert float(functions.step_error(functions.x.start, [], p, 1.0)) == pytest.approx(y[-1], rel=1e-12)


class Turning(Component):
    """x = cos t, forced and free."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield der(self.y) == -self.y + sin(3.0 * time)


@pytest.mark.parametrize(("method", "order"), [("rk2", 3), ("rk4", 4), ("rosenbrock", 4), ("sdirk", 3)])
def test_the_estimate_falls_with_its_power_of_the_step(method: str, order: int) -> None:
    sums = [run(acausal.step_function(acausal.compile(Turning()), 0.1 / n, method, []), 20 * n)[1] for n in (1, 4)]
    assert math.log(sums[0] / sums[1], 4) == pytest.approx(order - 1, abs=0.25)


class Stiff(Component):
    """x' = -a (x - cos t) - sin t from x = 1: x = cos t (A. Prothero, A. Robinson, Math. Comp. 28 (1974) 145-162)."""

    a: Real = parameter(default=1e6)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.a * (self.x - cos(time)) - sin(time)


@pytest.mark.parametrize("method", ["rosenbrock", "sdirk"])
def test_errors_of_stiff_parts_are_not_multiplied_by_their_stiffness(method: str) -> None:
    # the unresolved part of a step, h^2 / 8 of a chord, at most in each of 100; then with a transient of 0.1
    step = acausal.step_function(acausal.compile(Stiff()), 0.01, method, [])
    for start, most in ((1.0, 2e-3), (1.1, 1.0)):
        first, second = step.x.names
        found = walk(step, 100, start={first: start, second: 0.0})
        assert abs(found[first][-1] - math.cos(1.0)) < found["step.error"].sum() < most


class Layer(Component):
    """x leaves a layer of a thousandth, in which its rate falls from 8 to 5, within a tenth of a millisecond."""

    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 8.0 - 3.0 * tanh(950.0 * self.x)


@pytest.mark.parametrize("method", ["rosenbrock", "sdirk"])
@pytest.mark.parametrize("h", [2.5e-3, 5e-3])
def test_a_layer_that_is_left_before_the_first_look_is_told(method: str, h: float) -> None:
    # t = int_0^x dx / (8 - 3 tanh(950 x))
    def elapsed(x: float) -> float:
        return float(quad(lambda s: 1.0 / (8.0 - 3.0 * math.tanh(950.0 * s)), 0.0, x, points=[1e-3], epsabs=1e-13)[0])

    exact = float(brentq(lambda x: elapsed(x) - h, 4.0 * h, 8.0 * h, xtol=1e-13))
    x, total, flagged = run(acausal.step_function(acausal.compile(Layer()), h, method, []), 1)
    assert not flagged
    assert 1e-4 < abs(x[0] - exact) < total < 5e-2


class Pressed(Component):
    """A body that lies still, and a mass that rests on a spring at it."""

    k: Real = parameter(default=1000.0)
    h: Real = variable(default=fixed(1e-9))
    v: Real = variable(default=fixed(0.0))
    x: Real = variable(default=fixed(0.0))
    w: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -400.0
        yield when(self.h < 0.0, reset(self.v, -0.1 * pre(self.v)))
        yield der(self.x) == self.w
        yield der(self.w) == -self.k * (self.x - self.h)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("h", [1e-3, 5e-3])
def test_a_body_at_rest_tells_that_it_falls_within_a_step(method: str, h: float) -> None:
    # a mean fall of 400 h^2 / 6 pulls at the spring, and the mass swings about that; stages of rk2 do not see it fall
    step = acausal.step_function(acausal.compile(Pressed()), h, method, [])
    x, total, _ = run(step, round(0.1 / h))
    assert x[step.x.position("h")] == 0.0
    assert method == "rk2" or abs(x[step.x.position("x")]) > 1e-6
    assert abs(x[step.x.position("x")]) < total < 400.0 * h


def test_a_body_at_rest_alone_has_no_error() -> None:
    class Lying(Component):
        h: Real = variable(default=fixed(1e-5))
        v: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.h) == self.v
            yield der(self.v) == -9.81
            yield when(self.h < 0.0, reset(self.v, -0.1 * pre(self.v)))

    for method in METHODS:
        step = acausal.step_function(acausal.compile(Lying()), 2e-3, method, [])
        x, before, _ = run(step, 10)
        after = run(step, 500)[1]
        assert after - before < 1e-12
        assert not x[:2].any()


@pytest.mark.parametrize("method", METHODS)
def test_without_the_estimate_a_step_is_the_same(method: str) -> None:
    for model in (Struck(), Turning()):
        whole, bare = (
            acausal.step_function(acausal.compile(model), 3e-3, method, ["x"], error=e) for e in (True, False)
        )
        assert whole.y.names == (*bare.y.names, "step.error")
        x, p = np.array(whole.x.start), np.array(whole.p.start)
        for _ in range(50):
            (x, y), (other, less) = ((np.asarray(v).ravel() for v in step.function(x, [], p)) for step in (whole, bare))
            np.testing.assert_array_equal(x, other)
            np.testing.assert_array_equal(y[:-1], less)
        counts = [s.function.expand().n_instructions() for s in (whole, bare)]
        assert counts[1] < counts[0]


class Looped(Component):
    """An oscillator against a stop, with a nonlinear equation."""

    x: Real = variable(default=fixed(0.5))
    v: Real = variable(default=fixed(0.0))
    q: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -30.0 * self.q
        yield self.q + 0.3 * self.q**3 == self.x
        yield when(self.x < -0.2, reset(self.v, -0.5 * pre(self.v)))


@pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("method", ["rk4", "sdirk"])
def test_c_tells_the_same(method: str, tmp_path: Path) -> None:
    step = acausal.step_function(acausal.compile(Looped()), 0.01, method, [])
    step.save(tmp_path / "looped.c")
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include <string.h>\n#include "looped.c"\n'
        "int main(void) { double x[LOOPED_NX], n[LOOPED_NX], u[1], y[LOOPED_NY]; int k;\n"
        "memcpy(x, looped_x0, sizeof x);\n"
        "for (k = 0; k < 60; ++k) { looped_step(x, u, looped_p0, n, y); memcpy(x, n, sizeof x);\n"
        'printf("%.17g\\n", y[LOOPED_NY - 1]); } return 0; }\n'
    )
    program = tmp_path / "main"
    subprocess.run([str(cache.compiler()), "-O0", "-o", program, tmp_path / "main.c", "-lm"], check=True)
    told = [float(v) for v in subprocess.run([program], capture_output=True, text=True, check=True).stdout.split()]
    own = walk(step, 60)["step.error"]
    np.testing.assert_allclose(told, own, rtol=1e-9, atol=1e-15)
    assert min(own) > 0
