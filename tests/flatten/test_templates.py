"""Equations of equal components are made once; what makes components different is seen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Connector,
    Equations,
    Expr,
    Real,
    der,
    discrete,
    fixed,
    flow,
    parameter,
    part,
    pre,
    reset,
    sample,
    structural,
    variable,
    when,
)

CALLS: list[str] = []


class Pin(Connector):
    v: Real = variable()
    i: Real = flow()


class Lag(Component):
    """x' = -k x^n"""

    n: int = structural(default=1)
    k: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        CALLS.append(f"n={self.n}")
        rate: Expr = self.x
        for _ in range(self.n - 1):
            rate = rate * self.x
        yield der(self.x) == -self.k * rate


class Lags(Component):
    lags: list[Lag] = part()
    orders: tuple[int, ...] = structural(default=(1, 1, 1))

    def build(self) -> None:
        self.lags = [Lag(n=n, k=1.0 + k) for k, n in enumerate(self.orders)]


def test_the_generator_of_equal_components_runs_once() -> None:
    CALLS.clear()
    acausal.flatten(Lags(orders=(1,) * 50))
    assert CALLS == ["n=1"]


def test_structural_values_make_components_different() -> None:
    """x' = -k x and x' = -k x^2 from 1: exp(-k t) and 1/(1 + k t)."""
    CALLS.clear()
    result = acausal.simulate(Lags(orders=(1, 2, 1, 2)), stop_time=1.0, tolerance=1e-10)
    assert sorted(CALLS) == ["n=1", "n=2"]
    expected = [np.exp(-1.0), 1 / 3.0, np.exp(-3.0), 1 / 5.0]
    assert [result.final(f"lags[{k}].x") for k in range(4)] == pytest.approx(expected, rel=1e-8)


def test_each_copy_has_its_own_names_and_numbers() -> None:
    flat = acausal.flatten(Lags(orders=(1, 1)))
    assert [flat.text(e) for e in flat.equations] == [
        "der(lags[0].x) == -lags[0].k * lags[0].x",
        "der(lags[1].x) == -lags[1].k * lags[1].x",
    ]
    assert flat.parameter_values == (1.0, 2.0)


class Bus(Component):
    """Pins at the potentials 0, 1, 2, ...; their number is that of the list it is given."""

    pins: list[Pin] = part()

    def equations(self) -> Equations:
        for k, pin in enumerate(self.pins):
            yield pin.v == float(k)


class Buses(Component):
    a: Bus = part()
    b: Bus = part()
    sizes: tuple[int, int] = structural(default=(1, 3))

    def build(self) -> None:
        self.a = Bus(pins=[Pin() for _ in range(self.sizes[0])])
        self.b = Bus(pins=[Pin() for _ in range(self.sizes[1])])


@pytest.mark.parametrize("sizes", [(1, 3), (3, 1), (2, 2)])
def test_lists_of_parts_make_components_different(sizes: tuple[int, int]) -> None:
    result = acausal.simulate(Buses(sizes=sizes))
    assert result.final(f"a.pins[{sizes[0] - 1}].v") == sizes[0] - 1
    assert result.final(f"b.pins[{sizes[1] - 1}].v") == sizes[1] - 1


class Law(Component):
    """x' = f(x) with a function given from outside."""

    f: Callable[[Expr], Expr] = structural()
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.f(self.x)


class WithLaw(Component):
    k: Real = parameter(default=2.0)
    first: Law = part()
    second: Law = part()

    def build(self) -> None:
        def law(x: Expr) -> Expr:
            return -self.k * x

        self.first, self.second = Law(f=law), Law(f=law, x=fixed(3.0))


def test_a_function_may_hold_parameters_of_the_owner() -> None:
    compiled = acausal.compile(WithLaw())
    for k in (2.0, 0.5):
        result = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-10, parameters={"k": k})
        assert result.final("first.x") == pytest.approx(np.exp(-k), rel=1e-8)
        assert result.final("second.x") == pytest.approx(3 * np.exp(-k), rel=1e-8)


class Unhashable(Component):
    """A list is no key of a table: such components are simply not shared."""

    weights: list[float] = structural()
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.y == sum(self.weights)


class Sums(Component):
    a: Unhashable = part()
    b: Unhashable = part()

    def build(self) -> None:
        self.a, self.b = Unhashable(weights=[1.0, 2.0]), Unhashable(weights=[4.0])


def test_unhashable_structural_values() -> None:
    result = acausal.simulate(Sums())
    assert (result.final("a.y"), result.final("b.y")) == (3.0, 4.0)


class Counter(Component):
    """Counts once a second; one declared name only."""

    n: Real = discrete()

    def equations(self) -> Equations:
        yield when(sample(1.0, 1.0), reset(self.n, pre(self.n) + 1))


class Counters(Component):
    counters: list[Counter] = part()

    def build(self) -> None:
        self.counters = [Counter(), Counter()]


def test_components_that_act_at_events_do_so_each_for_itself() -> None:
    """Three instants in 3.5 s."""
    result = acausal.simulate(Counters(), stop_time=3.5)
    assert [result.final(f"counters[{k}].n") for k in (0, 1)] == [3.0, 3.0]
    assert acausal.simulate(Counter(), stop_time=3.5).final("n") == 3.0
