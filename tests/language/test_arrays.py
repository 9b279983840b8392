"""Equations between vectors: slices are numpy's, each element is an equation of its own, shapes follow from a size."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    concatenate,
    der,
    exp,
    fill,
    fixed,
    parameter,
    part,
    structural,
    variable,
    where,
)
from acausal.errors import AcausalError, DeclarationError, UnitError
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.scalarise import scalars
from acausal.language.expressions.arrays import element
from acausal.language.expressions.expression import Symbol, symbols_in
from acausal.numeric.evaluate import values


class Thing(Component):
    x: Real = variable()
    a: Real = variable(shape=6)
    b: Real = variable(shape=6)
    P: Real = variable(shape=(4, 3))


thing: Any = Thing()
rng = np.random.default_rng(7)
SIZES: dict[str, tuple[int, ...]] = {"x": (), "a": (6,), "b": (6,), "P": (4, 3)}
NUMBERS: dict[str, Any] = {name: rng.normal(size=size) for name, size in SIZES.items()}


def array(e: Any) -> Any:
    """Value of an expression of the thing."""
    pool, first = Pool(), {}
    flat: list[float] = []
    for symbol in symbols_in(e):
        own = np.ravel(NUMBERS[symbol.name])
        first[symbol.name] = range(pool.new_variables(own.size), len(flat) + own.size)
        flat += own.tolist()

    def resolve(symbol: Symbol) -> tuple[int, ...]:
        return tuple(pool.var(k) for k in first[symbol.name])

    nodes = scalars(pool, e, resolve, {})
    found = values(pool, nodes, {"var": flat.__getitem__, "time": lambda _: 0.0})
    return np.reshape([found[n] for n in nodes], e.shape)


ends = st.one_of(st.none(), st.integers(-6, 6))


@given(ends, ends, st.sampled_from([None, 1, 2, -1, -2]))
def test_slices_are_numpys(start: int | None, stop: int | None, step: int | None) -> None:
    key = slice(start, stop, step)
    expected = NUMBERS["a"][key]
    if len(expected):
        np.testing.assert_array_equal(array(thing.a[key]), expected)
        np.testing.assert_array_equal([array(element(thing.a[key], k)) for k in range(len(expected))], expected)
    else:
        with pytest.raises(DeclarationError, match="has no elements"):
            thing.a[key]


def test_slices_of_matrices_are_rows_columns_and_blocks() -> None:
    for key in ((1, slice(None)), (slice(None), -1), (slice(1, 3), slice(None, None, 2))):
        np.testing.assert_array_equal(array(thing.P[key]), NUMBERS["P"][key])


def test_functions_and_operators_work_by_elements() -> None:
    a, b, x = NUMBERS["a"], NUMBERS["b"], NUMBERS["x"]
    made = where(thing.a > thing.b, exp(thing.a[::-1]) / thing.b, acausal.maximum(thing.b, thing.x)) ** 2 * thing.a
    expected = np.where(a > b, np.exp(a[::-1]) / b, np.maximum(b, x)) ** 2 * a
    np.testing.assert_allclose(array(made), expected, rtol=1e-14)
    joined = concatenate(thing.x, thing.a[1:3], 2.0) - fill(thing.x, 4)
    np.testing.assert_allclose(array(joined), np.array([x, *a[1:3], 2.0]) - x, rtol=1e-14)
    for k in range(6):
        assert array(element(made, k)) == array(made)[k]


class Bar(Component):
    """Heat between two ends at 0: the fourth of n + 1 sines decays at 4/h^2 sin^2(4 pi h / 2)."""

    n: int = structural(default=9)
    k: Real = parameter(default=0.01, unit="1/s")
    u: Real = variable(shape=lambda self: self.n, unit="K")

    def initial_equations(self) -> Equations:
        yield self.u == np.sin(4 * np.pi * np.arange(1, self.n + 1) / (self.n + 1))

    def equations(self) -> Equations:
        yield der(self.u[0]) == self.k * (self.u[1] - 2.0 * self.u[0]) * (self.n + 1) ** 2
        yield der(self.u[1:-1]) == self.k * (self.u[2:] - 2.0 * self.u[1:-1] + self.u[:-2]) * (self.n + 1) ** 2
        yield der(self.u[-1]) == self.k * (self.u[-2] - 2.0 * self.u[-1]) * (self.n + 1) ** 2


@pytest.mark.parametrize("n", [9, 49])
def test_a_mode_of_a_bar_decays_at_its_own_rate(n: int) -> None:
    """Exactly, for any n: sines are eigenvectors of the second difference."""
    result = acausal.simulate(Bar(n=n), stop_time=1.0, tolerance=1e-9)
    rate = 0.01 * 4.0 * (n + 1) ** 2 * np.sin(2.0 * np.pi / (n + 1)) ** 2
    mode = np.sin(4 * np.pi * np.arange(1, n + 1) / (n + 1))
    np.testing.assert_allclose(result.final("u"), mode * np.exp(-rate), atol=1e-8)
    assert result["u"].shape[1] == n


def test_texts_name_the_element() -> None:
    flat = acausal.flatten(Bar(n=9))
    texts = [flat.text(e) for e in flat.equations]
    assert texts[3] == "der(u[3]) == k * (u[4] - 2 * u[3] + u[2]) * 100"
    again: Any = pickle.loads(pickle.dumps(flat))
    assert [again.text(e) for e in again.equations] == texts


def test_what_is_wrong_with_one_element_names_it_and_its_place() -> None:
    class Twice(Bar):
        def equations(self) -> Equations:
            yield self.u[4] == 0.0 * self.u[3]

    with pytest.raises(AcausalError) as caught:
        acausal.compile(Twice())
    assert "u[4]" in str(caught.value)
    assert "test_arrays.py" in str(caught.value)


def test_units_are_checked_once_for_all_elements() -> None:
    class Wrong(Component):
        u: Real = variable(shape=50, unit="K", default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.u) == concatenate(self.u[0], self.u[:-1])

    with pytest.raises(UnitError, match="the left side is in K/s"):
        acausal.flatten(Wrong())


class Two(Component):
    short: Bar = Bar(n=3)
    long: Bar = Bar(n=5)


def test_each_instance_has_its_own_size() -> None:
    flat = acausal.flatten(Two())
    assert [(v.path, v.size) for v in flat.variables] == [("short.u", 3), ("long.u", 5)]
    compiled: Any = pickle.loads(pickle.dumps(acausal.compile(Two())))
    assert len(compiled.states) == 8


def test_instances_share_equations_only_where_their_sizes_are_equal() -> None:
    sizes = iter((2, 2, 3, 3))  # asked before `build` and after it

    class Odd(Component):
        u: Real = variable(shape=lambda self: next(sizes), default=fixed(1.0))

        def equations(self) -> Equations:
            yield der(self.u) == -self.u

    class Both(Component):
        a: Odd = part()
        b: Odd = part()

        def build(self) -> None:
            self.a, self.b = Odd(), Odd()

    assert len(acausal.flatten(Both()).equations) == 5


def test_a_size_that_build_changes_is_refused() -> None:
    class Changing(Component):
        n: int = structural(default=3)
        u: Real = variable(shape=lambda self: self.n)

        def build(self) -> None:
            self.n = 4

    with pytest.raises(DeclarationError, match=r"Changing\.u has another shape"):
        Changing()
