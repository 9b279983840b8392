"""Two targets of one structure: blocks solved symbolically, or left whole to the DAE solver; the motion is the same."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, guess, parameter, variable

# Shipped models with blocks, and a span [s] in which each of them does something.
MODELS = [
    ("pendulum", "Pendulum", 0.5),
    ("double_pendulum", "DoublePendulum", 0.5),
    ("pendulum_chain", "PendulumChain", 0.3),
    ("mass_chain", "MassSpringDamperChain", 1.0),
    ("rc_ladder", "RCLadder", 1.0),
    ("drilling_dynamic", "ThickBlock", 1.0),
    ("ivp.car_axis", "CarAxis", 0.3),
    ("ivp.planar_pendulum", "PlanarPendulum", 0.5),
]


@pytest.mark.parametrize(("module", "name", "stop"), MODELS, ids=[name for _, name, _ in MODELS])
def test_shipped_models(module: str, name: str, stop: float) -> None:
    model: type[Component] = getattr(import_module(f"acausal.models.{module}"), name)
    torn, whole = (acausal.compile(model(), formulation=f) for f in ("torn", "dae"))
    assert set(torn.algebraic) <= set(whole.algebraic) or not torn.algebraic
    assert torn.states == whole.states
    a, b = (acausal.simulate(c, stop_time=stop, tolerance=1e-8, solver="idas") for c in (torn, whole))
    for state in torn.states:
        size = float(np.max(np.abs(a[state]))) + 1e-3
        np.testing.assert_allclose(b[state], a[state], rtol=0, atol=3e-5 * size, err_msg=state)


class Circle(Component):
    """A point mass on a circle in x and y: neither can be the state all the way round, so all are kept, stabilised."""

    g: Real = parameter(default=9.81)
    x: Real = variable(default=fixed(0.6))
    y: Real = variable(default=guess(-0.7))
    v: Real = variable(default=guess(5.0))
    w: Real = variable(default=fixed(4.2))
    tension: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -self.tension * self.x
        yield der(self.w) == -self.tension * self.y - self.g
        yield self.x * self.x + self.y * self.y == 1.0

    def energy(self, r: acausal.Result) -> np.ndarray:
        return 0.5 * (r["v"] ** 2 + r["w"] ** 2) + 9.81 * r["y"]


def test_a_stabilised_pendulum_turns_on_its_circle() -> None:
    """It starts at (0.6, -0.8) with 7 m/s along the circle: 24.5 - 7.848 J/kg, more than the 9.81 of the top."""
    model = Circle()
    compiled = acausal.compile(model)
    assert compiled.solution.structure.invariants
    result = acausal.simulate(compiled, stop_time=30.0, tolerance=1e-9)
    x, y = result["x"], result["y"]
    assert np.max(np.abs(x * x + y * y - 1.0)) < 1e-8
    assert np.max(np.abs(x * result["v"] + y * result["w"])) < 1e-8
    energy = model.energy(result)
    assert energy[0] == pytest.approx(24.5 - 0.8 * 9.81, abs=1e-6)
    assert np.max(np.abs(energy - energy[0])) < 1e-4
    turns = np.unwrap(np.arctan2(y, x))
    assert turns[-1] - turns[0] > 20 * np.pi
    # the pull is what the circular motion and the weight ask for: m (v^2 + w^2)/r - m g y/r
    np.testing.assert_allclose(result["tension"], result["v"] ** 2 + result["w"] ** 2 - 9.81 * y, rtol=0, atol=1e-4)
