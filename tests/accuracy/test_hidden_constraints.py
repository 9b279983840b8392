"""Problems whose constraints only come to light when equations are added up, or when one of them is differentiated."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, Real, der, exp, fixed, parameter, sin, time, variable
from acausal.models.ivp import TransistorAmplifier

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
    """The mixed error of the test set; ten tolerances with the default, the multistep methods leave more."""
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
