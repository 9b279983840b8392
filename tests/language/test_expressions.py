"""Expressions: their values are Python's, their texts are Python that gives the same values, arrays are numpy's."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import acausal
from acausal import (
    Component,
    Expr,
    Real,
    as_expr,
    cross,
    dot,
    identity,
    maximum,
    minimum,
    norm,
    skew,
    variable,
    where,
)
from acausal.errors import DeclarationError
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.scalarise import scalars
from acausal.language.expressions.expression import Symbol, symbols_in
from acausal.numeric.evaluate import values
from tests.expected import fails_with
from tests.language.evaluating import value

Array = NDArray[np.float64]
NAMES = ("x", "y", "z")


class Thing(Component):
    """Scalars, vectors and matrices."""

    x: Real = variable()
    y: Real = variable()
    z: Real = variable()
    a: Real = variable(shape=3)
    b: Real = variable(shape=3)
    c: Real = variable(shape=2)
    P: Real = variable(shape=(3, 3))
    Q: Real = variable(shape=(3, 3))
    S: Real = variable(shape=(2, 3))


thing: Any = Thing()
numbers = st.floats(-3.0, 3.0).map(lambda v: round(v, 3))
leaf = st.one_of(st.sampled_from(NAMES), numbers)
Tree = Any


def _branches(inner: st.SearchStrategy[Tree]) -> st.SearchStrategy[Tree]:
    return st.one_of(
        st.tuples(st.sampled_from(["+", "-", "*", "max", "min", "where"]), inner, inner),
        st.tuples(st.sampled_from(["neg", "sin", "cos", "tanh", "abs", "square", "half", "cube of square"]), inner),
    )


trees = st.recursive(leaf, _branches, max_leaves=12)


def python(tree: Tree, at: dict[str, Any]) -> Any:
    """The tree as Python computes it: on floats, or on symbols."""
    if isinstance(tree, str):
        return at[tree]
    if isinstance(tree, float):
        return tree
    op, *parts = tree
    a, *rest = [python(p, at) for p in parts]
    is_symbolic = isinstance(at["x"], Expr)
    m: Any = acausal if is_symbolic else math
    if op in ("max", "min"):
        function = {"max": maximum, "min": minimum}[op] if is_symbolic else {"max": max, "min": min}[op]
        return function(a, rest[0])
    if op == "where":
        a = a + at["x"]
        return where(a > rest[0], a, rest[0]) if is_symbolic else (a if a > rest[0] else rest[0])
    unary = {"sin": m.sin, "cos": m.cos, "tanh": m.tanh}
    if op in unary:
        return unary[op](a)
    simple: dict[str, Any] = {
        "+": lambda: a + rest[0],
        "-": lambda: a - rest[0],
        "*": lambda: a * rest[0],
        "neg": lambda: -a,
        "abs": lambda: abs(a),
        "square": lambda: a**2,
        "half": lambda: a / 2.0,
        "cube of square": lambda: (a**2) ** 3 / 1e3,
    }
    return simple[op]()


SYMBOLS = {name: getattr(thing, name) for name in NAMES}
TEXT_NAMES = {"sin": acausal.sin, "cos": acausal.cos, "tanh": acausal.tanh, "fabs": acausal.fabs, "where": where} | {
    "maximum": maximum,
    "minimum": minimum,
    "max": maximum,
    "min": minimum,
    "abs": abs,
}


@given(trees, st.tuples(numbers, numbers, numbers))
def test_values_are_those_of_python(tree: Tree, at: tuple[float, float, float]) -> None:
    given_values: dict[str, float] = dict(zip(NAMES, at, strict=True))
    expression = as_expr(python(tree, SYMBOLS))
    assert value(expression, given_values) == pytest.approx(python(tree, given_values), rel=1e-12, abs=1e-9)


@given(trees, st.tuples(numbers, numbers, numbers))
def test_the_text_is_python_for_the_same_value(tree: Tree, at: tuple[float, float, float]) -> None:
    """Parentheses, signs and powers are where they must be; constants are written to six digits."""
    given_values: dict[str, float] = dict(zip(NAMES, at, strict=True))
    expression = as_expr(python(tree, SYMBOLS))
    text = str(expression)
    if "..." in text:  # long ones are cut
        return
    again = as_expr(eval(text, dict(TEXT_NAMES), SYMBOLS))
    assert value(again, given_values) == pytest.approx(value(expression, given_values), rel=1e-4, abs=1e-3)


def array(e: Expr, at: dict[str, Array]) -> Array:
    """Value of an expression of any shape."""
    pool = Pool()
    first = {s.name: pool.new_variables(math.prod(s.shape)) for s in symbols_in(e)}

    def resolve(s: Symbol) -> tuple[int, ...]:
        return tuple(pool.var(first[s.name] + k) for k in range(math.prod(s.shape)))

    nodes = scalars(pool, e, resolve, {})
    flat = {first[name] + k: float(v) for name in first for k, v in enumerate(np.ravel(at[name]))}
    known = values(pool, nodes, {"var": flat.__getitem__, "time": lambda _: 0.0})
    return np.array([known[n] for n in nodes], dtype=float).reshape(e.shape)


entry = st.floats(-2.0, 2.0)
seeds = st.integers(0, 10**6)


def sample(seed: int) -> dict[str, Array]:
    random = np.random.default_rng(seed)
    shapes: dict[str, Any] = {"x": (), "y": (), "z": (), "a": 3, "b": 3, "c": 2, "P": (3, 3), "Q": (3, 3), "S": (2, 3)}
    return {name: np.asarray(random.uniform(-2.0, 2.0, shape)) for name, shape in shapes.items()}


ARRAYS: dict[str, tuple[Any, Any]] = {
    "a + b": (thing.a + thing.b, lambda v: v["a"] + v["b"]),
    "x * a": (thing.x * thing.a, lambda v: v["x"] * v["a"]),
    "a / 2": (thing.a / 2.0, lambda v: v["a"] / 2),
    "P @ Q": (thing.P @ thing.Q, lambda v: v["P"] @ v["Q"]),
    "P @ a": (thing.P @ thing.a, lambda v: v["P"] @ v["a"]),
    "a @ P": (thing.a @ thing.P, lambda v: v["a"] @ v["P"]),
    "a @ b": (thing.a @ thing.b, lambda v: v["a"] @ v["b"]),
    "S @ a": (thing.S @ thing.a, lambda v: v["S"] @ v["a"]),
    "S @ P": (thing.S @ thing.P, lambda v: v["S"] @ v["P"]),
    "S.T @ c": (thing.S.T @ thing.c, lambda v: v["S"].T @ v["c"]),
    "P.T": (thing.P.T, lambda v: v["P"].T),
    "cross": (cross(thing.a, thing.b), lambda v: np.cross(v["a"], v["b"])),
    "skew": (skew(thing.a) @ thing.b, lambda v: np.cross(v["a"], v["b"])),
    "dot": (dot(thing.a, thing.b), lambda v: np.dot(v["a"], v["b"])),
    "norm": (norm(thing.a), lambda v: np.linalg.norm(v["a"])),
    "identity": (identity(3) @ thing.a, lambda v: v["a"]),
    "element": (thing.P[1, 2] * thing.a[0], lambda v: v["P"][1, 2] * v["a"][0]),
    "negative index": (thing.a[-1], lambda v: v["a"][-1]),
    "tuple": (thing.a - (1.0, 2.0, 3.0), lambda v: v["a"] - np.array([1.0, 2.0, 3.0])),
    "numpy": (np.array([1.0, 2.0, 3.0]) * thing.x, lambda v: np.array([1.0, 2.0, 3.0]) * v["x"]),
    "numpy matrix": (np.diag([1.0, 2.0, 3.0]) @ thing.a, lambda v: np.diag([1.0, 2.0, 3.0]) @ v["a"]),
    "iterated": (sum(thing.a[k] * k for k in range(3)), lambda v: sum(v["a"][k] * k for k in range(3))),
}


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_arrays_are_those_of_numpy(name: str, seed: int) -> None:
    expression, expected = ARRAYS[name]
    at = sample(seed)
    np.testing.assert_allclose(array(as_expr(expression), at), expected(at), rtol=1e-12, atol=1e-12)


@given(st.sampled_from("xacPS"), st.sampled_from("xacPS"), st.sampled_from(["+", "-", "*", "/", "@"]))
def test_shapes_agree_or_are_refused(first: str, second: str, op: str) -> None:
    """Sums need one shape, products a scalar or two equal vectors, matrix products matching sizes."""
    a, b = getattr(thing, first), getattr(thing, second)
    at = sample(4)
    fits = {
        "+": a.shape == b.shape,
        "-": a.shape == b.shape,
        "*": not a.shape or not b.shape or (a.shape == b.shape and len(a.shape) == 1),
        "/": not b.shape or (len(b.shape) == 1 and a.shape in ((), b.shape)),
        "@": bool(a.shape and b.shape) and a.shape[-1] == b.shape[0],
    }[op]
    operation: Any = {
        "+": operator.add,
        "-": operator.sub,
        "*": operator.mul,
        "/": operator.truediv,
        "@": operator.matmul,
    }[op]
    if fits:
        np.testing.assert_allclose(array(operation(a, b), at), operation(at[first], at[second]), rtol=1e-12)
    else:
        with fails_with(DeclarationError, "AC105"):
            operation(a, b)
