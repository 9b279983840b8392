"""Nonlinear blocks solved inside the equations, and other formulations of the same motion."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import lambertw

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    discrete,
    fixed,
    log,
    maximum,
    parameter,
    part,
    quantity,
    time,
    variable,
    when,
)
from acausal.errors import AcausalError, StructureError, UsageError
from acausal.library.translational import Damper, Fixed, Mass, Spring
from acausal.models.double_pendulum import DoublePendulum
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.rc_ladder import RCLadder
from tests.expected import fails_with

V_T, I_S, C = 0.025, 1e-12, 1e-6


class Discharge(Component):
    """A capacitor that discharges through a resistor and a diode: u = R i + V_T log(1 + i/I_S)."""

    R: Real = parameter(default=1e3, unit="Ohm")
    u: Real = variable(default=fixed(2.0), unit="V")
    v: Real = variable(unit="V")
    i: Real = variable(unit="A", nominal=1e-3, monotone_above=0.0)

    def equations(self) -> Equations:
        yield self.v == quantity(V_T, "V") * log(1.0 + self.i / quantity(I_S, "A"))
        yield self.u == self.R * self.i + self.v
        yield quantity(C, "F") * der(self.u) == -self.i


def current(u: float, R: float) -> float:
    """The same circuit by Lambert's function: T. C. Banwell, A. Jayakumar, Electronics Letters 36 (2000) 291-292."""
    return float(V_T / R * lambertw(I_S * R / V_T * math.exp((u + R * I_S) / V_T)).real - I_S)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_a_diode_and_a_resistor(solver: str) -> None:
    compiled = acausal.compile(Discharge())
    for R in (1e3, 10.0, 1e5):
        r = acausal.simulate(compiled, parameters={"R": R}, stop_time=2e-6 * R, solver=solver, tolerance=1e-9)
        assert r.stats["algebraic"] == 0
        for u, i in zip(r["u"], r["i"], strict=True):
            assert i == pytest.approx(current(u, R), rel=1e-10)


def test_derivatives_are_those_of_the_implicit_function() -> None:
    """di/du = 1 / (R + V_T / (I_S + i)), and der(u) = -i/C."""
    linear = acausal.linearize(acausal.compile(Discharge()))
    slope = 1.0 / (1e3 + V_T / (I_S + current(2.0, 1e3)))
    assert float(np.asarray(linear.A)[0, 0]) == pytest.approx(-slope / C, rel=1e-9)


class Squeeze(Component):
    """x^1.5 + b x = load, of a load that comes and goes: x is 0 where there is none."""

    b: Real = parameter(default=1e-3)
    load: Real = variable()
    x: Real = variable(monotone_above=0.0)
    work: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.load == maximum(100.0 * (time - 0.5), 0.0)
        yield maximum(self.x, 0.0) ** 1.5 + self.b * self.x == self.load
        yield der(self.work) == self.x


def test_an_equation_that_bends_the_other_way() -> None:
    r = acausal.simulate(Squeeze(), stop_time=1.0, tolerance=1e-9)
    assert r.stats["algebraic"] == 0
    for load, x in zip(r["load"], r["x"], strict=True):
        expected = brentq(lambda y, load=load: y**1.5 + 1e-3 * y - load, 0.0, 100.0, xtol=1e-15)
        assert x == pytest.approx(expected, rel=1e-10, abs=1e-12)


class Broken(Component):
    """The promise does not hold: x^3 - 3 x = load turns at x = 1, and above 0 there is no steady slope."""

    load: Real = variable()
    x: Real = variable(monotone_above=0.0, default=acausal.guess(2.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.load == 2.5 + time
        yield self.x**3 - 3.0 * self.x == self.load
        yield der(self.y) == self.x


def test_a_broken_promise_is_never_a_wrong_number() -> None:
    """Either the solver iterates upon it, or the run ends: x solves its equation wherever there is a result."""
    try:
        r = acausal.simulate(Broken(), stop_time=1.0, tolerance=1e-9)
    except acausal.AcausalError:
        return
    np.testing.assert_allclose(r["x"] ** 3 - 3.0 * r["x"], r["load"], rtol=1e-6)


def test_without_the_declaration_the_solver_iterates() -> None:
    class Plain(Discharge):
        j: Real = variable(unit="A")
        w: Real = variable(unit="V")

        def equations(self) -> Equations:
            yield self.w == quantity(V_T, "V") * log(1.0 + self.j / quantity(I_S, "A"))
            yield self.u == self.R * self.j + self.w

    assert acausal.simulate(Plain(), stop_time=1e-4).stats["algebraic"] == 1


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "erk"])
def test_the_motion_is_that_of_chosen_states(solver: str) -> None:
    torn = acausal.compile(DoublePendulum())
    projected = acausal.compile(DoublePendulum(), formulation="projected")
    assert len(torn.states) == 4
    assert len(projected.states) > 4
    a, b = (acausal.simulate(m, solver=solver, stop_time=1.0, tolerance=1e-9) for m in (torn, projected))
    for name in torn.states:
        np.testing.assert_allclose(b[name], a[name], atol=1e-6, err_msg=name)


def test_the_distance_to_the_constraints_is_known() -> None:
    run = acausal.simulate(acausal.compile(DoublePendulum(), formulation="projected"), stop_time=1.0, tolerance=1e-6)
    drift = run.stats["drift"]
    assert isinstance(drift, float)
    # stabilised, not solved: near the tolerance, above rounding
    assert 1e-12 < drift < 1e-3
    assert "drift" not in acausal.simulate(DoublePendulum(), stop_time=0.1).stats


def test_a_model_without_constraints_is_the_same() -> None:
    torn, projected = (acausal.compile(RCLadder(), formulation=f) for f in ("torn", "projected"))
    assert projected.states == torn.states


def test_the_drill_keeps_its_guides() -> None:
    projected = acausal.compile(ThickBlock(), formulation="projected")
    torn = acausal.simulate(ThickBlock(), stop_time=5.0)
    run = acausal.simulate(projected, stop_time=5.0)
    assert run.final("drill.s") == pytest.approx(torn.final("drill.s"), abs=1e-9)


def test_formulations_are_listed() -> None:
    with pytest.raises(UsageError, match="AC024") as caught:
        acausal.compile(RCLadder(), formulation="index2")
    assert caught.value.help == "formulations: torn, dae, projected"


class Stack(Component):
    """A light mass on a stiff damped spring, and a heavy one hanging on it by a soft spring."""

    m: Real = parameter(default=1e-3, unit="kg", min=0.0)
    k: Real = parameter(default=1e4, unit="N/m", min=0.0)
    wall: Fixed = Fixed()
    stiff: Spring = part()
    damper: Damper = Damper(d=5.0)
    light: Mass = part()
    soft: Spring = Spring(c=100.0)
    heavy: Mass = Mass(m=1.0, s=fixed(0.1), v=fixed(0.0))

    def build(self) -> None:
        self.stiff = Spring(c=self.k)
        self.light = Mass(m=self.m, s=fixed(0.0), v=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.stiff.flange_a, self.damper.flange_a)
        yield connect(self.stiff.flange_b, self.damper.flange_b, self.light.flange_a, self.soft.flange_a)
        yield connect(self.soft.flange_b, self.heavy.flange_a)


def run(**options: Any) -> acausal.Result:
    compiled = acausal.compile(Stack(), **options)
    return acausal.simulate(compiled, stop_time=2.0, tolerance=1e-9, native=False)


def test_position_and_velocity_follow_at_once() -> None:
    """Springs in series: c = 1/(1/1e4 + 1/100) N/m, and an oscillation with sqrt(c/m)."""
    result = run(outputs=["heavy.s", "light.s"], quasi_static=["light"])
    assert result.stats["states"] == 2
    assert result.stats["algebraic"] == 0
    c = 1.0 / (1e-4 + 1e-2)
    np.testing.assert_allclose(result["heavy.s"], 0.1 * np.cos(np.sqrt(c) * result.time), atol=1e-7)
    np.testing.assert_allclose(result["light.s"], result["heavy.s"] * 100.0 / 10100.0, atol=1e-12)


def test_a_velocity_alone_leaves_out_the_inertia() -> None:
    """d v = F(s) - k s: one state less, and the damper still acts."""
    result = run(outputs=["heavy.s"], quasi_static=["light.v"])
    assert result.stats["states"] == 3
    full = run()
    # the modes left out decay within m/d = 0.2 ms
    np.testing.assert_allclose(result["heavy.s"], full["heavy.s"], atol=2e-5)


def test_without_being_asked_nothing_is_approximated() -> None:
    np.testing.assert_allclose(run(outputs=["heavy.s"])["heavy.s"], run()["heavy.s"], atol=1e-10)


class Switched(Component):
    """A state that an event sets, and one without a spring."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(1.0))
    d: Real = discrete(default=0.0)

    def equations(self) -> Equations:
        yield der(self.x) == -self.x + self.d
        yield der(self.y) == self.x
        yield when(self.x < 0.5, acausal.reset(self.x, 1.0))


@pytest.mark.parametrize(
    ("name", "error", "code", "told"),
    [
        ("z", UsageError, "AC026", "states: "),
        ("x", UsageError, "AC026", "an event sets it"),
        ("y", StructureError, "AC211", "velocity"),
    ],
)
def test_what_has_no_such_limit(name: str, error: type[AcausalError], code: str, told: str) -> None:
    with fails_with(error, code) as caught:
        acausal.compile(Switched(), quasi_static=[name])
    assert told in str(caught.value)
