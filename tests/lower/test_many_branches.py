"""Branches beyond their guards, however many there are and however deep they are in each other."""

from __future__ import annotations

import casadi as ca
import numpy as np

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    der,
    fabs,
    fixed,
    maximum,
    parameter,
    sqrt,
    structural,
    time,
    variable,
    where,
)
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel


def slopes(compiled: CompiledModel, x: float, mode: float) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivatives of the sum of all rates by the states, all states at x, all modes the same."""
    s = Symbols(compiled)
    rate = ca.sum1(compiled.rhs(*s.inputs)[0])
    second, first = ca.hessian(rate, s.x)
    f = ca.Function("slopes", s.inputs, [ca.densify(first), ca.densify(second)])
    found = f(0.0, [x] * s.x.numel(), [], [], [0.0] * s.p.numel(), [mode] * s.m.numel())
    return np.array(found[0]), np.array(found[1])


class Row(Component):
    """n contacts of Hertz, each with its own branch."""

    n: int = structural(default=150)
    h: Real = variable(shape=(150,), default=fixed(0.1))

    def equations(self) -> Equations:
        for k in range(self.n):
            yield der(self.h[k]) == where(self.h[k] < 0.0, 1e3 * (-self.h[k]) ** 1.5, 0.0) - 1.0


def test_more_than_a_hundred_branches_have_derivatives_beyond_their_guards() -> None:
    """Above the ground, whether the mode says so already or not yet."""
    compiled = acausal.compile(Row())
    for mode in (0.0, 1.0):
        first, second = slopes(compiled, 0.1, mode)
        assert np.isfinite(first).all()
        assert np.isfinite(second).all()


class Nest(Component):
    """A branch in a branch in a branch, all of which need the same root."""

    depth: int = structural()
    x: Real = variable(default=fixed(0.5))

    def equations(self) -> Equations:
        inner: Expr = sqrt(self.x + 0.0)
        for k in range(self.depth):
            inner = where(self.x > 0.1 * k, sqrt(self.x) + 0.5 * inner, inner / self.x + sqrt(self.x + k))
        yield der(self.x) == where(self.x > 0.0, inner, 0.0)


def test_size_grows_with_the_depth_of_branches_and_not_with_its_square() -> None:
    """Twice as deep is twice as large: every node has one image, not one for each branch it stands in."""
    small, large = (acausal.compile(Nest(depth=depth)).rhs.n_instructions() for depth in (15, 30))
    assert large < 2.5 * small
    first, second = slopes(acausal.compile(Nest(depth=15)), -0.5, 0.0)
    assert np.isfinite(first).all()
    assert np.isfinite(second).all()


class Pushed(Component):
    """A feed that follows a force as long as it pushes, and a drag that is even."""

    f: Real = variable(default=fixed(0.0))
    s: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.f) == (2.0 * maximum(self.f, 0.0)) ** 1.3 + time
        yield der(self.s) == -(fabs(self.s) ** 1.5) - sqrt(maximum(self.f, 0.0))


def test_powers_of_what_rests_at_zero_have_second_derivatives() -> None:
    """0 on the resting side; (2 f)^1.3 has the slope 2.6 (2 f)^0.3 and the curvature 1.56 (2 f)^-0.7 on the other."""
    compiled = acausal.compile(Pushed())
    for at in (-1.0, 0.0):
        first, second = slopes(compiled, at, 0.0)
        assert np.isfinite(first).all()
        assert np.isfinite(second).all()
    s = Symbols(compiled)
    rate = compiled.rhs(*s.inputs)[0][0]
    curvature, slope = ca.hessian(rate, s.x[0])
    f = ca.Function("f", s.inputs, [slope, curvature])
    found = [float(v) for v in f(0.0, [0.5, 0.0], [], [], [], [])]
    np.testing.assert_allclose(found, [2.6, 1.56], rtol=1e-12)


class Pressed(Component):
    """A feed that follows the force of a contact, which is off in the air, over a parameter and to a power."""

    n: Real = parameter(default=1.2, doc="Exponent")
    unit: Real = parameter(default=2.0)
    x: Real = variable(default=fixed(-1.0))
    f: Real = variable()
    fed: Real = variable(default=fixed(0.0))
    flow: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.f == where(self.x > 0.0, maximum(3.0 * self.x, 0.0), 0.0)
        yield der(self.fed) == (self.f / self.unit / 5.0) ** 1.2 + (self.f / self.unit / 5.0) ** self.n
        yield der(self.flow) == sqrt(self.unit * self.f)


def test_powers_of_a_force_that_is_off() -> None:
    """All derivatives by states and parameters: zero in the air; in contact 2 u^1.2 with u = 0.3 x, and sqrt(6 x)."""
    model = acausal.compile(Pressed()).casadi()
    x, p = ca.MX.sym("x", 3), ca.MX.sym("p", 2)
    both = ca.vertcat(x, p)
    fed, flow = ca.vertsplit(model.dae(x=x, p=p)["ode"][1:])
    second = ca.Function("h", [x, p], [ca.hessian(fed, both)[0], ca.hessian(flow, both)[0], ca.jacobian(fed, both)])
    for k, found in enumerate(second([-1.0, 0.0, 0.0], [1.2, 2.0])):
        np.testing.assert_array_equal(np.array(found), np.zeros((5, 5) if k < 2 else (1, 5)))
    curvature, root, slope = (np.array(v) for v in second([2.0, 0.0, 0.0], [1.2, 2.0]))
    np.testing.assert_allclose(curvature[0, 0], 2 * 1.2 * 0.2 * 0.6**-0.8 * 0.09, rtol=1e-12)
    np.testing.assert_allclose(root[0, 0], -0.25 * 6.0**0.5 * 2.0**-1.5, rtol=1e-12)
    np.testing.assert_allclose(slope[0, 3], 0.6**1.2 * np.log(0.6), rtol=1e-12)
    assert np.isnan(np.array(second([2.0, 0.0, 0.0], [1.2, -2.0])[0])).any()  # a negative base is no rest
