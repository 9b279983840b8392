"""MPR in equations: in every solver, compiled, and in optimal control."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, as_expr, der, dot, fixed, identity, maximum, parameter, variable, zeros
from acausal.export.casadi.functions import casadi_model
from acausal.library.contact.collide.penetration import penetration
from acausal.library.contact.collide.shapes import Box, Sphere
from acausal.lower.compiled import CompiledModel

BALL_ON_PLATE = penetration(Sphere(0.1), Box((2.0, 2.0, 1.0)))


class PressedBall(Component):
    """A ball that sinks into a stiff plate against a damper: m = 0, so that the closed form is an exponential."""

    z: Real = variable(unit="m", default=fixed(0.6))
    depth: Real = variable(unit="m")
    speed: Real = variable(unit="m/s", doc="Rate of the depth, from the witnesses")
    force: Real = parameter(default=100.0, unit="N")
    k: Real = parameter(default=1e4, unit="N/m")
    d: Real = parameter(default=1e3, unit="N.s/m")

    def equations(self) -> Equations:
        place = as_expr((0.3, -0.2, self.z))
        depth, normal, _, _ = BALL_ON_PLATE(place, identity(3), zeros(3), identity(3))
        yield self.depth == depth
        yield self.d * der(self.z) == self.k * maximum(self.depth, 0.0) - self.force
        yield self.speed == dot(normal, (0.0, 0.0, der(self.z)))


class PrescribedDepth(Component):
    """The depth is given, and the place of the ball follows: the function is differentiated by the compiler."""

    z: Real = variable(unit="m", default=acausal.guess(0.59))
    v: Real = variable(unit="m/s")
    rate: Real = parameter(default=0.01, unit="m/s")

    def equations(self) -> Equations:
        depth, *_ = BALL_ON_PLATE((0.3, -0.2, self.z), identity(3), zeros(3), identity(3))
        yield depth == acausal.quantity(1.0, "mm") + self.rate * acausal.time
        yield self.v == der(self.z)


@pytest.fixture(scope="module")
def pressed() -> CompiledModel:
    return acausal.compile(PressedBall())


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "erk", "cvodes"])
def test_every_solver(solver: str, pressed: CompiledModel) -> None:
    """depth = F/k (1 - exp(-k t/d)) from first touch at t = 0."""
    result = acausal.simulate(pressed, stop_time=0.3, solver=solver, tolerance=1e-9)
    expected = 0.01 * (1 - np.exp(-10.0 * result.time))
    assert result["depth"] == pytest.approx(expected, abs=1e-8)
    assert result["speed"] == pytest.approx(0.1 * np.exp(-10.0 * result.time), abs=1e-6)


def test_a_given_depth_is_differentiated() -> None:
    """Index 2: the ball's height is 0.6 - depth, its velocity minus the rate."""
    result = acausal.simulate(PrescribedDepth(), stop_time=1.0)
    assert result.final("z") == pytest.approx(0.6 - 0.011, abs=1e-9)
    assert result.final("v") == pytest.approx(-0.01, abs=1e-9)


@pytest.mark.slow
def test_compiled() -> None:
    """The same in C, which holds the search as well."""
    result = acausal.simulate(PressedBall(), stop_time=0.3, solver="rosenbrock", tolerance=1e-9, native=True)
    assert result.final("depth") == pytest.approx(0.01 * (1 - np.exp(-3.0)), abs=1e-8)


def test_exact_second_derivatives_in_optimal_control() -> None:
    """Which force leads to a depth of 4 mm after 0.3 s: ipopt with the exact Hessian, by implicit midpoint steps.

    Closed form: F = k depth/(1 - exp(-k T/d)); 30 steps leave an error of (k h/d)^2/12.
    """
    compiled = acausal.compile(PressedBall())
    model = casadi_model(compiled, ["depth"])
    p = ca.DM(compiled.parameter_values)
    place = compiled.parameters.index("force")
    steps, h = 30, 0.01
    opti = ca.Opti()
    x, force = opti.variable(1, steps + 1), opti.variable()
    parameters = ca.vertcat(p[:place], force, p[place + 1 :])
    opti.subject_to(x[0] == 0.6)
    for k in range(steps):
        rate = model.ode((x[k] + x[k + 1]) / 2, [], parameters)[0]
        opti.subject_to(x[k + 1] == x[k] + h * rate)
    end = model.ode(x[steps], [], parameters)[1]
    opti.minimize((1e3 * end - 4.0) ** 2)
    opti.set_initial(x, 0.595)
    opti.set_initial(force, 80.0)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-10})
    found = opti.solve()
    assert found.value(force) == pytest.approx(40.0 / (1 - np.exp(-3.0)), rel=2e-3)
