"""Generated C of power laws, monotone blocks, and of what parameters alone determine."""

from __future__ import annotations

import math
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, variable
from acausal.library.contact import Capsule
from acausal.library.drilling import ConvexLevel, DrillingForce, Workpiece
from acausal.library.multibody import axis_rotation
from acausal.library.multibody.orientation import IDENTITY
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.native import cache
from acausal.simulate.native.equations import differentiated, equations
from acausal.simulate.native.source import functions, integrator

NUMBERS = (0.0, -0.0, 1e-300, 1e-5, 0.3, 1.0, 2.5, 1e200, math.inf, -2.0, math.nan)
EXPONENTS = (-2.0, -0.26, 0.0, 0.5, 1.0, 1.5, 3.0)


def _law() -> ca.Function:
    """x**a, its slope, and the slope of that."""
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    value = x**a
    slope = ca.jacobian(value, x)
    return ca.Function("law", [x, a], [value, slope, ca.jacobian(slope, x)])


def test_a_power_law_and_its_slopes_take_one_power() -> None:
    assert functions(_law()).count("=pow(") == 1


@pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
def test_shared_powers_are_those_of_the_c_library(tmp_path: Path) -> None:
    x, y, a = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("a")
    both = ca.Function("both", [x, y, a], [x**a, x ** (a - 1), ca.fmax(x, y), ca.fmin(x, y)])
    compiled = cache.native(both)
    assert compiled is not None
    for u in NUMBERS:
        for b in EXPONENTS:
            with np.errstate(all="ignore"):
                expected = [np.float64(u) ** b, np.float64(u) ** (b - 1.0), np.fmax(u, b), np.fmin(u, b)]
            found = [float(v) for v in compiled(u, b, b)]
            np.testing.assert_allclose(found, expected, rtol=1e-15, err_msg=f"{u}**{b}")


@pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
def test_functions_that_are_cut_into_pieces_share_powers() -> None:
    x, a = ca.SX.sym("x", 1500), ca.SX.sym("a")
    compiled = cache.native(ca.Function("law", [x, a], [x**a + x ** (a - 1)]))
    assert compiled is not None
    u = np.linspace(0.1, 10.0, 1500)
    np.testing.assert_allclose(np.array(compiled(u, 2.3)).ravel(), u**2.3 + u**1.3, rtol=1e-14)


class Sink(Component):
    """A tank of which the outflow v solves v + v**1.5 == x."""

    power: Real = parameter(default=1.5)
    x: Real = variable(default=fixed(2.0))
    v: Real = variable(default=1.0, monotone_above=0.0)

    def equations(self) -> Equations:
        yield self.v + self.v**self.power == self.x
        yield der(self.x) == -self.v


def test_the_jacobian_of_compiled_steps_is_that_of_the_implicit_function() -> None:
    compiled = acausal.compile(Sink())
    dae, constants, jacobian = differentiated(compiled)
    v = 1.44
    x = v + v**1.5
    c = constants([1.5], [])
    found = jacobian(0.0, x, [], ca.vertcat(c, 0.0), [])[0]
    assert float(found) == pytest.approx(-1.0 / (1.0 + 1.5 * math.sqrt(v)), rel=1e-14)
    # a fifth of the operations of all Newton steps, and the generated steps call it
    whole = ca.Function("whole", dae.sx_in(), [ca.jacobian(dae.call(dae.sx_in())[0], dae.sx_in(1))])
    assert jacobian.n_instructions() < 0.7 * whole.n_instructions()
    text = integrator("rosenbrock", dae, {"reltol": 1e-6, "abstol": 1e-8}, constants, jacobian=jacobian)
    assert text is not None
    assert text.count("if (jacobian(sarg") == 1


class Bar(ThickBlock):
    """A drill against a bar with round ends, whose surface is found by a call and polished behind it."""

    def build(self) -> None:
        super().build()
        self.workpiece = Workpiece(t=0.05, r=(0.001, 0.002, 0.0), R_rel=axis_rotation((0.0, 1.0, 0.0), 0.1))
        level = ConvexLevel(Capsule(0.01, 0.05), ((0.0, 0.0, 0.035), IDENTITY), "bar")
        self.drill = DrillingForce(level=level, t=0.05, axis_a=(0.0, 0.0, 1.0), k=1e8, d_c=2e4)


def test_what_is_split_off_behind_calls_is_complete() -> None:
    """The split equations with their constants are the equations, as long as nothing refers to what is not given."""
    compiled = acausal.compile(Bar())
    dae, constants = equations(compiled)
    values = np.array(compiled.parameter_values)
    n = compiled.n_dynamic
    x = np.full(n, 1e-3)
    held = constants(values, [])
    numbers = ca.vertcat(held, ca.DM.zeros(dae.size1_in("p") - held.numel()))
    got = np.asarray(dae(0.0, x / np.array(compiled.nominal_x[:n]), [], numbers, [])[0]).ravel()
    state = np.concatenate([x, np.zeros(compiled.rhs.size1_in(1) - n)])
    wanted = np.asarray(compiled.rhs(0.0, state, [], [], values, np.zeros(compiled.rhs.numel_in("m")))[0]).ravel()[:n]
    np.testing.assert_allclose(got * np.array(compiled.nominal_x[:n]), wanted, rtol=1e-12)
