"""A relation times a number is the same relation, of the charges of single electrons as of gigajoules.

The expected values are those of the same model with a factor of one, which says nothing about units.
"""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    der,
    fabs,
    fixed,
    integer,
    maximum,
    parameter,
    pre,
    reset,
    sin,
    time,
    variable,
    when,
    where,
)


class Compared(Component):
    """An oscillator with relations in `where`, `when`, a boolean, and kinks; both sides of each times c."""

    c: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    fast: Real = boolean()
    y: Real = variable(default=fixed(0.0))
    f: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        c = self.c
        yield der(self.x) == self.v
        yield der(self.v) == -9.0 * self.x - where(c * self.x > c * 0.3, 0.5, -0.2) * self.v
        yield self.fast == (c * self.v > c * 0.4)
        yield der(self.y) == where(self.fast, 1.0, 0.0)
        yield der(self.f) == maximum(c * (self.x - 0.5), 0.0) / c + fabs(c * self.v) / c
        yield when(
            c * sin(self.x) >= c * 0.1 * (1.0 + time),
            reset(self.n, pre(self.n) + 1),
            reset(self.v, 0.9 * pre(self.v)),
        )


SIGNALS = ["x", "v", "y", "f", "n"]


@pytest.fixture(scope="module")
def plain() -> acausal.Result:
    return acausal.simulate(Compared(), stop_time=4.0, tolerance=1e-8)


@pytest.mark.parametrize("c", [1e-22, 1e12])
@pytest.mark.parametrize(("solver", "native"), [("erk", False), ("rosenbrock", True), ("idas", False)])
def test_factors_of_relations_change_no_run(plain: acausal.Result, c: float, solver: str, native: bool) -> None:
    run = acausal.simulate(Compared(), stop_time=4.0, tolerance=1e-8, solver=solver, native=native, parameters={"c": c})
    assert len(run.events) == len(plain.events)
    for name in SIGNALS:
        assert run.final(name) == pytest.approx(plain.final(name), abs=1e-6)


@pytest.mark.parametrize("c", [1e-15, 1e-22])
def test_factors_of_relations_change_no_exported_step(c: float) -> None:
    step = acausal.step_function(acausal.compile(Compared()), 1e-3, "rk4", SIGNALS)
    names = [port.name for port in step.p]
    found = []
    for factor in (1.0, c):
        x, y, p = np.array(step.x.start), np.zeros(0), np.array(step.p.start)
        p[names.index("c")] = factor
        for _ in range(2000):
            x, y = (np.array(part).ravel() for part in step.function(x, [], p))
        found.append(y[: len(SIGNALS)])
    assert found[0][-1] >= 1.0
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)
