"""The longest step of a solver: what comes and goes in less is seen, whatever computes it."""

from __future__ import annotations

from typing import Any

import casadi as ca
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, variable

TIME = ca.SX.sym("t")
PULSE = ca.Function("pulse", [TIME], [ca.if_else(ca.fabs(TIME - 0.5) < 1e-3, 500.0, 0.0)])


class Pulsed(Component):
    """A pulse of area one that an external function hides, around x = 1/2."""

    pulse = acausal.External("pulse", lambda: PULSE, inputs=((),), outputs=((),))
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == self.pulse(self.x)


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
def test_what_lasts_longer_is_seen(solver: str, native: bool) -> None:
    options: dict[str, Any] = {"solver": solver, "native": native, "tolerance": 1e-6}
    blind = acausal.simulate(Pulsed(), stop_time=1.0, output_interval=1.0, **options)
    bound = acausal.simulate(Pulsed(), stop_time=1.0, output_interval=1.0, max_step=5e-4, **options)
    assert blind.final("y") == 0.0
    assert "inside of pulse" in str(blind.stats["notes"])
    assert "inside of pulse" not in str(bound.stats["notes"])
    assert bound.final("y") == pytest.approx(1.0, abs=1e-4)


class Turning(Component):
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x


@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
def test_a_run_has_its_own_longest_step(solver: str) -> None:
    """No step is longer, whatever earlier runs of the model were compiled for: a second is at least 100 steps."""
    compiled = acausal.compile(Turning())
    for longest in (None, 0.01, None):
        r = acausal.simulate(compiled, solver=solver, native=True, stop_time=1.0, output_interval=1.0, max_step=longest)
        assert (float(str(r.stats["steps"])) >= 100.0) == (longest is not None)
