"""Every public function and operator takes an operand, or refuses it with a code: no operand is an error of Python.

The kinds of operand are all that a modeller has at hand: declared quantities of all shapes, relations, numbers, arrays
of numpy, and what has no place in an equation at all.
"""

from __future__ import annotations

import inspect
import math
import operator
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import AcausalError, Component, Real, boolean, integer, parameter, quantity, variable
from acausal.language.expressions.expression import Expr
from tests.expected import fails_with


class Held(Component):
    x: Real = variable(unit="m")
    v: Real = variable(shape=3)
    A: Real = variable(shape=(3, 3))
    i: Real = integer()
    b: Real = boolean()
    p: Real = parameter(default=1.0)


held: Any = Held()  # a type checker would refuse most of what follows
QUANTITIES: dict[str, Any] = {"x": held.x, "v": held.v, "A": held.A, "i": held.i, "b": held.b, "p": held.p}
QUANTITIES |= {"relation": held.x > 0, "relations": held.v > 0, "quantity": quantity(3.0, "m")}
OTHERS: dict[str, Any] = {"number": 1.5, "negative": -1, "zero": 0, "inf": math.inf, "nan": math.nan, "true": True}
OTHERS |= {"none": None, "text": "a", "list": [1.0, 2.0, 3.0], "ragged": [[1], [2, 3]], "empty": [], "complex": 1j}
OTHERS |= {"array": np.arange(3.0), "matrix": np.eye(3), "cube": np.zeros((2, 2, 2)), "scalar": np.array(2.0)}
OTHERS |= {"object": object(), "component": held, "class": Held, "function": len, "set": {1, 2}}
KINDS = QUANTITIES | OTHERS

FUNCTIONS = {
    name: member
    for name, member in vars(acausal).items()
    if inspect.isfunction(member) and member.__module__.startswith("acausal.language")
}
OPERATORS: list[Callable[[Any, Any], Any]] = [operator.add, operator.sub, operator.mul, operator.truediv, operator.pow]
OPERATORS += [operator.matmul, operator.eq, operator.lt, operator.ge, operator.and_, operator.or_, operator.xor]
OPERATORS += [operator.mod, operator.floordiv, divmod, operator.lshift, operator.rshift]
DECLARATIONS = ["variable", "discrete", "boolean", "integer", "boolean_input", "boolean_output", "flow"]
DECLARATIONS += ["signal_input", "signal_output", "parameter"]


def refused_by_python(function: Callable[..., Any], count: int, kinds: dict[str, Any]) -> list[str]:
    found = []
    for names in product(kinds, repeat=count):
        try:
            str(function(*(kinds[n] for n in names)))
        except AcausalError:
            pass
        except Exception as error:
            found.append(f"{names}: {type(error).__name__}: {error}")
    return found


@pytest.mark.parametrize("name", sorted(FUNCTIONS.keys() - {*DECLARATIONS, "structural", "part", "outer"}))
def test_every_function_takes_its_operands_or_refuses_them(name: str) -> None:
    parameters = inspect.signature(FUNCTIONS[name]).parameters.values()
    asked = sum(p.default is p.empty and p.kind is p.POSITIONAL_OR_KEYWORD for p in parameters)
    few = {n: KINDS[n] for n in ("x", "v", "b", "relation", "number", "none", "text", "array")}
    assert not refused_by_python(FUNCTIONS[name], asked, KINDS if asked < 3 else few)


@pytest.mark.parametrize("operation", OPERATORS)
def test_every_operator_takes_its_operands_or_refuses_them(operation: Callable[[Any, Any], Any]) -> None:
    """With a quantity on either side: numbers among each other, and texts, are Python's own."""
    found = refused_by_python(operation, 2, QUANTITIES)
    for name in OTHERS.keys() - {"text"}:
        for other in QUANTITIES:
            found += refused_by_python(lambda _, n=name, o=other: operation(KINDS[n], KINDS[o]), 1, {name: None})
            found += refused_by_python(lambda _, n=name, o=other: operation(KINDS[o], KINDS[n]), 1, {name: None})
    assert not found


@pytest.mark.parametrize(
    "function", [round, math.trunc, math.floor, abs, np.sum, np.max, np.prod, np.sin, "{:.3f}".format]
)
def test_functions_of_python_and_numpy(function: Callable[[Any], Any]) -> None:
    assert not refused_by_python(function, 1, QUANTITIES)


@pytest.mark.parametrize("name", DECLARATIONS)
def test_every_declaration_takes_its_arguments_or_refuses_them(name: str) -> None:
    declare = getattr(acausal, name)
    for argument in inspect.signature(declare).parameters:
        assert not refused_by_python(lambda value, a=argument: declare(**{a: value}), 1, OTHERS)


def test_what_a_modeller_of_another_language_writes_is_answered() -> None:
    cases: list[tuple[Callable[[], Any], str]] = [
        (lambda: held.p ^ 2, "a ** b"),
        (lambda: held.p % 2, "a - b * floor(a / b)"),
        (lambda: held.p // 2, "floor(a / b)"),
        (lambda: round(held.p), "floor(x + 0.5)"),
        (lambda: np.sum(held.v), "sum(v)"),
    ]
    for wrong, instead in cases:
        with fails_with(AcausalError, "AC104") as caught:
            wrong()
        assert instead in str(caught.value.help)
    assert isinstance(sum(held.v), Expr)
