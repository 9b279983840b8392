"""States in their quasi-static limit: what is left of them, and when there is no such limit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, discrete, fixed, parameter, part, variable, when
from acausal.errors import AcausalError, StructureError, UsageError
from acausal.library.translational import Damper, Fixed, Mass, Spring


class Stack(Component):
    """A light mass on a stiff damped spring, and a heavy one hanging on it by a soft spring."""

    m: Real = parameter(default=1e-3, unit="kg", min=0.0)
    k: Real = parameter(default=1e4, unit="N/m", min=0.0)
    wall: Fixed = Fixed()
    stiff: Spring = part()
    damper: Damper = Damper(d=5.0)
    light: Mass = part()
    soft: Spring = Spring(c=100.0)
    heavy: Mass = Mass(m=1.0, s=fixed(0.1), v=fixed(0.0))

    def build(self) -> None:
        self.stiff = Spring(c=self.k)
        self.light = Mass(m=self.m, s=fixed(0.0), v=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.stiff.flange_a, self.damper.flange_a)
        yield connect(self.stiff.flange_b, self.damper.flange_b, self.light.flange_a, self.soft.flange_a)
        yield connect(self.soft.flange_b, self.heavy.flange_a)


def run(**options: Any) -> acausal.Result:
    compiled = acausal.compile(Stack(), **options)
    return acausal.simulate(compiled, stop_time=2.0, tolerance=1e-9, native=False)


def test_position_and_velocity_follow_at_once() -> None:
    """Springs in series: c = 1/(1/1e4 + 1/100) N/m, and an oscillation with sqrt(c/m)."""
    result = run(outputs=["heavy.s", "light.s"], quasi_static=["light"])
    assert result.stats["states"] == 2
    assert result.stats["algebraic"] == 0
    c = 1.0 / (1e-4 + 1e-2)
    np.testing.assert_allclose(result["heavy.s"], 0.1 * np.cos(np.sqrt(c) * result.time), atol=1e-7)
    np.testing.assert_allclose(result["light.s"], result["heavy.s"] * 100.0 / 10100.0, atol=1e-12)


def test_a_velocity_alone_leaves_out_the_inertia() -> None:
    """d v = F(s) - k s: one state less, and the damper still acts."""
    result = run(outputs=["heavy.s"], quasi_static=["light.v"])
    assert result.stats["states"] == 3
    full = run()
    # the modes left out decay within m/d = 0.2 ms
    np.testing.assert_allclose(result["heavy.s"], full["heavy.s"], atol=2e-5)


def test_without_being_asked_nothing_is_approximated() -> None:
    np.testing.assert_allclose(run(outputs=["heavy.s"])["heavy.s"], run()["heavy.s"], atol=1e-10)


class Switched(Component):
    """A state that an event sets, and one without a spring."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(1.0))
    d: Real = discrete(default=0.0)

    def equations(self) -> Equations:
        yield der(self.x) == -self.x + self.d
        yield der(self.y) == self.x
        yield when(self.x < 0.5, acausal.reset(self.x, 1.0))


@pytest.mark.parametrize(
    ("name", "error", "code", "told"),
    [
        ("z", UsageError, "AC026", "states: "),
        ("x", UsageError, "AC026", "an event sets it"),
        ("y", StructureError, "AC211", "velocity"),
    ],
)
def test_what_has_no_such_limit(name: str, error: type[AcausalError], code: str, told: str) -> None:
    with pytest.raises(error) as caught:
        acausal.compile(Switched(), quasi_static=[name])
    assert caught.value.code == code
    assert told in str(caught.value)
