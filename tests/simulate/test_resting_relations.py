"""Relations of what rests beyond a kink, a force that is zero until something touches: `force > 0` changes there."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    boolean,
    clamp,
    der,
    edge,
    fabs,
    fixed,
    integer,
    maximum,
    minimum,
    no_event,
    parameter,
    pre,
    reset,
    sqrt,
    structural,
    variable,
    when,
    where,
)
from tests.stepping import walk

Signal = Callable[[Any], Expr]
FORCES: dict[str, tuple[Signal, Callable[[Any], Expr]]] = {
    "maximum": (lambda u: 1e3 * maximum(u, 0.0), lambda f: f > 0.0),
    "minimum": (lambda u: minimum(-u, 0.0), lambda f: f < 0.0),
    "clamp": (lambda u: clamp(u, 0.0, 1.0), lambda f: ~(f <= 0.0)),
    "fabs": (lambda u: fabs(u) + u, lambda f: 0.0 < f),
    "no_event": (lambda u: no_event(where(u > 0.0, u, 0.0)), lambda f: f > 0.0),
    "threshold": (lambda u: maximum(u, 0.0), lambda f: f > 1e-12),
    "from below": (lambda u: maximum(u, -1.0), lambda f: f >= 0.0),
    "root": (lambda u: maximum(u, 0.0) ** 1.5 / (2.0 + u), lambda f: f > 0.0),
}


class Touch(Component):
    """x = sin(t) and f a force above c: y is the time of contact, n and edges count contacts."""

    force: Signal = structural(default=FORCES["maximum"][0])
    touches: Callable[[Any], Expr] = structural(default=FORCES["maximum"][1])
    c: Real = parameter(default=0.9)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    z: Real = variable()
    f: Real = variable()
    y: Real = variable(default=fixed(0.0))
    n: Real = integer()
    m: Real = integer()
    touching: Real = boolean()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        # iterated; c where x is c
        yield self.z + 0.1 * self.z**3 == self.x + 0.1 * self.c**3
        yield self.f == self.force(self.z - self.c)
        yield der(self.y) == where(self.touches(self.f), 1.0, 0.0)
        yield self.touching == self.touches(self.f)
        yield when(self.touching, reset(self.n, pre(self.n) + 1))
        yield when(edge(self.touches(self.f)), reset(self.m, pre(self.m) + 1))


@pytest.mark.parametrize("written", FORCES.values(), ids=FORCES)
@pytest.mark.parametrize("solver", ["auto", "cvodes"])
def test_contact_lasts_as_long_as_it_touches(solver: str, written: tuple[Signal, Callable[[Any], Expr]]) -> None:
    """sin(t) > c for pi - 2 asin(c) of every 2 pi."""
    compiled = acausal.compile(Touch(force=written[0], touches=written[1]))
    for c, interval in ((0.9, 0.02), (0.99999, 10.0)):
        asked = {"c": c}
        r = acausal.simulate(
            compiled, solver=solver, tolerance=1e-8, parameters=asked, stop_time=10.0, output_interval=interval
        )
        assert r.final("y") == pytest.approx(2.0 * (math.pi - 2.0 * math.asin(c)), rel=1e-2 if c > 0.99 else 1e-6)
        assert [r.final(k) for k in ("n", "m", "touching")] == [2.0, 2.0, 0.0]
        assert not r.stats["notes"]


def outside(f: Callable[[Any], Any]) -> Signal:
    """A function that is computed outside of the language."""
    u = ca.SX.sym("u")
    return acausal.External("force", lambda: ca.Function("force", [u], [f(u)]), inputs=((),), outputs=((),))


SINE = outside(ca.sin)
HIDDEN: dict[str, tuple[Signal, Callable[[Any], Expr]]] = {
    "outside": (outside(lambda u: ca.fmax(u, 0.0)), lambda f: f > 0.0),
    "outside, flat": (outside(lambda u: 1e3 * ca.if_else(u > 0.0, ca.fmax(u, 0.0) ** 1.5, 0.0)), lambda f: ~(f <= 0.0)),
    "kink outside": (lambda u: -maximum(SINE(u), 0.0), lambda f: f < 0.0),
    "sum of roots": (lambda u: sqrt(maximum(u, 0.0)) + sqrt(maximum(u - 0.02, 0.0)), lambda f: f > 0.0),
}


# idas refuses the slope of a root
@pytest.mark.parametrize(
    ("solver", "written"),
    [
        pytest.param(solver, written, id=f"{name}-{solver}", marks=() if solver == "idas" else pytest.mark.slow)
        for name, written in HIDDEN.items()
        for solver in ("erk", "cvodes", "idas")
        if (name, solver) != ("sum of roots", "idas")
    ],
)
def test_where_no_kink_is_seen_the_relation_ends_as_well(
    solver: str, written: tuple[Signal, Callable[[Any], Expr]]
) -> None:
    """Of a force from outside nothing is known but that it is zero."""
    compiled = acausal.compile(Touch(force=written[0], touches=written[1]))
    r = acausal.simulate(compiled, solver=solver, tolerance=1e-8, stop_time=10.0)
    assert r.final("y") == pytest.approx(2.0 * (math.pi - 2.0 * math.asin(0.9)), rel=1e-6)
    assert [r.final(k) for k in ("n", "m", "touching")] == [2.0, 2.0, 0.0]


def test_exported_steps_tell_where_a_kink_is_hidden() -> None:
    """They do not know the instant of what stays zero: four times in 10 s."""
    force, touches = HIDDEN["outside, flat"]
    step = acausal.step_function(acausal.compile(Touch(force=force, touches=touches)), 1e-2, "rk4")
    assert walk(step, 1000)["step.unlocated"].sum() == 4


def test_exported_steps_say_the_same() -> None:
    """One step of 1e-3 s locates each of the four changes in 10 s."""
    step = acausal.step_function(acausal.compile(Touch()), 1e-3, "rk4")
    found = walk(step, 10000)
    assert found["y"][-1] == pytest.approx(2.0 * (math.pi - 2.0 * math.asin(0.9)), rel=1e-6)
    assert found["n"][-1] == 2.0
