"""Nonlinear blocks that are solved inside the equations because one unknown is declared monotone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import lambertw

import acausal
from acausal import Component, Equations, Real, der, fixed, log, maximum, parameter, quantity, time, variable

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
