"""An equation times a number is the same equation: of picocoulombs or of gigawatts, it is solved as well as any.

The expected values are the residuals of the equations as they stand without these numbers, those of a run with
factors of one, and at t = 0 the root of the two iterated equations that scipy.optimize.fsolve finds.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, guess, parameter, sin, time, variable, where


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
