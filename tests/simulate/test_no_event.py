"""`no_event` takes events from relations; what is known at events only stays what it is below it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    as_expr,
    boolean,
    change,
    der,
    discrete,
    edge,
    fixed,
    initial,
    no_event,
    pre,
    reset,
    sample,
    sin,
    structural,
    time,
    variable,
    when,
    where,
)


class Written(Component):
    """A value is kept at some events, as it is or below `no_event`; nothing else of the model is read there."""

    value: Callable[[Written], Expr] = structural()
    is_exempt: bool = structural()
    x: Real = variable(default=fixed(0.0))
    p: Real = boolean()
    last: Real = discrete(default=fixed(0.0))
    kept: Real = discrete(default=fixed(0.0))
    area: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 2.0
        yield self.p == (sin(self.x) > 0.3)
        value = no_event(self.value(self)) if self.is_exempt else self.value(self)
        yield when(sample(0.25, 0.5) | edge(self.p), reset(self.last, time), reset(self.kept, value))
        yield der(self.area) == self.kept


VALUES: dict[str, Callable[[Written], Expr]] = {
    "time since then": lambda m: time - pre(m.last),
    "a relation of it": lambda m: where(time - pre(m.last) > 0.4, 5.0, -1.0),
    "before": lambda m: 2.0 * pre(m.last),
    "edge": lambda m: where(edge(m.p), 1.0, 0.0) + where(sample(0.25, 0.5), 2.0, 0.0),
    "change": lambda m: where(change(m.p), m.x, pre(m.x)),
    "initial": lambda m: where(initial(), as_expr(1.0), m.x),
}


@pytest.mark.parametrize("value", VALUES.values(), ids=VALUES)
@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_it_is_the_same_below_it(solver: str, value: Callable[[Written], Expr]) -> None:
    plain, exempt = (
        acausal.simulate(Written(value=value, is_exempt=how), stop_time=5.0, solver=solver) for how in (False, True)
    )
    assert len(plain.events) > 10
    assert plain.final("area") != 0.0
    assert exempt.final("area") == pytest.approx(plain.final("area"), abs=1e-9)
