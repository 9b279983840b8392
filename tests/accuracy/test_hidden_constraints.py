"""Problems whose constraints only come to light when equations are added up, or when one of them is differentiated."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, Expr, Real, der, exp, fixed, parameter, sin, time, variable

# t = 0.2, published with the problem `transamp` of the test set for initial value problem solvers (Bari).
AMPLIFIER: tuple[float, ...] = (
    -0.5562145012262709e-2,
    0.3006522471903042e1,
    0.2849958788608128e1,
    0.2926422536206241e1,
    0.2704617865010554e1,
    0.2761837778393145e1,
    0.4770927631616772e1,
    0.1236995868091548e1,
)


class TransistorAmplifier(Component):
    """Two transistors, five capacitors: eight equations for eight voltages, three of which hide a constraint.

    Its exponentials make entries of one row that differ by thirty orders of magnitude between two points.

    Source: P. Rentrop, in E. Hairer, Ch. Lubich, M. Roche, The numerical solution of differential-algebraic systems by
    Runge-Kutta methods, Springer 1989; equations as published.
    """

    U: Real = variable(shape=8, default=fixed((0.0, 3.0, 3.0, 6.0, 3.0, 3.0, 6.0, 0.0)))

    def equations(self) -> Equations:
        y = self.U
        R_0, R, U_b, alpha = 1e3, 9e3, 6.0, 0.99
        C = [1e-6 * k for k in (1, 2, 3, 4, 5)]
        U_e = 0.1 * sin(200.0 * math.pi * time)

        def g(x: Expr) -> Expr:
            return 1e-6 * (exp(x / 0.026) - 1.0)

        first, second = g(y[1] - y[2]), g(y[4] - y[5])
        yield C[0] * (der(y[1]) - der(y[0])) == (y[0] - U_e) / R_0
        yield C[0] * (der(y[0]) - der(y[1])) == 2.0 * y[1] / R - U_b / R + (1.0 - alpha) * first
        yield C[1] * der(y[2]) == first - y[2] / R
        yield C[2] * (der(y[4]) - der(y[3])) == (y[3] - U_b) / R + alpha * first
        yield C[2] * (der(y[3]) - der(y[4])) == 2.0 * y[4] / R - U_b / R + (1.0 - alpha) * second
        yield C[3] * der(y[5]) == second - y[5] / R
        yield C[4] * (der(y[7]) - der(y[6])) == (y[6] - U_b) / R + alpha * second
        yield C[4] * (der(y[6]) - der(y[7])) == y[7] / R


class Brenan(Component):
    """x + n t y = sin t and x' + n t y' + (1 + n) y = exp(-t): y = exp(-t) - cos t, whatever n is.

    Both equations have the same left side in x' and y' once the first is differentiated; backward differences do not
    converge on the pair as it stands.

    Source: K. E. Brenan, S. L. Campbell, L. R. Petzold, Numerical solution of initial-value problems in
    differential-algebraic equations, SIAM 1996, section 2.4 (Gear, Petzold 1984), with these right-hand sides.
    """

    n: Real = parameter(default=0.5)
    x: Real = variable()
    y: Real = variable()
    area: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.x + self.n * time * self.y == sin(time)
        yield der(self.x) + self.n * time * der(self.y) + (1.0 + self.n) * self.y == exp(-time)
        yield der(self.area) == self.y


@pytest.mark.parametrize(("solver", "error"), [("rosenbrock", 1e-7), ("idas", 3e-6), ("cvodes", 1e-5)])
def test_amplifier_ends_where_it_is_published_to_end(solver: str, error: float) -> None:
    """The mixed error of the test set; ten tolerances with the one-step method, the multistep ones leave more."""
    r = acausal.simulate(TransistorAmplifier(), stop_time=0.2, tolerance=1e-8, solver=solver, output_interval=0.2)
    found = [float(r.final(f"U[{k}]")) for k in range(8)]
    assert max(abs(found[k] - AMPLIFIER[k]) / (1.0 + abs(AMPLIFIER[k])) for k in range(8)) < error


@pytest.mark.parametrize("formulation", ["torn", "dae"])
def test_what_is_left_of_derivatives_is_a_constraint(formulation: str) -> None:
    compiled = acausal.compile(Brenan(), formulation=formulation)
    assert compiled.states == ("area",)
    r = acausal.simulate(compiled, stop_time=2.0, tolerance=1e-9, output_interval=0.5)
    for t in (0.0, 0.5, 1.0, 2.0):
        y = math.exp(-t) - math.cos(t)
        assert r.at(t, "y") == pytest.approx(y, abs=1e-12)
        assert r.at(t, "x") == pytest.approx(math.sin(t) - 0.5 * t * y, abs=1e-12)
    assert r.final("area") == pytest.approx(1.0 - math.exp(-2.0) - math.sin(2.0), abs=1e-8)


def test_time_is_a_number_where_nothing_has_a_unit() -> None:
    """Published problems are written without units; sin(t) and t**2 + t are sound there."""

    class Plain(Component):
        x: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == (time**2 + time) * exp(-time)

    r = acausal.simulate(Plain(), stop_time=1.0, tolerance=1e-10)
    assert r.final("x") == pytest.approx(3.0 - 7.0 / math.e, abs=1e-8)


def test_time_has_a_unit_beside_what_has_one() -> None:
    class Mixed(Component):
        s: Real = variable(unit="m", default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.s) == self.s * exp(-time)

    with pytest.raises(acausal.AcausalError, match="AC155"):
        acausal.compile(Mixed())
