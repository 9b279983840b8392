"""Steep functions that a relation, a kink or a clause switches on: searched while they count, and only then.

Law: a pulse of height one and width w adds sqrt(pi) w times what it is multiplied by where the gate is open, and
nothing where it is closed; in every solver, and whatever the gate is made of.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    cos,
    der,
    discrete,
    exp,
    fixed,
    maximum,
    minimum,
    no_event,
    parameter,
    pre,
    reset,
    sqrt,
    structural,
    tanh,
    variable,
    when,
    where,
)
from acausal.simulate.equations.arguments import arguments
from tests.marks import slow_but

OPENS, W = 40.0, 0.01
# What multiplies a pulse F at s, and that factor at an instant behind the opening.
GATES: dict[str, tuple[Callable[[Any, Expr, Expr], Any], Callable[[float], float]]] = {
    "relation": (lambda m, s, f: where(s > OPENS, f, 0.0), lambda s: 1.0),
    "other side": (lambda m, s, f: where(s <= OPENS, 0.0, f), lambda s: 1.0),
    "factor": (lambda m, s, f: where(s > OPENS, 2.0, 0.0) * f, lambda s: 2.0),
    "maximum": (lambda m, s, f: maximum(s - OPENS, 0.0) * f, lambda s: s - OPENS),
    "minimum": (lambda m, s, f: minimum(OPENS - s, 0.0) * f, lambda s: OPENS - s),
    "power": (lambda m, s, f: maximum(s - OPENS, 0.0) ** 1.5 * f, lambda s: (s - OPENS) ** 1.5),
    "no event": (lambda m, s, f: where(no_event(s > OPENS), f, 0.0), lambda s: 1.0),
    "no event, other side": (lambda m, s, f: where(no_event(s <= OPENS), 0.0, f), lambda s: 1.0),
    "clause": (lambda m, s, f: m.on * f, lambda s: 1.0),
    "two": (lambda m, s, f: where(s > OPENS, maximum(s - 20.0, 0.0), 0.0) * f, lambda s: s - 20.0),
    "inside": (lambda m, s, f: where(s > OPENS, sqrt(1e-300 + f * f), 0.0), lambda s: 1.0),
}


class Gated(Component):
    """y' is a pulse around s = c, with s = t, behind a gate that opens at s = 40."""

    gate: str = structural(default="relation")
    c: Real = parameter(default=50.0)
    s: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    pulse: Real = variable()
    on: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.s) == 1.0
        yield when(self.s > OPENS, reset(self.on, pre(self.on) + 1.0))
        yield self.pulse == exp(-(((self.s - self.c) / W) ** 2))
        yield der(self.y) == GATES[self.gate][0](self, self.s, self.pulse)


# Which gates are open follows from modes, whatever the solver is: every gate with one, every kind with the others.
KINDS = ("relation", "power", "no event", "clause")
RUNS = [(s, g) for s in ("rosenbrock", "erk", "idas", "cvodes") for g in (GATES if s == "rosenbrock" else KINDS)]


@pytest.mark.parametrize(("solver", "gate"), slow_but(RUNS, ("rosenbrock", "minimum")))
def test_a_pulse_behind_a_gate_counts_where_this_is_open(solver: str, gate: str) -> None:
    for c in (17.3, 61.9):
        found = acausal.simulate(Gated(gate=gate, c=c), stop_time=100.0, solver=solver, tolerance=1e-8)["y"][-1]
        factor = GATES[gate][1](c) if c > OPENS else 0.0
        assert found == pytest.approx(factor * W * math.sqrt(math.pi), rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("gate", [g for g in GATES if g != "clause"])
def test_nothing_is_searched_behind_a_closed_gate(gate: str) -> None:
    compiled = acausal.compile(Gated(gate=gate))
    known = arguments(compiled)
    assert known is not None
    modes = [compiled.all_modes(0.0, [s, 0.0, 0.0], [], [], [50.0]) for s in (0.0, 45.0)]
    closed, opened = (known.are_active(np.array(m).ravel()) for m in modes)
    assert not closed.any()
    assert opened.any()


class Turned(Component):
    """A rate behind `gate` whose friction holds another steep function inside its own."""

    mu: Real = parameter(default=0.3)
    v: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        speed = sqrt(self.v * self.v + 1e-18)
        yield der(self.v) == where(self.v > 0.5, -self.v / speed * exp(-((speed - 0.75) ** 2) / 1e-4), -1.0)


def test_what_is_inside_of_another_function_is_awake_with_it() -> None:
    known = arguments(compiled := acausal.compile(Turned()))
    assert known is not None
    on, off = (np.array(compiled.all_modes(0.0, [v], [], [], [0.3])).ravel() for v in (0.8, 0.2))
    assert known.are_active(on).all()
    assert not known.are_active(off).any()


class Bounced(Component):
    """A ball that bounces, and y' = (1 + tanh(k (x - cos(h)))) / 2 with x = sin(w t): a burst in each period."""

    w: Real = parameter(default=4.0)
    h: Real = parameter(default=0.01)
    k: Real = parameter(default=1e8)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    high: Real = variable(default=fixed(1.0))
    up: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.w * self.v
        yield der(self.v) == -self.w * self.x
        yield der(self.y) == 0.5 * (1.0 + tanh(self.k * (self.x - cos(self.h))))
        yield der(self.high) == self.up
        yield der(self.up) == -9.81 + 1e-9 * self.y
        yield when(self.high < 0.0, reset(self.up, -0.8 * pre(self.up)))


@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
@pytest.mark.parametrize("h", [0.003, 0.05])
def test_a_compiled_flight_passes_over_nothing(solver: str, h: float) -> None:
    """Each period adds 2 h/w, the time for which sin(w t) is above cos(h), but for 1/k at both ends."""
    stop = 4.0
    result = acausal.simulate(Bounced(h=h), stop_time=stop, solver=solver, tolerance=1e-8, native=True)
    assert result.stats["native"]
    assert len(result.events) > 3
    # crests at (pi/2 + 2 pi j)/w: 0.39, 1.96 and 3.53 s
    assert result["y"][-1] == pytest.approx(3 * 2.0 * h / 4.0, rel=1e-3)
