"""Text of pool expressions: Python reads it back to the same value, and its length is bounded."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.flatten.pool import Pool
from acausal.flatten.text import to_text
from acausal.numeric.evaluate import values

NAMES = {("var", 0): "x", ("var", 1): "y", ("par", 0): "k"}
VALUES = {"x": 1.3, "y": 0.7, "k": 2.5}
FUNCTIONS: dict[str, Any] = {
    "sin": math.sin,
    "minimum": min,
    "where": lambda c, a, b: a if c else b,
    "fabs": abs,
}


def name_of(op: str, k: int) -> str:
    return NAMES[op, k]


def text(pool: Pool, node: int, limit: int = 400) -> str:
    return to_text(pool, node, name_of, limit)


@pytest.fixture
def pool() -> Pool:
    pool = Pool()
    pool.new_variables(2)
    return pool


def test_parentheses_stand_where_python_needs_them(pool: Pool) -> None:
    x, y, k = pool.var(0), pool.var(1), pool.par(0)
    make = pool.make
    assert text(pool, make("sub", x, make("sub", y, k))) == "x - (y - k)"
    assert text(pool, make("sub", make("sub", x, y), k)) == "x - y - k"
    assert text(pool, make("mul", x, make("add", y, k))) == "x*(y + k)"
    assert text(pool, make("div", x, make("mul", y, k))) == "x/(y*k)"
    assert text(pool, make("pow", make("neg", x), pool.const(2.0))) == "(-x)**2"
    assert text(pool, make("neg", make("pow", x, pool.const(2.0)))) == "-x**2"
    assert text(pool, make("pow", x, pool.const(-1.0))) == "x**(-1)"
    assert text(pool, make("where", make("lt", pool.time, k), x, pool.zero)) == "where(time < k, x, 0)"
    either = make("or", make("lt", x, y), make("and", make("not", make("ge", x, k)), make("gt", y, k)))
    assert text(pool, either) == "(x < y) | ~(x >= k) & (y > k)"
    assert text(pool, make("min", x, make("sin", y))) == "minimum(x, sin(y))"


def _expressions() -> st.SearchStrategy[Any]:
    leaves = st.sampled_from(["x", "y", "k", 2.0, -3.0])
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(st.sampled_from(["add", "sub", "mul", "div", "pow", "min"]), inner, inner),
            st.tuples(st.sampled_from(["neg", "sin", "fabs"]), inner),
            st.tuples(st.just("where"), st.tuples(st.sampled_from(["lt", "ge"]), inner, inner), inner, inner),
        ),
        max_leaves=12,
    )


def _node(pool: Pool, expression: Any) -> int:
    if isinstance(expression, float):
        return pool.const(expression)
    if isinstance(expression, str):
        return {"x": pool.var(0), "y": pool.var(1), "k": pool.par(0)}[expression]
    op, *parts = expression
    return pool.intern((op, *[_node(pool, p) for p in parts]))


@given(_expressions())
def test_python_reads_the_same_value_back(expression: Any) -> None:
    """The judge is Python's own parser, on nodes made without the pool's simplifications."""
    pool = Pool()
    pool.new_variables(2)
    node = _node(pool, expression)
    leaves = {"var": lambda k: VALUES["xy"[k]], "par": lambda _: VALUES["k"]}
    expected = values(pool, [node], leaves)[node]
    try:
        found = eval(text(pool, node, 10**6), FUNCTIONS | VALUES)
    except (ZeroDivisionError, OverflowError, TypeError):
        return  # where the pool has inf or nan, Python raises, or turns complex: (-3)**0.5
    if isinstance(found, complex) or not math.isfinite(expected):
        return
    assert found == pytest.approx(expected, rel=1e-9)


def test_a_shared_expression_does_not_explode(pool: Pool) -> None:
    """Sixty doublings would be 2**60 terms written out."""
    node = pool.var(0)
    for _ in range(60):
        node = pool.intern(("mul", pool.intern(("add", node, pool.var(1))), node))
    shown = text(pool, node, limit=200)
    assert len(shown) < 300
    assert shown.endswith(" ...")


def test_depth_needs_no_recursion(pool: Pool) -> None:
    node = pool.var(0)
    for _ in range(20_000):
        node = pool.make("sin", node)
    assert text(pool, node, limit=50).startswith("sin(sin(sin(")
