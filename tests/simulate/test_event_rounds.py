"""Rounds of the event iteration: Modelica 3.6, section 8.6 and appendix B, worked out by hand for each model."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    edge,
    fixed,
    guess,
    pre,
    reset,
    sample,
    variable,
    when,
    where,
)
from acausal.errors import EventError
from tests.stepping import walk

DRIVERS = [
    pytest.param("rosenbrock", False, id="rosenbrock"),
    pytest.param("erk", False, id="erk"),
    pytest.param("idas", None, id="idas"),
    pytest.param("cvodes", None, id="cvodes"),
    pytest.param("rosenbrock", True, id="rosenbrock-compiled", marks=pytest.mark.slow),
    pytest.param("erk", True, id="erk-compiled"),
]


class _Ramp(Component):
    x: Real = variable(default=fixed(0.0))
    n: Real = discrete()


class LostCount(_Ramp):
    """The first `when` lifts x over the guard of the second, which must read the count of the first."""

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(self.x > 0.05, reset(self.x, 5.0), reset(self.n, pre(self.n) + 1))
        yield when(self.x > 1.0, reset(self.n, pre(self.n) + 10))


class LatePre(_Ramp):
    """What a sample sets is `pre` to the `when` that its reset of x sets off."""

    d: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 0.1
        yield when(sample(0.5, 10.0), reset(self.x, 5.0), reset(self.d, 3.0))
        yield when(self.x > 1.0, reset(self.n, pre(self.d)))


class Priority(_Ramp):
    """e > 1.5 becomes true in the round in which x > 1 does: the first branch acts, the second does not."""

    e: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 3.0
        yield when(self.x > 1.0, reset(self.n, 1.0)).elsewhen(self.e > 1.5, reset(self.n, 2.0))
        yield when(self.x > 1.0, reset(self.e, 2.0))


class EdgeAndLevel(_Ramp):
    """An edge and what another `when` sets at the same instant."""

    e: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 3.0
        yield when(edge(self.x > 1.0) & (self.e > 1.5), reset(self.n, 7.0))
        yield when(self.x > 1.0, reset(self.e, 2.0))


class Sorted(_Ramp):
    """A value follows another `when` of the same round through a discrete equation, whatever their order."""

    e: Real = discrete()
    twice: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 3.0
        yield when(self.x > 1.0, reset(self.n, self.twice + 1.0))
        yield self.twice == 2.0 * self.e
        yield when(self.x > 1.0, reset(self.e, 4.0))


class TwoEdges(_Ramp):
    """Two conditions of one `when` that become true in two rounds of one instant: it acts twice."""

    def equations(self) -> Equations:
        yield der(self.x) == 0.1
        yield when((sample(0.5, 10.0), self.x > 1.0), reset(self.x, self.x + 3.0), reset(self.n, pre(self.n) + 1))


class Counter(_Ramp):
    """A `when` whose condition reads what it sets: decided as it was before the round, so it acts in the next one."""

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(sample(0.15, 0.2), reset(self.n, pre(self.n) + 1)).elsewhen(self.n > 2.5, reset(self.n, 0.0))


class Swap(_Ramp):
    """Two variables that take each other's value see it as it was before."""

    e: Real = discrete(default=2.0)

    def equations(self) -> Equations:
        yield der(self.x) == 3.0
        yield when(self.x > 1.0, reset(self.n, self.e), reset(self.e, self.n))


class Chain(_Ramp):
    """Twelve `when`s, each of which sets off the next."""

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        for k in range(12):
            yield when(self.x > 0.5 + k, reset(self.x, 1.6 + k), reset(self.n, pre(self.n) + 1))


class ThroughAlgebra(_Ramp):
    """A condition on an algebraic variable that follows from what another `when` sets in the same round."""

    e: Real = discrete(default=1.0)
    z: Real = variable(default=guess(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == 3.0
        yield self.z + 0.1 * self.z**3 == self.e + 0.01 * self.x
        yield when(edge(self.x > 1.0) & (self.z > 2.0), reset(self.n, 5.0))
        yield when(self.x > 1.0, reset(self.e, 8.0))


@dataclass(frozen=True)
class _Case:
    model: type[_Ramp]
    n: float


# n at 1 s; Counter counts 1, 2, 3 -> 0 and 1 at 0.75 s and 0.95 s: 0.15, 0.35, 0.55 (to 0), 0.75, 0.95
CASES = [
    _Case(LostCount, 11.0),
    _Case(LatePre, 3.0),
    _Case(Priority, 1.0),
    _Case(EdgeAndLevel, 7.0),
    _Case(Sorted, 9.0),
    _Case(TwoEdges, 2.0),
    _Case(Counter, 2.0),
    _Case(Swap, 2.0),
    _Case(Chain, 12.0),
    _Case(ThroughAlgebra, 5.0),
]


@pytest.mark.parametrize(("solver", "native"), DRIVERS)
@pytest.mark.parametrize("case", CASES, ids=lambda c: c.model.__name__)
def test_rounds(case: _Case, solver: str, native: bool | None) -> None:
    assert acausal.simulate(case.model(), stop_time=1.0, solver=solver, native=native).final("n") == case.n


@pytest.mark.parametrize("h", [0.025, 0.1])
@pytest.mark.parametrize("case", CASES, ids=lambda c: c.model.__name__)
def test_rounds_of_exported_steps(case: _Case, h: float) -> None:
    step = acausal.step_function(acausal.compile(case.model()), h, "rk4", ["n"])
    found = walk(step, round(1.0 / h))
    assert not found["step.unsettled"].any()
    assert found["n"][-1] == case.n


def test_exported_steps_say_when_events_do_not_settle() -> None:
    """Each `when` sets off the other one, for ever."""

    class Restless(_Ramp):
        def equations(self) -> Equations:
            yield der(self.x) == 1.0
            yield when(self.x > 0.5, reset(self.x, -1.0), reset(self.n, pre(self.n) + 1))
            yield when(self.x < 0.0, reset(self.x, 1.0))

    step = acausal.step_function(acausal.compile(Restless()), 0.1, "rk4", ["n"])
    assert walk(step, 10)["step.unsettled"].max() == 1.0
    assert any("step.unsettled" in note for note in step.notes)


def test_different_values_at_one_instant_are_refused_when_they_meet_in_a_later_round() -> None:
    class Meeting(_Ramp):
        def equations(self) -> Equations:
            yield der(self.x) == 1.0
            yield when(self.x > 0.5, reset(self.x, 5.0))
            yield when(self.x > 1.0, reset(self.n, 1.0))
            yield when(self.x > 2.0, reset(self.n, 2.0))

    with pytest.raises(EventError, match="AC504"):
        acausal.simulate(Meeting(), stop_time=1.0)


def test_sensitivities_go_through_rounds() -> None:
    """x jumps to 2 a, which sets off n = a**2 through another round: dn/da = 2 a."""

    class Jumping(Component):
        a: Real = acausal.parameter(default=1.5)
        x: Real = variable(default=fixed(0.0))
        n: Real = discrete()
        e: Real = discrete()

        def equations(self) -> Equations:
            yield der(self.x) == where(self.x > 9.0, 1.0, 1.0)
            yield when(self.x > 0.5, reset(self.x, 2.0 * self.a), reset(self.e, self.a))
            yield when(self.x > 1.0, reset(self.n, pre(self.e) * self.a))

    found = acausal.sensitivities(Jumping(), ["a"], ["n"], stop_time=1.0)
    assert found.final[0, 0] == pytest.approx(3.0, rel=1e-9)
