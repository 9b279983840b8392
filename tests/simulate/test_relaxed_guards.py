"""How far a guard can be wrong when errors of the states have relaxed: asked of one guard, the same as in theory."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fixed,
    parameter,
    reset,
    variable,
    when,
    where,
)
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
            + where(1 / self.x**2 < 10.0, 1.0, 0.0)
        )


@pytest.mark.parametrize("most", [10_000, 0])
def test_errors_relax_as_an_implicit_step_lets_them(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """|g_x (I - h J)^-1| e by hand, with slopes chosen among all and, in large models, by a product."""
    monkeypatch.setattr(regime, "_MOST_SLOPES", most)
    compiled = acausal.compile(Follower())
    assert compiled.states == ("x", "y", "n")
    jacobian, h, e = np.array([[-1e6, 2e6, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 0.0]]), 1e-3, np.array([1e-3, 2e-4, 0.0])
    x = np.array([2.0, 1.0, 0.0])
    slopes = {0.5: [1.0, 0.0, 0.0], 2.0: [3.0, -1.0, 0.0], 10.0: [0.25, 0.0, 0.0]}
    level = {0.5: 2.0 - 0.5, 2.0: 6.0 - 1.0 - 2.0, 10.0: 10.0 - 1.0 / 4.0}
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
    """At x = 0 the quotient has no slope; what the others are known to is what it was."""
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
    assert len(compiled.state_events.relations) >= 48
    assert np.median(asked) <= 4


class Held(Component):
    """x follows 2*d at once, and the guard is x + 3*d; d is discrete."""

    fast: Real = parameter(default=1e6, unit="1/s")
    x: Real = variable(unit="1", default=fixed(3.0))
    n: Real = variable(unit="s", default=fixed(0.0))
    d: Real = discrete(unit="1", default=1.0)

    def equations(self) -> Equations:
        yield der(self.x) == -self.fast * (self.x - 2 * self.d)
        yield der(self.n) == where(self.x + 3 * self.d > 0.5, 1.0, 0.0)
        yield when(self.x < 0.1, reset(self.d, 2.0))


@pytest.mark.parametrize("h", [1e-9, 1e-3])
def test_errors_of_discrete_variables_move_what_follows_them(h: float) -> None:
    """By hand: with s = 1/(1 + h*fast), x is known to s*e_x + 2*(1 - s)*e_d, and x + 3*d to s*e_x + (5 - 2*s)*e_d."""
    compiled = acausal.compile(Held())
    assert compiled.states == ("x", "n", "d")
    e, s = np.array([1e-3, 0.0, 2e-4]), 1.0 / (1.0 + h * 1e6)
    expected = sorted([s * e[0] + (2.0 - 2.0 * s) * e[2], s * e[0] + (5.0 - 2.0 * s) * e[2]])
    here, m = regime.ActiveSet(compiled, (), None), np.ones(compiled.n_modes)
    none = np.zeros(0)
    at = 0.0, np.array([2.0, 0.0, 1.0]), none, none, np.array([1e6]), m, e, h
    found = [here.buffered_relaxed(*at, k)[0][0] for k in range(2)]
    assert sorted(found) == pytest.approx(expected, rel=1e-9)
    every = np.resize(np.arange(2), regime.TOGETHER)
    assert here.buffered_relaxed_together(*at, every)[0][:2] == pytest.approx(found, rel=1e-12)


def test_what_tells_it_grows_with_the_model() -> None:
    """Four times as many clutches, whose modes all act on one chain, are at most 4.5 times as many numbers."""
    few, many = (regime.ActiveSet(acausal.compile(ClutchChain(n=n)), (), None).relaxed.sz_w() for n in (4, 16))
    assert many < 4.5 * few
