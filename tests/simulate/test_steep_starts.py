"""A relation that is steep where a run or a stretch begins changes when its closed form of the position does.

Noise is what errors of states do by the slopes of a relation. Where a slope is large for a moment only, this exceeds
all values that the relation ever has; it counted as at rest below its noise up to the next event, and was never passed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    der,
    discrete,
    fixed,
    pre,
    reset,
    sqrt,
    structural,
    time,
    variable,
    when,
    where,
)
from tests.marks import slow_but

_W = 1e-12
# What becomes positive, of the position x, and at which x.
_RELATIONS: dict[str, tuple[Callable[[Expr], Expr], float]] = {
    "reciprocal": (lambda x: 5 - 1 / (x + _W), 0.2 - _W),
    "logarithm": (lambda x: acausal.log(x / 0.3 + 1e-300), 0.3),
    "step": (lambda x: acausal.tanh(x / _W) - 0.5, _W * math.atanh(0.5)),
    "angle": (lambda x: acausal.atan(x / _W) - 1, _W * math.tan(1.0)),
    "smooth sign": (lambda x: x / acausal.sqrt(x**2 + _W**2) - 0.5, _W / math.sqrt(3.0)),
    "power beyond 1e100": (lambda x: ((x - 0.3) / 1e-3) ** 59 - 1, 0.301),
}


class Moving(Component):
    """A point that moves steadily from x = 0, or is accelerated from rest."""

    number: int = structural(default=0)
    is_steady: bool = structural(default=True)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable()
    when_passed: Real = discrete(default=fixed(-1.0))

    def build(self) -> None:
        self.v = fixed(1.0 if self.is_steady else 0.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == (0.0 if self.is_steady else 1.0)
        yield when(list(_RELATIONS.values())[self.number][0](self.x) > 0, reset(self.when_passed, time))


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas"])
@pytest.mark.parametrize("relation", slow_but(_RELATIONS, "reciprocal", "step"))
def test_a_relation_that_is_steep_at_the_start_is_passed(relation: str, solver: str, native: bool) -> None:
    """None of these was passed by any solver."""
    position = _RELATIONS[relation][1]
    given: dict[str, Any] = {"solver": solver, "native": native, "stop_time": 1.0, "tolerance": 1e-6}
    for is_steady in (True, False):
        r = acausal.simulate(Moving(number=list(_RELATIONS).index(relation), is_steady=is_steady), **given)
        instant = position if is_steady else math.sqrt(2.0 * position)
        # x is known to 1e-8 at the start, which accelerated from rest is passed after 1.4e-4 s
        assert float(r.final("when_passed")) == pytest.approx(instant, abs=2e-6 if position > 0.1 else 1.5e-4)


class Beside(Component):
    """A step of height one, over 1e-9, where another relation has an event: it never reaches 1.25."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    counted: Real = discrete(default=0.0)

    def equations(self) -> Equations:
        away = self.x - 0.5
        yield der(self.x) == 1.0 - 0.01 * self.y
        yield der(self.y) == where(self.x > 0.5, 1.0, 0.0)
        yield when(away / sqrt(away**2 + 1e-18) > 1.25, reset(self.counted, pre(self.counted) + 1.0))


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("solver", ["rosenbrock", "idas", "erk"])
def test_a_step_beside_an_event_is_not_passed(solver: str, native: bool) -> None:
    """By its slope there, its noise was a thousand times its height, and its clause acted (`Guards.steady`)."""
    result = acausal.simulate(Beside(), stop_time=1.0, solver=solver, native=native)
    assert result.final("counted") == 0.0
    assert [event.condition for event in result.events] == ["x > 0.5"]
