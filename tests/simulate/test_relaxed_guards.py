"""How far a guard can be wrong when errors of the states have relaxed: asked of one guard, the same as in theory."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, sqrt, variable, where
from acausal.models.clutches import ClutchChain
from acausal.simulate.events import regime
from acausal.simulate.events.guards import Guards


class Follower(Component):
    """x follows 2*y at once, y falls slowly; the third guard has no slope where x is 0."""

    fast: Real = parameter(default=1e6, unit="1/s")
    slow: Real = parameter(default=0.5, unit="1/s")
    x: Real = variable(unit="1", default=fixed(3.0))
    y: Real = variable(unit="1", default=fixed(1.0))
    n: Real = variable(unit="s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.fast * (self.x - 2 * self.y)
        yield der(self.y) == -self.slow * self.y
        yield der(self.n) == (
            where(self.x > 0.5, 1.0, 0.0)
            + where(3 * self.x - self.y > 2.0, 1.0, 0.0)
            + where(sqrt(self.x) > 0.1, 1.0, 0.0)
        )


@pytest.mark.parametrize("most", [10_000, 0])
def test_errors_relax_as_an_implicit_step_lets_them(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """|g_x (I - h J)^-1| e by hand, with slopes chosen among all and, in large models, by a product."""
    monkeypatch.setattr(regime, "_MOST_SLOPES", most)
    compiled = acausal.compile(Follower())
    assert compiled.states == ("x", "y", "n")
    jacobian, h, e = np.array([[-1e6, 2e6, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 0.0]]), 1e-3, np.array([1e-3, 2e-4, 0.0])
    x = np.array([2.0, 1.0, 0.0])
    slopes = {0.5: [1.0, 0.0, 0.0], 2.0: [3.0, -1.0, 0.0], 0.1: [0.5 / math.sqrt(2.0), 0.0, 0.0]}
    level = {0.5: 2.0 - 0.5, 2.0: 6.0 - 1.0 - 2.0, 0.1: math.sqrt(2.0) - 0.1}
    here = regime.ActiveSet(compiled, (), None)
    m = np.ones(compiled.n_modes)
    p = np.array([1e6, 0.5])
    g = here.guards(0.0, x, [], [], p, m)[0]
    assert sorted(g) == pytest.approx(sorted(level.values()))
    every = np.resize(np.arange(len(g)), regime.TOGETHER)
    together = here.buffered_relaxed_together(0.0, x, [], [], p, m, e, h, every)[0]
    for k, value in enumerate(g):
        which = next(name for name, at in level.items() if at == pytest.approx(value))
        expected = np.abs(np.array(slopes[which]) @ np.linalg.inv(np.eye(3) - h * jacobian)) @ e
        found = here.buffered_relaxed(0.0, x, [], [], p, m, e, h, k)[0]
        assert found == pytest.approx(expected, rel=1e-9)
        assert together[k] == together[k + len(g)] == pytest.approx(expected, rel=1e-9)
        assert found < 0.5 * np.abs(slopes[which]) @ e  # x is known to what follows from y


def test_a_slope_without_bound_is_that_of_its_own_guard_only() -> None:
    """At x = 0 the root has no slope; what the others are known to is what it was."""
    compiled = acausal.compile(Follower())
    here = regime.ActiveSet(compiled, (), None)
    m, e = np.ones(compiled.n_modes), np.array([1e-3, 2e-4, 0.0])
    p = np.array([1e6, 0.5])
    found = [here.buffered_relaxed(0.0, np.zeros(3), [], [], p, m, e, 1e-3, k)[0][0] for k in range(3)]
    assert sum(math.isfinite(v) for v in found) == 2


def test_few_of_hundreds_of_guards_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two dozen clutches that break loose and stick: an event is about its own clutch and its neighbours."""
    asked: list[int] = []
    ask = Guards._relaxed

    def counting(self: Guards, t: float, at: object, error: object, near: np.ndarray) -> object:
        asked.append(len(near))
        return ask(self, t, at, error, near)  # type: ignore[arg-type]

    monkeypatch.setattr(Guards, "_relaxed", counting)
    compiled = acausal.compile(ClutchChain(n=12))
    result = acausal.simulate(compiled, stop_time=1.0, native=False)
    assert len(result.events) >= 12
    assert len(compiled.state_events.relations) >= 72
    assert np.median(asked) <= 4
