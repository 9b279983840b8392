"""Relations that have no value everywhere: false where they have none, with an event where that ends."""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    External,
    Real,
    acos,
    asin,
    der,
    fixed,
    log,
    maximum,
    no_event,
    sqrt,
    structural,
    time,
    variable,
    where,
)
from tests.marks import slow_but

Relation = Callable[[Expr], Expr]

# Relations of x, and the interval in which each has a value and is true, by the inverse functions.
RELATIONS: tuple[tuple[Relation, float, float], ...] = (
    (lambda x: sqrt(x - 1.5) > -1.0, 1.5, math.inf),
    (lambda x: sqrt(x - 1.5) > 0.0, 1.5, math.inf),
    (lambda x: sqrt(x - 1.5) < 0.5, 1.5, 1.75),
    (lambda x: log(x - 1.5) < 0.0, 1.5, 2.5),
    (lambda x: log(x - 1.5) > 0.0, 2.5, math.inf),
    (lambda x: asin(x - 2.0) < 0.5, 1.0, 2.0 + math.sin(0.5)),
    (lambda x: acos(x - 2.0) > -1.0, 1.0, 3.0),
    (lambda x: (x - 1.5) ** 1.5 < 1.0, 1.5, 2.5),
    (lambda x: sqrt(2.0 - sqrt(x - 1.5)) < 1.2, 1.5 + 0.56**2, 5.5),
    (lambda x: (x - 1.5) ** -1.5 > 1.0, 1.5, 2.5),
    (lambda x: where(x > 2.0, sqrt(x - 2.0) - 1.0, 1.0) > 0.5, -math.inf, 2.0),
    (lambda x: where(x > 2.0, sqrt(2.2 - x), 1.0) > 0.1, -math.inf, 2.19),
)
FROM, UNTIL = 0.2, 2.7


class Passing(Component):
    """x passes from `start` with a constant rate; y rises where a relation of x holds, and falls elsewhere."""

    number: int = structural(default=0)
    exempt: bool = structural(default=False)
    start: float = structural(default=FROM)
    rate: float = structural(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        holds = RELATIONS[self.number][0](self.start + self.x)
        yield der(self.x) == self.rate
        yield der(self.y) == where(no_event(holds) if self.exempt else holds, 1.0, -1.0)


@pytest.mark.parametrize(
    ("exempt", "solver"),
    # the last one takes the longest steps
    slow_but(
        [(False, "rosenbrock"), (False, "idas"), (False, "erk"), (True, "idas")], (False, "rosenbrock"), (True, "idas")
    ),
)
@pytest.mark.parametrize("number", range(len(RELATIONS)))
def test_a_comparison_without_a_value_is_false(number: int, exempt: bool, solver: str) -> None:
    """Instants were 0.03 s early, a stretch was lost where a domain is left, and idas stepped over `no_event`."""
    _, low, high = RELATIONS[number]
    holds = min(high, UNTIL) - max(low, FROM)
    for start, rate in ((FROM, 1.0), (UNTIL, -1.0)):
        model = Passing(number=number, exempt=exempt, start=start, rate=rate)
        result = acausal.simulate(model, stop_time=UNTIL - FROM, solver=solver)
        assert result.final("y") == pytest.approx(2.0 * holds - (UNTIL - FROM), abs=1e-5)
        assert not result.stats["notes"]


class Ratio(Component):
    """Two forces that are zero until t = 1 and then have the ratio 1/2: y = -1 + 1 at t = 2."""

    n: Real = variable(default=fixed(0.0))
    f: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        loaded = where(time > 1.0, 1.0, 0.0)
        yield der(self.n) == loaded
        yield der(self.f) == 0.5 * loaded
        yield der(self.y) == where(self.f / self.n > 0.3, 1.0, -1.0)


@pytest.mark.parametrize("solver", ["rosenbrock", "idas", "erk"])
def test_zero_over_zero_hides_nothing(solver: str) -> None:
    """The relation was nan where the forces begin, and was then never found to hold."""
    assert acausal.simulate(Ratio(), stop_time=2.0, solver=solver).final("y") == pytest.approx(0.0, abs=1e-5)


class Infinite(Component):
    """1/n is infinite, and so greater than 2, until n rises at t = 1; it falls to 2 at t = 1.5."""

    n: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.n) == where(time > 1.0, 1.0, 0.0)
        yield der(self.y) == where(1.0 / self.n > 2.0, 1.0, -1.0)


@pytest.mark.parametrize("solver", ["rosenbrock", "idas", "erk"])
def test_a_quotient_may_be_infinite(solver: str) -> None:
    assert acausal.simulate(Infinite(), stop_time=2.0, solver=solver).final("y") == pytest.approx(1.0, abs=1e-5)


def test_events_are_named_as_the_model_writes_them() -> None:
    result = acausal.simulate(Passing(number=2), stop_time=UNTIL - FROM)
    assert [event.condition for event in result.events] == ["x + 0.2 - 1.5 >= 0", "sqrt(x + 0.2 - 1.5) < 0.5"]


class Norm(Component):
    """The distance from the origin along a line through it, which never leaves the domain of the root."""

    x: Real = variable(default=fixed(-1.0))

    def equations(self) -> Equations:
        yield der(self.x) == where(sqrt(self.x**2 + maximum(self.x, 0.0) * 0.5) > 0.1, 1.0, 0.5)


def test_a_function_that_has_a_value_everywhere_has_no_other_guard() -> None:
    assert len(acausal.compile(Norm()).events.texts) == 1


_U = ca.SX.sym("u")
ROOT = External("root", lambda: ca.Function("root", [_U], [ca.sqrt(_U)]), inputs=[()], outputs=[()])


class Unknown(Component):
    """The domain of an external function is not known."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == where(ROOT(self.x - 1.5) > -1.0, 1.0, -1.0)


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_an_external_function_without_a_value_is_noted(solver: str) -> None:
    result = acausal.simulate(Unknown(), stop_time=2.0, solver=solver)
    assert "root(x - 1.5) > -1: no value" in str(result.stats["notes"])
