"""Compiled models by structure: shared when only values differ, never when structure does, and never unsafely."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, cos, der, fixed, parameter, structural, variable
from acausal.errors import AcausalError, UsageError
from acausal.lower.cache import cache
from acausal.lower.compiled import CompiledModel
from acausal.models.pendulum_chain import PendulumChain
from acausal.models.rc_circuit import RCCircuit
from acausal.models.rc_ladder import RCLadder


@pytest.fixture(autouse=True)
def _empty() -> Iterator[None]:
    cache.forget()
    yield
    cache.forget()


class Decay(Component):
    """T * der(x) = -gain * x."""

    T: Real = parameter(default=2.0, unit="s")
    gain: Real = parameter(default=1.0, unit="1")
    steps: int = structural(default=1)
    x: Real = variable(default=fixed(1.0), unit="1")

    def equations(self) -> Equations:
        yield self.T * der(self.x) == -self.gain * self.x * self.steps


class Difference(Component):
    """An unknown behind the difference of two parameters."""

    a: Real = parameter(default=3.0, unit="1")
    b: Real = parameter(default=1.0, unit="1")
    T: Real = parameter(default=1.0, unit="s")
    x: Real = variable(default=fixed(1.0), unit="1")
    y: Real = variable(unit="1")

    def equations(self) -> Equations:
        yield (self.a - self.b) * self.y == self.x
        yield self.T * der(self.x) == -self.y


class Choice(Component):
    """y can give way to x where 1 + k*cos(x) has no root: for k < 1."""

    k: Real = parameter(default=0.5, unit="1")
    T: Real = parameter(default=1.0, unit="s")
    x: Real = variable(default=0.3, unit="1", prefer_state=True)
    y: Real = variable(default=0.2, unit="1")
    u: Real = variable(unit="1/s")
    w: Real = variable(unit="1/s")
    push: Real = variable(unit="1/s2")

    def equations(self) -> Equations:
        yield self.u == der(self.x)
        yield self.w == der(self.y)
        yield der(self.u) == self.push - self.u / self.T
        yield der(self.w) == -self.push
        yield self.y * (1.0 + self.k * cos(self.x)) == self.x


def shared(a: CompiledModel, b: CompiledModel) -> bool:
    return a.rhs is b.rhs


def test_other_values_share_the_functions_and_give_their_own_results() -> None:
    first, second = acausal.compile(Decay()), acausal.compile(Decay(T=0.5, gain=3.0))
    assert shared(first, second)
    assert "recall" in second.timings
    assert "lower" not in second.timings
    for compiled, rate in ((first, 0.5), (second, 6.0)):
        run = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-9)
        assert run.final("x") == pytest.approx(math.exp(-rate), rel=1e-8)
    assert acausal.simulate(second, stop_time=1.0).final("gain") == 3.0
    assert first.parameter_values == (2.0, 1.0)


def test_functions_made_later_are_shared_too() -> None:
    first = acausal.compile(RCCircuit())
    acausal.simulate(first).final("resistor.i")
    second = acausal.compile(RCCircuit(), parameters={"R": 7.0})
    assert second.observe is first.observe
    assert second.parameter_values != first.parameter_values


@pytest.mark.parametrize("model", [RCLadder(n=6, R=2.0, C=0.3), PendulumChain(n=3)])
def test_recalled_models_compute_what_new_ones_do(model: RCLadder | PendulumChain) -> None:
    acausal.compile(type(model)(n=model.n))
    recalled, anew = acausal.compile(model), acausal.compile(model, cache=False)
    assert not shared(recalled, anew)
    assert recalled.states == anew.states
    assert recalled.columns == anew.columns
    a, b = (acausal.simulate(c, stop_time=1.0) for c in (recalled, anew))
    assert a.names == b.names
    for name in a.names:
        np.testing.assert_array_equal(a[name], b[name])


@pytest.mark.parametrize(
    "other",
    [
        Decay(steps=2),  # another constant in the equation
        Decay(x=fixed(2.0)),  # another start
        Decay(x=0.5),
        Decay(gain=0.0),  # a value that can decide structure
        Decay(gain=-1.0),
        RCCircuit(),
    ],
)
def test_other_structure_is_compiled(other: Component) -> None:
    assert not shared(acausal.compile(Decay()), acausal.compile(other))


def test_start_is_the_new_models_own() -> None:
    acausal.compile(Decay())
    assert acausal.simulate(Decay(x=0.5), stop_time=1.0).at(0.0, "x") == 0.5


def test_formulation_is_part_of_the_structure() -> None:
    assert not shared(acausal.compile(PendulumChain(n=1)), acausal.compile(PendulumChain(n=1), formulation="dae"))


def test_without_cache() -> None:
    assert not shared(acausal.compile(Decay(), cache=False), acausal.compile(Decay(), cache=False))
    assert not cache._cache.entries


def test_division_by_what_is_now_zero_is_not_shared() -> None:
    acausal.compile(Difference())
    assert shared(acausal.compile(Difference(a=4.0)), acausal.compile(Difference(a=5.0)))
    with pytest.raises(AcausalError, match="y"):
        acausal.simulate(Difference(a=2.0, b=2.0), stop_time=1.0)


def test_choice_of_states_that_is_not_safe_any_more_is_made_anew() -> None:
    first, same, other = (acausal.compile(Choice(k=k)) for k in (0.5, 0.6, 2.0))
    assert set(first.states) == {"x", "u"}
    assert shared(first, same)
    assert not shared(first, other)
    assert set(other.states) == {"x", "y", "u", "w"}


def test_parameters_of_a_run_must_fit_the_choice_of_states() -> None:
    compiled = acausal.compile(Choice(k=0.5))
    assert cache.choices_hold_for(compiled, (0.6, 1.0))
    with pytest.raises(UsageError, match="AC029"):
        acausal.simulate(compiled, parameters={"k": 2.0}, stop_time=0.1)


def test_least_recently_used_models_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache._cache, "most", 2)
    oldest = acausal.compile(Decay(steps=1))
    acausal.compile(Decay(steps=2))
    assert shared(oldest, acausal.compile(Decay(steps=1)))
    acausal.compile(Decay(steps=3))
    assert len(cache._cache.entries) == 2
    assert shared(oldest, acausal.compile(Decay(steps=1)))
    assert "lower" in acausal.compile(Decay(steps=2)).timings


def test_reduced_models_are_taken_again_for_the_same_wishes_and_values_only() -> None:
    first = acausal.compile(RCLadder(n=10), outputs=["capacitors[2].v"])
    again = acausal.compile(RCLadder(n=10), outputs=["capacitors[2].v"])
    assert shared(first, again)
    assert "recall" in again.timings
    assert "recall" not in first.timings
    assert again.selection == first.selection
    for other in (
        acausal.compile(RCLadder(n=10), outputs=["capacitors[3].v"]),
        acausal.compile(RCLadder(n=10), outputs=["capacitors[2].v"], freeze=["R"]),
        acausal.compile(RCLadder(n=10, R=2.0), outputs=["capacitors[2].v"]),
        acausal.compile(RCLadder(n=10)),
    ):
        assert not shared(first, other)
    a, b = (acausal.simulate(m, stop_time=1.0).final("capacitors[2].v") for m in (first, again))
    assert a == b
