"""Conditions: what is one, what is discrete, and that their values are those of Python's own logic."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal import (
    Component,
    Expr,
    Real,
    boolean,
    change,
    der,
    discrete,
    edge,
    equals,
    initial,
    integer,
    no_event,
    parameter,
    pre,
    sample,
    smooth,
    terminal,
    time,
    variable,
    when,
    where,
)
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.scalarise import scalars
from acausal.flatten.text import to_text
from acausal.language.expressions.conditions import is_discrete
from acausal.language.expressions.expression import is_condition
from tests.language.evaluating import value


class Thing(Component):
    """One of everything."""

    x: Real = variable()
    k: Real = parameter(default=2.0)
    a: Real = boolean()
    b: Real = boolean(default=True)
    flags: Real = boolean(shape=2)
    m: Real = integer()
    n: Real = integer(default=3)
    kept: Real = discrete(unit="m")


thing: Any = Thing()

CONDITIONS = {
    "a": thing.a,
    "flags[1]": thing.flags[1],
    "x > 0": thing.x > 0,
    "a & b | ~(x > 0)": thing.a & thing.b | ~(thing.x > 0),
    "pre(a)": pre(thing.a),
    "edge(x > 0)": edge(thing.x > 0),
    "change(n)": change(thing.n),
    "equals(m, 1)": equals(thing.m, 1),
    "sample(0, 0.1)": sample(0.0, 0.1),
    "initial() | terminal()": initial() | terminal(),
    "noevent(x > 0)": no_event(thing.x > 0),
    "where(a, b, x > 0)": where(thing.a, thing.b, thing.x > 0),
    "a & 1": thing.a & True,
}
NUMBERS = {
    "x": thing.x,
    "n": thing.n,
    "kept": thing.kept,
    "pre(n)": pre(thing.n),
    "where(a, 1, 0)": where(thing.a, 1.0, 0.0),
    "where(a, x, b)": where(thing.a, thing.x, thing.b),
    "time": time,
}


@pytest.mark.parametrize("text", CONDITIONS)
def test_conditions(text: str) -> None:
    assert is_condition(CONDITIONS[text])
    assert str(CONDITIONS[text]) == text
    assert is_condition(where(CONDITIONS[text], 1.0, 2.0).args[0])


@pytest.mark.parametrize("text", NUMBERS)
def test_numbers_are_no_conditions(text: str) -> None:
    assert not is_condition(NUMBERS[text])
    assert str(NUMBERS[text]) == text


def test_what_is_discrete() -> None:
    """Modelica 3.6, section 3.8.5: discrete variables, relations, and what is computed from these alone."""
    held = (thing.n, thing.kept, thing.x > time, thing.n + 2 * thing.k, where(thing.x > 0, thing.n, 1.0), pre(thing.a))
    varying = (thing.x, time, der(thing.x), thing.n + thing.x, no_event(thing.x > 0), where(thing.a, thing.x, 0.0))
    assert all(map(is_discrete, held))
    assert not any(map(is_discrete, varying))


def test_pre_of_what_mixes_both_kinds_is_taken_apart() -> None:
    assert str(pre(thing.n + thing.x)) == "pre(n) + pre(x)"
    assert str(pre(thing.kept / thing.k)) == "pre(kept / k)"
    assert pre(thing.k) is thing.k
    assert str(pre(pre(thing.n))) == "pre(n)"


def test_several_conditions_of_a_when_stay_apart() -> None:
    """Modelica 3.6, section 8.3.5.1: a when acts when any entry of its vector of conditions becomes true."""
    assert str(when((thing.a, thing.x > 0))) == "when((a, x > 0))"


def test_smooth_exempts_from_events_from_order_one_on() -> None:
    kinked = where(thing.x > 0, thing.x, 0.0)
    assert smooth(0, kinked) is kinked
    assert smooth(1, kinked).op == "noevent"


def text_of(e: Expr) -> str:
    pool = Pool()
    names = ("x", "a", "n")
    number = {name: pool.new_variables(1) for name in names}
    node = scalars(pool, e, lambda s: (pool.var(number[s.name]),), {})[0]
    return to_text(pool, node, lambda _, k: names[k])


def test_what_the_compiler_makes_of_them() -> None:
    """`edge`, `change` and `equals` are abbreviations (Modelica 3.6, section 3.7.5)."""
    assert text_of(edge(thing.a)) == "a & ~pre(a)"
    assert text_of(change(thing.a)) == "a & ~pre(a) | ~a & pre(a)"
    assert text_of(change(thing.n)) == "(n < pre(n)) | (n > pre(n))"
    assert text_of(equals(thing.n, 1)) == "~((n < 0.5) | (n > 1.5))"
    assert text_of(edge(thing.x > 0)) == "(x > 0) & ~pre(x > 0)"


Made = tuple[Expr, Callable[[dict[str, float]], bool]]


def both(left: Made, right: Made) -> Made:
    return left[0] & right[0], lambda v: left[1](v) and right[1](v)


def either(left: Made, right: Made) -> Made:
    return left[0] | right[0], lambda v: left[1](v) or right[1](v)


def chosen(c: Made, x: Made, y: Made) -> Made:
    return where(c[0], x[0], y[0]), lambda v: x[1](v) if c[1](v) else y[1](v)


LEAVES: list[Made] = [
    (thing.a, lambda v: bool(v["a"])),
    (thing.b, lambda v: bool(v["b"])),
    (thing.x > 0.5, lambda v: v["x"] > 0.5),
    (thing.x <= thing.n, lambda v: v["x"] <= v["n"]),
    (equals(thing.m, thing.n), lambda v: v["m"] == v["n"]),
    (equals(thing.m, 2), lambda v: v["m"] == 2),
    (change(thing.n), lambda v: False),  # between events nothing changes
    (edge(thing.a), lambda v: False),
    (initial(), lambda v: False),
]
LOGIC = st.recursive(
    st.sampled_from(LEAVES),
    lambda inner: st.one_of(
        st.builds(both, inner, inner),
        st.builds(either, inner, inner),
        inner.map(lambda made: (~made[0], lambda v: not made[1](v))),
        st.builds(chosen, inner, inner, inner),
    ),
    max_leaves=12,
)
VALUES = st.fixed_dictionaries(
    {
        "a": st.sampled_from([0.0, 1.0]),
        "b": st.sampled_from([0.0, 1.0]),
        "m": st.integers(-3, 3).map(float),
        "n": st.integers(-3, 3).map(float),
        "x": st.floats(-4.0, 4.0),
    }
)


@given(LOGIC, VALUES)
def test_logic_is_that_of_python(made: Made, given_values: dict[str, float]) -> None:
    condition, expected = made
    assert is_condition(condition)
    assert is_discrete(condition)
    assert value(condition, given_values) == float(expected(given_values))
