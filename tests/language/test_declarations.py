"""Declarations: what a field of each kind takes, and what becomes of it."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import acausal
from acausal import Component, Equations, Real, der, fixed, guess, parameter, part, structural, variable
from acausal.errors import DeclarationError
from acausal.flatten.flatten import flatten
from acausal.language.declarations.declaration import Fixed, Guess
from acausal.library.blocks import CombiTable1D, TimeTable
from tests.expected import fails_with


class Lag(Component):
    """dx/dt = -k x + c, and a vector that does the same."""

    k: Real = parameter(default=2.0, unit="1/s", min=0.0, max=10.0)
    c: Real = parameter(default=lambda self: self.k * 3.0, unit="1/s")
    r: Real = parameter(default=(1.0, 2.0, 3.0), shape=3)
    x: Real = variable(unit="1")
    v: Real = variable(shape=3)
    n: int = structural(default=1)

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x + self.c
        yield der(self.v) == -self.k * (self.v - self.r)


def stored(component: Component, name: str) -> Any:
    return component.__dict__["_values"][name]


def parameters(component: Component, **overrides: object) -> dict[str, float]:
    """Values of the free parameters of the flat system, by path."""
    flat = flatten(component, overrides)
    return dict(zip(flat.parameter_names, flat.parameter_values, strict=True))


number = st.floats(0.0, 10.0)


@given(number)
def test_a_bare_number_is_a_start_that_holds(start: float) -> None:
    assert isinstance(stored(Lag(x=start), "x"), Fixed)
    flat = flatten(Lag(x=start))
    assert [s.is_fixed for s in flat.starts.values() if s.path == "x"] == [True]
    assert flat.pool.value(next(s.node for s in flat.starts.values() if s.path == "x")) == start


@given(number)
def test_a_guess_is_no_equation(start: float) -> None:
    assert isinstance(stored(Lag(x=guess(start)), "x"), Guess)
    flat = flatten(Lag(x=guess(start)))
    assert [s.is_fixed for s in flat.starts.values() if s.path == "x"] == [False]


@given(number)
def test_parameters_take_numbers_as_they_are(k: float) -> None:
    assert parameters(Lag(k=k))["k"] == k


@given(number)
def test_a_value_from_outside_is_the_same_as_one_from_inside(k: float) -> None:
    """`--set k=...` and `Lag(k=...)`; c stays bound to k in both."""
    given_inside, given_outside = flatten(Lag(k=k)), flatten(Lag(), {"k": k})
    assert given_inside.parameter_values == given_outside.parameter_values
    assert "c" not in given_inside.parameter_names


@given(st.floats().filter(lambda v: not 0.0 <= v <= 10.0))
def test_limits_hold_wherever_the_value_comes_from(k: float) -> None:
    make: Any = Lag
    for inside, outside in (({"k": k}, {}), ({}, {"k": k})):
        with fails_with(DeclarationError, "AC136"):
            flatten(make(**inside), outside)


@given(st.lists(number, min_size=0, max_size=5))
def test_vectors_take_as_many_numbers_as_they_have_entries(values: list[float]) -> None:
    if len(values) == 3:
        found = parameters(Lag(r=tuple(values)))
        assert [found[f"r[{k}]"] for k in range(3)] == values
    else:
        with fails_with(DeclarationError, "AC105" if values else "AC106"):
            Lag(r=tuple(values))


@given(number)
def test_one_number_fills_a_vector(value: float) -> None:
    found = parameters(Lag(r=value))
    assert [found[f"r[{k}]"] for k in range(3)] == [value] * 3
    assert parameters(Lag(), r=value) == found


@given(st.sampled_from(["k", "x", "r", "v"]), st.one_of(st.text(max_size=4), st.none(), st.just({}), st.just(object)))
def test_what_is_no_quantity_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(DeclarationError) as caught:
        Lag(**{name: value})
    assert caught.value.code in ("AC106", "AC111")


@given(st.text(st.characters(categories=["Ll"]), min_size=1, max_size=6).filter(lambda n: n not in Lag._declarations))
def test_unknown_fields_are_refused_by_name(name: str) -> None:
    make: Any = Lag
    with fails_with(DeclarationError, "AC127", f"'{name}'"):
        make(**{name: 1.0})


@given(st.one_of(st.integers(), st.booleans()))
def test_structural_values_are_kept_as_they_are(value: Any) -> None:
    assert Lag(n=value).n is value


@given(st.one_of(st.floats(), st.text(max_size=3), st.tuples(st.integers())))
def test_structural_values_are_of_the_declared_plain_type(value: Any) -> None:
    """A number of periods is counted with `range`; what is declared otherwise than as a plain type takes anything."""
    with fails_with(DeclarationError, "AC115"):
        Lag(n=value)


@pytest.mark.parametrize("value", ["HOLD_LAST_POINT", 1, "its value"])
def test_a_member_of_an_enumeration_is_no_text(value: Any) -> None:
    """A name in place of the member was neither of the two extrapolations: the table took the other one."""
    make: Any = CombiTable1D
    with fails_with(DeclarationError, "AC115", "Extrapolation"):
        make(table=((0.0, 0.0), (1.0, 1.0)), extrapolation=value)


def test_starts_of_parameters_are_refused() -> None:
    for start in (fixed(1.0), guess(1.0)):
        with fails_with(DeclarationError, "AC110"):
            Lag(k=start)


@given(number, number)
def test_two_instances_share_nothing(one: float, other: float) -> None:
    a, b = Lag(k=one, x=one), Lag(k=other, x=other)
    assert parameters(a)["k"] == one
    assert parameters(b)["k"] == other
    assert a.x is not b.x


def test_a_vector_starts_entry_by_entry() -> None:
    flat = flatten(Lag(v=(0.1, 0.2, 0.3)))
    starts = [flat.pool.value(s.node) for s in flat.starts.values() if s.path == "v"]
    assert starts == [0.1, 0.2, 0.3]
    assert not any(math.isnan(v) for v in starts if v is not None)


def test_a_structural_list_is_what_it_was_when_it_was_given() -> None:
    """Three tables from one list that is filled anew for each: parameters are copied, and so are structural values."""

    class Tables(Component):
        tables: list[TimeTable] = part()

        def build(self) -> None:
            rows, self.tables = [[0.0, 0.0], [1.0, 0.0]], []
            for k in range(3):
                rows[1][1] = float(k)
                self.tables.append(TimeTable(table=rows))  # type: ignore[arg-type]

    result = acausal.simulate(Tables(), stop_time=1.0)
    assert [result.final(f"tables[{k}].y") for k in range(3)] == pytest.approx([0.0, 1.0, 2.0])


def test_a_default_list_is_not_shared() -> None:
    class Row(Component):
        numbers: list[float] = structural(default=[])
        y: Real = variable()

        def build(self) -> None:
            self.numbers.append(1.0)

        def equations(self) -> Equations:
            yield self.y == sum(self.numbers)

    assert [acausal.simulate(Row(), stop_time=1.0).final("y") for _ in range(2)] == [1.0, 1.0]
