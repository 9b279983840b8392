"""AC101 to AC111: expressions that have no meaning, wrong shapes, wrong values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from acausal import (
    Component,
    Connector,
    Real,
    concatenate,
    cross,
    fill,
    fixed,
    flow,
    log,
    parameter,
    reset,
    signal_input,
    signal_output,
    sin,
    structural,
    variable,
    when,
    where,
)
from acausal.language.expressions.expression import as_expr
from tests.messages.cases import Case, Corpus

corpus = Corpus()


class Thing(Component):
    """One of everything."""

    x: Real = variable(unit="m")
    v: Real = variable(unit="m/s", shape=3)
    R: Real = variable(shape=(3, 3))
    k: Real = parameter(default=2.0, unit="N/m", min=0.0)
    n: int = structural(default=2)
    u: Real = signal_input(unit="V")
    y: Real = signal_output(unit="m")


# Any: a type checker would refuse most of what follows.
thing: Any = Thing()
make: Any = Thing


@corpus.wrong("AC101", "k > 0", "if thing.k > 0:")
def branch_on_a_parameter() -> None:
    if thing.k > 0:
        pass


@corpus.wrong("AC101", "x > 0", "if thing.x > 0 and thing.y > 0:")
def branch_on_a_variable() -> None:
    if thing.x > 0 and thing.y > 0:
        pass


@corpus.wrong("AC101", "x == y", "thing.x == thing.y == 1.0  # noqa: B015")
def chained_equation() -> None:
    thing.x == thing.y == 1.0  # noqa: B015


@corpus.wrong("AC102", "x != ...", "thing.x != 1.0  # noqa: B015")
def unequal() -> None:
    thing.x != 1.0  # noqa: B015


@corpus.wrong("AC103", "`v`", "thing.v[3]")
def index_beyond_the_end() -> None:
    thing.v[3]


@corpus.wrong("AC103", "`x`", "thing.x[0]")
def index_of_a_scalar() -> None:
    thing.x[0]


@corpus.wrong("AC103", "`R`", "list(thing.R)")
def iterated_matrix() -> None:
    list(thing.R)


@corpus.wrong("AC104", "`x`", "math.sin(thing.x)")
def math_function() -> None:
    math.sin(thing.x)


@corpus.wrong("AC104", "numpy.sin", "np.sin(thing.x)")
def numpy_function() -> None:
    np.sin(thing.x)


@corpus.wrong("AC104", "`k`", "range(thing.k)")
def count_by_a_parameter() -> None:
    range(thing.k)


@corpus.wrong("AC105", "v == x", "thing.v == thing.x  # noqa: B015")
def sides_of_different_shape() -> None:
    thing.v == thing.x  # noqa: B015


@corpus.wrong("AC105", "`R`", "thing.R * thing.R")
def product_of_matrices_by_elements() -> None:
    thing.R * thing.R


@corpus.wrong("AC105", "`v[1:]`", "thing.v[1:] * thing.v")
def product_of_vectors_of_two_lengths() -> None:
    thing.v[1:] * thing.v


@corpus.wrong("AC105", "`x == ", "_ = thing.x == 0.5 * (thing.v * thing.v)")
def scalar_product_by_elements() -> None:
    _ = thing.x == 0.5 * (thing.v * thing.v)


@corpus.wrong("AC113", "'n'", "made()")
def size_without_a_value() -> None:
    class Sized(Component):
        n: int = structural()
        u: Real = variable(shape=lambda self: self.n)

    made: Any = Sized
    made()


@corpus.wrong("AC103", "`v[1.5]`", "thing.v[1.5]")
def index_between_two_elements() -> None:
    thing.v[1.5]


@corpus.wrong("AC104", "`x`", "thing.v[: thing.x]")
def slice_up_to_a_variable() -> None:
    thing.v[: thing.x]


@corpus.wrong("AC103", "[1:4]", "thing.v[1:4]")
def slice_beyond_the_end() -> None:
    thing.v[1:4]


@corpus.wrong("AC108", "`v > x`", "when(thing.v > thing.x, reset(thing.x, 0.0))")
def when_of_a_vector_of_conditions() -> None:
    when(thing.v > thing.x, reset(thing.x, 0.0))


@corpus.wrong("AC105", "`R`", "concatenate(thing.x, thing.R)")
def concatenation_with_a_matrix() -> None:
    concatenate(thing.x, thing.R)


@corpus.wrong("AC110", "fill(`x`, 0)", "fill(thing.x, 0)")
def vector_of_no_elements() -> None:
    fill(thing.x, 0)


@corpus.wrong("AC105", "Sized.u", "Sized()", "u: Real = variable(shape=lambda self: self.n)")
def shape_that_is_none() -> None:
    class Sized(Component):
        n: int = structural(default=0)
        u: Real = variable(shape=lambda self: self.n)

    Sized()


@corpus.wrong("AC123", "'u'", "u: Real = variable(shape=lambda self: 2)")
def connector_of_some_size() -> None:
    class Port(Connector):
        u: Real = variable(shape=lambda self: 2)
        i: Real = flow()


@corpus.wrong("AC105", "`R`", "thing.R @ (1.0, 2.0)")
def matrix_times_short_vector() -> None:
    thing.R @ (1.0, 2.0)


@corpus.wrong("AC105", "`R`", "sin(thing.R)")
def sine_of_a_matrix() -> None:
    sin(thing.R)


@corpus.wrong("AC105", "cross", "cross(thing.v, (1.0, 2.0))")
def cross_product_in_the_plane() -> None:
    cross(thing.v, (1.0, 2.0))


@corpus.wrong("AC105", "`x`", "as_expr([thing.v, thing.x])")
def ragged_vector() -> None:
    as_expr([thing.v, thing.x])


@corpus.wrong("AC105", "'v'", "make(v=fixed((1.0, 2.0)))")
def value_of_wrong_shape() -> None:
    make(v=fixed((1.0, 2.0)))


@corpus.wrong("AC106", "'1 m'", 'thing.x + "1 m"')
def text_in_an_expression() -> None:
    thing.x + "1 m"


@corpus.wrong("AC107", "log(-1)", "log(-1.0)")
def logarithm_of_a_negative_number() -> None:
    log(-1.0)


@corpus.wrong("AC108", "True", "where(condition, 1.0, 2.0)")
def where_without_a_relation() -> None:
    condition: Any = True
    where(condition, 1.0, 2.0)


@corpus.wrong("AC110", "'k'", "make(k=fixed(1.0))")
def start_of_a_parameter() -> None:
    make(k=fixed(1.0))


@corpus.wrong("AC111", "'k'", 'make(k="1 N/m")')
def text_as_a_value() -> None:
    make(k="1 N/m")


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


def test_numbers_and_arrays_of_numpy_can_stand_on_the_left() -> None:
    """What numpy passes on to the expression is what Python's own numbers give."""
    assert str(np.float64(2.0) * thing.x) == "2 * x"
    assert str(np.array([1.0, 2.0, 3.0]) + thing.v) == "(1, 2, 3) + v"
    assert str(np.eye(3) @ thing.v) == "((1, 0, 0), (0, 1, 0), (0, 0, 1)) @ v"
    assert str(np.float64(1.0) < thing.x) == "1 < x"
