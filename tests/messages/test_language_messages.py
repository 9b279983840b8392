"""AC101 to AC111: expressions that have no meaning, wrong shapes, wrong values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from acausal import (
    Component,
    Real,
    cross,
    fixed,
    log,
    parameter,
    signal_input,
    signal_output,
    sin,
    structural,
    variable,
    where,
)
from acausal.language.expression import as_expr
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


@corpus.wrong(
    "AC101",
    "k > 0",
    """
error[AC101]: `k > 0` is symbolic, not a truth value
  at      test_language_messages.py:N
              if thing.k > 0:
  help    declare k with structural(...) if it decides the equations; for a value write where(...)
""",
)
def branch_on_a_parameter() -> None:
    if thing.k > 0:
        pass


@corpus.wrong(
    "AC101",
    "x > 0",
    """
error[AC101]: `x > 0` is symbolic, not a truth value
  at      test_language_messages.py:N
              if thing.x > 0 and thing.y > 0:
  help    write where(condition, a, b) for a value, and & | ~ between conditions
""",
)
def branch_on_a_variable() -> None:
    if thing.x > 0 and thing.y > 0:
        pass


@corpus.wrong(
    "AC101",
    "x == y",
    """
error[AC101]: `x == y` is an equation, not a truth value
  at      test_language_messages.py:N
              thing.x == thing.y == 1.0  # noqa: B015
  help    yield it; `a == b == c`, `in`, `if` and `assert` ask for a truth value that an equation does not have
""",
)
def chained_equation() -> None:
    thing.x == thing.y == 1.0  # noqa: B015


@corpus.wrong(
    "AC102",
    "x != ...",
    """
error[AC102]: `x != ...` has no meaning for equations
  at      test_language_messages.py:N
              thing.x != 1.0  # noqa: B015
  help    use < and >, or where(...)
""",
)
def unequal() -> None:
    thing.x != 1.0  # noqa: B015


@corpus.wrong(
    "AC103",
    "`v`",
    """
error[AC103]: `v` is a vector of 3; it has no element [3]
  at      test_language_messages.py:N
              thing.v[3]
  help    indices count from 0: [0 to 2]
""",
)
def index_beyond_the_end() -> None:
    thing.v[3]


@corpus.wrong(
    "AC103",
    "`x`",
    """
error[AC103]: `x` is a scalar; it has no element [0]
  at      test_language_messages.py:N
              thing.x[0]
  help    use it without an index
""",
)
def index_of_a_scalar() -> None:
    thing.x[0]


@corpus.wrong(
    "AC103",
    "`R`",
    """
error[AC103]: `R` is a 3x3 matrix; only vectors can be iterated
  at      test_language_messages.py:N
              list(thing.R)
  help    index a matrix by row and column: R[0, 1]
""",
)
def iterated_matrix() -> None:
    list(thing.R)


@corpus.wrong(
    "AC104",
    "`x`",
    """
error[AC104]: `x` is symbolic and has no float value
  at      test_language_messages.py:N
              math.sin(thing.x)
  help    use acausal.sin, acausal.sqrt, acausal.fabs ... instead of the math and numpy functions
""",
)
def math_function() -> None:
    math.sin(thing.x)


@corpus.wrong(
    "AC104",
    "numpy.sin",
    """
error[AC104]: numpy.sin does not take the symbolic `x`
  at      test_language_messages.py:N
              np.sin(thing.x)
  help    use acausal.sin, if there is one: numpy knows numbers only
""",
)
def numpy_function() -> None:
    np.sin(thing.x)


@corpus.wrong(
    "AC104",
    "`k`",
    """
error[AC104]: `k` is symbolic and has no int value
  at      test_language_messages.py:N
              range(thing.k)
  help    what counts, indexes or sizes is declared with structural(...)
""",
)
def count_by_a_parameter() -> None:
    range(thing.k)


@corpus.wrong(
    "AC105",
    "v == x",
    """
error[AC105]: `v == x`: the left side is a vector of 3, the right side a scalar
  at      test_language_messages.py:N
              thing.v == thing.x  # noqa: B015
  help    both sides need one shape; only a literal number adapts: v == 0
""",
)
def sides_of_different_shape() -> None:
    thing.v == thing.x  # noqa: B015


@corpus.wrong(
    "AC105",
    "`v`",
    """
error[AC105]: * does not take `v` (vector of 3) and `v` (vector of 3)
  at      test_language_messages.py:N
              thing.v * thing.v
  help    use dot(a, b), cross(a, b) or a @ b
""",
)
def product_of_vectors() -> None:
    thing.v * thing.v


@corpus.wrong(
    "AC105",
    "`R`",
    """
error[AC105]: @ does not take `R` (3x3 matrix) and `(1, 2)` (vector of 2)
  at      test_language_messages.py:N
              thing.R @ (1.0, 2.0)
  help    the columns of the left matrix must be as many as the rows of the right one
""",
)
def matrix_times_short_vector() -> None:
    thing.R @ (1.0, 2.0)


@corpus.wrong(
    "AC105",
    "`v`",
    """
error[AC105]: sin does not take `v` (vector of 3)
  at      test_language_messages.py:N
              sin(thing.v)
  help    it works on scalars; take elements, such as v[0]
""",
)
def sine_of_a_vector() -> None:
    sin(thing.v)


@corpus.wrong(
    "AC105",
    "cross",
    """
error[AC105]: cross does not take `v` (vector of 3) and `(1, 2)` (vector of 2)
  at      test_language_messages.py:N
              cross(thing.v, (1.0, 2.0))
  help    cross takes two vectors of 3
""",
)
def cross_product_in_the_plane() -> None:
    cross(thing.v, (1.0, 2.0))


@corpus.wrong(
    "AC105",
    "`x`",
    """
error[AC105]: no vector or matrix can be made of `v` (vector of 3), `x` (scalar)
  at      test_language_messages.py:N
              as_expr([thing.v, thing.x])
  help    a vector is made of scalars, a matrix of rows of one length
""",
)
def ragged_vector() -> None:
    as_expr([thing.v, thing.x])


@corpus.wrong(
    "AC105",
    "'v'",
    """
error[AC105]: Thing: 'v' is a vector of 3, the value `(1, 2)` a vector of 2
  at      test_language_messages.py:N
              make(v=fixed((1.0, 2.0)))
  help    a single number fills a vector or a matrix; anything else needs its shape
""",
)
def value_of_wrong_shape() -> None:
    make(v=fixed((1.0, 2.0)))


@corpus.wrong(
    "AC106",
    "'1 m'",
    """
error[AC106]: '1 m' (str) cannot take part in an equation
  at      test_language_messages.py:N
              thing.x + "1 m"
  help    use numbers, declared variables, tuples of them, or the functions of acausal
""",
)
def text_in_an_expression() -> None:
    thing.x + "1 m"


@corpus.wrong(
    "AC107",
    "log(-1)",
    """
error[AC107]: log(-1) has no value
  at      test_language_messages.py:N
              log(-1.0)
  help    log is not defined for this number
""",
)
def logarithm_of_a_negative_number() -> None:
    log(-1.0)


@corpus.wrong(
    "AC108",
    "True",
    """
error[AC108]: `True` (bool) is not a condition
  at      test_language_messages.py:N
              where(condition, 1.0, 2.0)
  help    write a relation such as x > 0; what is known to Python is decided with a plain `if`
""",
)
def where_without_a_relation() -> None:
    condition: Any = True
    where(condition, 1.0, 2.0)


@corpus.wrong(
    "AC110",
    "'k'",
    """
error[AC110]: Thing: parameter 'k' takes a value, not a start
  at      test_language_messages.py:N
              make(k=fixed(1.0))
  help    Thing(k=...) without fixed() and guess(): they are for variables
""",
)
def start_of_a_parameter() -> None:
    make(k=fixed(1.0))


@corpus.wrong(
    "AC111",
    "'k'",
    """
error[AC111]: Thing: parameter 'k' cannot be '1 N/m'
  at      test_language_messages.py:N
              make(k="1 N/m")
  help    give a number in N/m, or an expression; values with units are for the command line
""",
)
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
