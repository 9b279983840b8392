"""Relations that have no value everywhere: false where they have none, with an event where that ends."""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import numpy as np
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
    integer,
    log,
    maximum,
    no_event,
    parameter,
    pre,
    reset,
    sin,
    sqrt,
    structural,
    time,
    variable,
    when,
    where,
)
from tests.marks import slow_but
from tests.stepping import walk

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


# Quotients of d, and the interval in which each is greater than 1.25 while d goes from -1 to 1: poles at d = 0, one of
# them of the third order, and a quotient that is 0/0 there and passes it without a jump.
POLES: tuple[tuple[Relation, float, float], ...] = (
    (lambda d: 1.0 / d, 0.0, 0.8),
    (lambda d: -1.0 / d, -0.8, 0.0),
    (lambda d: 1.0 / sin(d), 0.0, math.asin(0.8)),
    (lambda d: 1.0 / d**3, 0.0, 0.8 ** (1 / 3)),
    (lambda d: 1.0 / d + 1.0 / (d - 2.0), 0.0, (4.5 - math.sqrt(10.25)) / 2.5),
    (lambda d: (d + 1.5) * d / d, -0.25, 1.0),
)


class Pole(Component):
    """How often, and for how long, a quotient is greater than 1.25."""

    number: int = structural(default=0)
    d: Real = variable(default=fixed(-1.0))
    q: Real = variable()
    y: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.d) == 1.0
        yield self.q == POLES[self.number][0](self.d)
        yield der(self.y) == where(self.q > 1.25, 1.0, 0.0)
        yield when(self.q > 1.25, reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("solver", ["rosenbrock", "idas", "erk"])
@pytest.mark.parametrize("number", range(len(POLES)))
def test_a_pole_is_passed_once(number: int, solver: str) -> None:
    """Its guard came back within the error of d: `when`s acted twice or more."""
    _, low, high = POLES[number]
    result = acausal.simulate(Pole(number=number), stop_time=2.0, solver=solver, tolerance=1e-4)
    assert result.final("n") == 1.0
    assert result.final("y") == pytest.approx(high - low, abs=2e-4)
    assert not result.stats["notes"]


@pytest.mark.parametrize("number", [0, 1, 2, 4, 5])  # the search of a step is too short for a zero of the third order
def test_a_fixed_step_locates_a_pole(number: int) -> None:
    """The relation changed one step late, with a flag; every step is exact where rates are constant."""
    _, low, high = POLES[number]
    step = acausal.step_function(acausal.compile(Pole(number=number)), 0.021, "rk4", outputs=["y", "n"])
    found = walk(step, math.floor(2.0 / 0.021))
    end = min(high, 0.021 * math.floor(2.0 / 0.021) - 1.0)
    assert [found["y"][-1], found["n"][-1]] == pytest.approx([end - low, 1.0], abs=1e-4)
    assert not found["step.unlocated"].any()


class Logarithm(Component):
    """The logarithm of x is below 0.1 once, from where it begins to have a value."""

    x: Real = variable(default=fixed(-1.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(log(self.x) < 0.1, reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("beyond", [1e-15, 1e-13, 1e-11, 1e-9, 1e-7])
def test_a_reaction_beside_the_end_of_a_domain_is_the_whole_one(beyond: float) -> None:
    """By its slope there the relation was about to change: the mode was wrong, and the `when` acted once more."""
    made = acausal.compile(Logarithm()).casadi(events=True)
    events = made.events
    assert events is not None
    x, p, m = np.array(made.x.start), made.p.start, events.m.start
    x[made.x.position("x")] = beyond
    for _ in range(2):
        x, _, m, settled = events.react(x, [], [], p, m, [])
        assert float(settled) == 1.0
        assert float(x[made.x.position("n")]) == 1.0
    assert float(ca.mmin(events.indicators(x, [], [], p, m))) >= 0.0


# Relations of arcs of u = (x - 0.6)/w, and the length in u on which each is true, by the sine and the cosine.
ARCS: tuple[tuple[Relation, float], ...] = (
    (lambda u: asin(u) > 0.0, 1.0),
    (lambda u: -0.3 < asin(u), 1.0 + math.sin(0.3)),
    (lambda u: asin(u) < -1.4, 1.0 - math.sin(1.4)),
    (lambda u: asin(u) < 2.0, 2.0),
    (lambda u: acos(u) < 1.0, 1.0 - math.cos(1.0)),
    (lambda u: acos(u) > 2.9, 1.0 + math.cos(2.9)),
    (lambda u: 2.9 >= acos(u), 1.0 - math.cos(2.9)),
    (lambda u: 2.0 * asin(u) > 0.0, 1.0),
)


class NarrowArc(Component):
    """A rate acts while a relation of an arc holds, whose domain is 2 w wide."""

    case: int = structural()
    w: Real = parameter(default=1e-4)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.3
        yield der(self.y) == where(ARCS[self.case][0]((self.x - 0.6) / self.w), 1.0 / self.w, 0.0)


@pytest.mark.parametrize("solver", slow_but(["rosenbrock", "erk", "idas"], "rosenbrock"))
@pytest.mark.parametrize("case", range(len(ARCS)))
def test_a_relation_of_an_arc_of_a_narrow_domain_acts_in_full(case: int, solver: str) -> None:
    run = acausal.simulate(NarrowArc(case=case), stop_time=1.0, tolerance=1e-8, solver=solver, native=False)
    assert run.final("y") == pytest.approx(ARCS[case][1] / 1.3, rel=1e-6)
