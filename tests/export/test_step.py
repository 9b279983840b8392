"""Step functions: order of the methods, the C they become, what cannot be exported."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Experiment, Real, der, fixed, parameter, signal_input, time, variable, where
from acausal.errors import ExportError, UsageError
from acausal.export.step.real_time import real_time
from acausal.export.step.step import step_function
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.pendulum import Pendulum
from acausal.models.rc_ladder import RCLadder
from acausal.simulate.native import cache
from tests.stepping import walk

needs_compiler = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")


class Driven(Component):
    """x' = a (u - x) + cos t, with x observed twice as large through an algebraic loop."""

    a: Real = parameter(default=3.0, unit="1/s")
    u: Real = signal_input()
    x: Real = variable(default=fixed(1.0))
    q: Real = variable()

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.a * (self.u - self.x) + self.a * acausal.cos(self.a * acausal.time) / 3.0
        yield self.q + 0.1 * self.q * self.q * self.q == self.x


def end(method: str, h: float, formulation: str = "torn", stop: float = 2.0) -> float:
    step = step_function(acausal.compile(Pendulum(), formulation=formulation), h, method)
    return float(walk(step, round(stop / h))["revolute.phi"][-1])


@pytest.mark.parametrize("formulation", ["torn", "dae"])
@pytest.mark.parametrize(("method", "order"), [("rk2", 2.0), ("rk4", 4.0), ("rosenbrock", 3.0), ("sdirk", 2.0)])
def test_errors_fall_with_the_order_of_the_method(method: str, order: float, formulation: str) -> None:
    exact = float(
        acausal.simulate(Pendulum(), tolerance=1e-11, solver="rosenbrock", stop_time=2.0).final("revolute.phi")
    )
    coarse, fine = (abs(end(method, h, formulation) - exact) for h in (0.01, 0.005))
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.2)


def test_time_and_algebraic_variables_travel_in_x_and_inputs_are_held() -> None:
    step = step_function(acausal.compile(Driven()), 0.01, "rk4", ["x", "q"])
    assert step.x.names == ("x", "q", "time")
    assert step.u.names == ("u",)
    found = {name: values[-1] for name, values in walk(step, 200, [0.5]).items()}
    assert found["time"] == pytest.approx(2.0)
    run = acausal.simulate(Driven(), inputs={"u": 0.5}, tolerance=1e-11, solver="rosenbrock")
    assert found["x"] == pytest.approx(run.final("x"), abs=1e-8)
    assert step.y.names == ("x", "q", "step.too_large", "step.unconverged", "step.error")
    assert found["step.too_large"] == found["step.unconverged"] == 0.0
    assert found["q"] + 0.1 * found["q"] ** 3 == pytest.approx(found["x"], abs=1e-14)
    x, y = step.function(step.x.start, [0.5], step.p.start)
    np.testing.assert_allclose(np.array(y).ravel()[:2], np.array(x).ravel()[:2], atol=1e-15)


def test_a_stiff_method_stands_steps_far_beyond_the_explicit_limit() -> None:
    # eigenvalues of the ladder reach -4/(R C); R = C = 1: rk4 is stable below 0.7 s
    model = acausal.compile(RCLadder(n=4))
    for method, stable in (("rosenbrock", True), ("sdirk", True), ("rk4", False)):
        step = step_function(model, 2.0, method)
        found = walk(step, 100)
        assert np.allclose([found[name][-1] for name in step.x.names], 1.0, atol=1e-6) == stable


@pytest.mark.parametrize(("method", "limit"), [("rk2", 2.0), ("rk4", 2.785)])
def test_a_step_beyond_the_explicit_limit_says_so(method: str, limit: float) -> None:
    # x' = -50 x: stable up to limit / 50 (Hairer and Wanner II, IV.2)
    class Decay(Component):
        x: Real = variable(default=fixed(1.0))

        def equations(self) -> Equations:
            yield der(self.x) == -50.0 * self.x

    for share, expected in ((0.9, 0.0), (1.1, 1.0)):
        step = step_function(acausal.compile(Decay()), share * limit / 50.0, method, ["x"])
        y = step.function(step.x.start, [], step.p.start)[1]
        assert float(y[step.y.position("step.too_large")]) == expected


class Oscillating(Component):
    """x'' = -w^2 x - 2 d w x', in units in which the speed is small or large."""

    w: Real = parameter(default=1.0)
    d: Real = parameter(default=0.0)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -(self.w**2) * self.x - 2.0 * self.d * self.w * self.v


@pytest.mark.parametrize("w", [1e-3, 1.0, 100.0])
@pytest.mark.parametrize(
    ("method", "reach", "d", "large"),
    [
        ("rk4", 0.1, 0.0, 0),
        ("rk4", 2.7, 0.0, 0),
        ("rk4", 2.95, 0.0, 1),
        ("rk4", 2.2, 0.7, 0),
        ("rk4", 3.2, 0.7, 1),
        ("rk2", 0.1, 0.0, 0),
        ("rk2", 0.4, 0.0, 1),
        ("rk2", 1.2, 0.7, 0),
        ("rk2", 2.2, 0.7, 1),
    ],
)
def test_oscillations_are_unstable_where_the_stability_function_says_so(
    method: str, reach: float, d: float, large: int, w: float
) -> None:
    # |1 + z + z^2/2 (+ z^3/6 + z^4/24)| at z = h w (-d + i sqrt(1 - d^2)), Hairer and Wanner, IV.2; whatever the units
    z = reach * complex(-d, math.sqrt(1 - d * d))
    size = abs(sum(z**k / math.factorial(k) for k in range(3 if method == "rk2" else 5)))
    assert large == (math.log(size) > 0.003 * reach)
    compiled = acausal.compile(Oscillating(w=w, d=d))
    made = step_function(compiled, reach / w, method)
    assert walk(made, 20)["step.too_large"].tolist() == [large] * 20
    if method == "rk4":  # `casadi()` says the same
        model = compiled.casadi()
        assert float(model.too_large(model.x.start, [], model.p.start, reach / w)) == large


def test_a_drill_passes_its_contact_in_steps_that_say_they_are_too_large() -> None:
    """`simulate` refuses 10 ms for this drill (AC405)."""
    step = step_function(acausal.compile(ThickBlock()), 0.01, "rk4", [])
    assert walk(step, 3000)["step.too_large"].max() == 1.0


@pytest.mark.parametrize("method", ["rk2", "rk4", "rosenbrock", "sdirk"])
def test_the_c_has_no_loop_and_no_allocation(method: str) -> None:
    code = step_function(acausal.compile(Pendulum(), formulation="dae"), 1e-3, method).source()
    body = code[code.index("*/") :]
    assert not [word for word in ("for (", "while", "do {", "goto", "alloc", "static double") if word in body]
    assert "void pendulum_step(const double* x, const double* u, const double* p, double* x_next, double* y)" in body
    assert "x[0]  revolute.phi [rad]" in code


@needs_compiler
def test_the_c_stands_alone_and_gives_the_same_numbers(tmp_path: Path) -> None:
    step = step_function(acausal.compile(Driven()), 0.01, "rk4", ["q"])
    step.save(tmp_path / "driven.c")
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include <string.h>\n#include "driven.c"\n'
        "int main(void) { double x[DRIVEN_NX], n[DRIVEN_NX], u[1] = {0.5}, y[DRIVEN_NY]; int k;\n"
        "memcpy(x, driven_x0, sizeof x);\n"
        "for (k = 0; k < 200; ++k) { driven_step(x, u, driven_p0, n, y); memcpy(x, n, sizeof x); }\n"
        'printf("%.17g %.17g\\n", x[0], y[0]); return 0; }\n'
    )
    program = tmp_path / "main"
    subprocess.run([str(cache.compiler()), "-O1", "-o", program, tmp_path / "main.c", "-lm"], check=True)
    x0, y0 = map(float, subprocess.run([program], capture_output=True, text=True, check=True).stdout.split())
    found = walk(step, 200, [0.5])
    assert x0 == pytest.approx(found[step.x.names[0]][-1], rel=1e-14)
    assert y0 == pytest.approx(found[step.y.names[0]][-1], rel=1e-14)


@needs_compiler
def test_compiled_steps_are_timed_one_by_one() -> None:
    step = step_function(acausal.compile(Pendulum()), 1e-3, "rk4")
    times, x = real_time(step, 2000)
    assert times.steps == 2000
    assert 0 < times.median <= times.worst
    assert times.factor == pytest.approx(1e-3 / times.mean)
    assert times.worst_factor <= times.factor
    assert x[0] == pytest.approx(end("rk4", 1e-3), abs=1e-12)


def test_what_has_no_step() -> None:
    with pytest.raises(ExportError, match="AC606"):
        step_function(acausal.compile(RCLadder(n=100)), 1e-3, "rosenbrock")
    with pytest.raises(UsageError, match="AC034"):
        step_function(acausal.compile(RCLadder()), 1e-3, "euler")
    with pytest.raises(UsageError, match="AC030"):
        step_function(acausal.compile(RCLadder()), 0.0)


class Pulse(Component):
    """x' = 1 between 0.3 and 0.7 s, else 0."""

    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == where((time > 0.3) & (time < 0.7), 1.0, 0.0)


@pytest.mark.parametrize("method", ["rk2", "rk4", "rosenbrock", "sdirk"])
def test_switches_of_time_on_the_grid_are_exact(method: str) -> None:
    step = step_function(acausal.compile(Pulse()), 0.1, method)
    expected = [min(max(0.1 * k - 0.3, 0.0), 0.4) for k in range(1, 11)]
    assert walk(step, 10)[step.x.names[0]] == pytest.approx(expected, abs=1e-14)


class Struck(Component):
    """A mass that flies against a spring of 0.1 MN/m, and is back after 10 ms."""

    x: Real = variable(default=fixed(0.1))
    v: Real = variable(default=fixed(-1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where(self.x < 0.0, -1e5 * self.x, 0.0)


@pytest.mark.parametrize("method", ["rk2", "rk4"])
def test_a_contact_within_a_step_is_too_stiff_for_it(method: str) -> None:
    # h w = 4.3 behind the touch, which lies 2.7 ms behind the start of its step; at the start there is no spring
    step = step_function(acausal.compile(Struck()), 0.0139, method)
    assert walk(step, 8)["step.too_large"].tolist() == [0.0] * 7 + [1.0]


class Thrown(Component):
    """A mass that is thrown from the height `h` without events."""

    h: Real = parameter(default=2.0)
    x: Real = variable(default=lambda self: fixed(self.h))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -9.81


def test_a_start_that_follows_from_parameters_is_said_to_be_that_of_the_declared_ones() -> None:
    """x.start is 2 m for any argument p; a model compiled with h = 3 m starts there."""
    step = step_function(acausal.compile(Thrown()), 0.1, "rk4")
    assert step.x.start[0] == 2.0
    assert "x.start is the start for p.start" in step.notes[-1]
    assert step_function(acausal.compile(Thrown(), parameters={"h": 3.0}), 0.1, "rk4").x.start[0] == 3.0
    # the start of these is a number
    assert not any("x.start" in note for note in step_function(acausal.compile(Pulse()), 0.1, "rk4").notes)
