"""AC101 to AC111: expressions that have no meaning, wrong shapes, wrong values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from acausal import (
    Component,
    Real,
    parameter,
    signal_input,
    signal_output,
    structural,
    variable,
)
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


@corpus.wrong("AC105", "`x == ", "_ = thing.x == 0.5 * (thing.v * thing.v)")
def scalar_product_by_elements() -> None:
    _ = thing.x == 0.5 * (thing.v * thing.v)


@corpus.wrong("AC105", "Sized.u", "Sized()", "u: Real = variable(shape=lambda self: self.n)")
def shape_that_is_none() -> None:
    class Sized(Component):
        n: int = structural(default=0)
        u: Real = variable(shape=lambda self: self.n)

    Sized()


corpus.table(
    """
AC101 x == y -- thing.x == thing.y == 1.0
AC102 x != ... -- thing.x != 1.0
AC103 `v` -- thing.v[3]
AC103 `x` -- thing.x[0]
AC103 `R` -- list(thing.R)
AC104 `x` -- math.sin(thing.x)
AC104 numpy.sin -- np.sin(thing.x)
AC104 `k` -- range(thing.k)
AC105 v == x -- thing.v == thing.x
AC105 `R` -- thing.R * thing.R
AC105 `v[1:]` -- thing.v[1:] * thing.v
AC103 `v[1.5]` -- thing.v[1.5]
AC104 `x` -- thing.v[: thing.x]
AC103 [1:4] -- thing.v[1:4]
AC108 `v > x` -- when(thing.v > thing.x, reset(thing.x, 0.0))
AC105 `R` -- concatenate(thing.x, thing.R)
AC110 fill(`x`, 0) -- fill(thing.x, 0)
AC105 `R` -- thing.R @ (1.0, 2.0)
AC105 `R` -- sin(thing.R)
AC105 cross -- cross(thing.v, (1.0, 2.0))
AC105 `x` -- as_expr([thing.v, thing.x])
AC105 'v' -- Thing(v=fixed((1.0, 2.0)))
AC106 '1 m' -- thing.x + "1 m"
AC107 log(-1) -- log(-1.0)
AC110 'k' -- Thing(k=fixed(1.0))
AC111 'k' -- Thing(k="1 N/m")

branch_on_a_parameter AC101 k > 0
> if thing.k > 0:
    pass

branch_on_a_variable AC101 x > 0
> if thing.x > 0 and thing.y > 0:
    pass

size_without_a_value AC113 'n'
class Sized(Component):
    n: int = structural()
    u: Real = variable(shape=lambda self: self.n)
made: Any = Sized
> made()

connector_of_some_size AC123 'u'
class Port(Connector):
>     u: Real = variable(shape=lambda self: 2)
    i: Real = flow()

where_without_a_relation AC108 True
condition: Any = True
> where(condition, 1.0, 2.0)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


def test_numbers_and_arrays_of_numpy_can_stand_on_the_left() -> None:
    """What numpy passes on to the expression is what Python's own numbers give."""
    assert str(np.float64(2.0) * thing.x) == "2 * x"
    assert str(np.array([1.0, 2.0, 3.0]) + thing.v) == "(1, 2, 3) + v"
    assert str(np.eye(3) @ thing.v) == "((1, 0, 0), (0, 1, 0), (0, 0, 1)) @ v"
    assert str(np.float64(1.0) < thing.x) == "1 < x"
