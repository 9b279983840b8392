"""Pool expressions as text and as CasADi: both give the value of the expression, whatever it is."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import acausal
from acausal import Component, Real, minimum, variable, where
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.differentiate import differentiate
from acausal.flatten.scalars.scalarise import Scalars, scalars
from acausal.flatten.text import to_text
from acausal.language.expressions.expression import Expr
from acausal.lower.build import Builder
from acausal.numeric.evaluate import gradients, values

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


N = 9
"""Enough equal operations on a level for a column."""


def lowered(pool: Pool, roots: list[int], definitions: dict[int, int] | None = None) -> np.ndarray:
    """Values of the roots by a CasADi function, with variable k = 0.3 + 0.1*k, parameter k = k + 2 and time 0.7."""
    t, p, x = ca.SX.sym("t"), ca.SX.sym("p", 3), ca.SX.sym("x", N)
    builder = Builder(pool, t, p, {})
    builder.assign(range(N), x)
    builder.definitions.update(definitions or {})
    function = ca.Function("f", [t, x, p], [builder.column(roots), ca.vertcat(*builder.lower(roots))])
    column, single = function(0.7, 0.3 + 0.1 * np.arange(N), 2.0 + np.arange(3))
    np.testing.assert_array_equal(np.array(column), np.array(single))
    return np.array(column).ravel()


def judged(pool: Pool, roots: list[int]) -> list[float]:
    leaves = {"var": lambda k: 0.3 + 0.1 * k, "par": lambda k: 2.0 + k, "time": lambda _: 0.7}
    known = values(pool, roots, leaves)
    return [float(known[r]) for r in roots]


def pool_of(count: int) -> Pool:
    pool = Pool()
    pool.new_variables(count)
    return pool


@pytest.mark.parametrize("op", ["add", "sub", "mul", "div", "pow", "atan2", "min", "max", "lt", "ge"])
def test_two_operands(op: str) -> None:
    pool = pool_of(N)
    roots = [pool.make(op, pool.var(k), pool.make("sin", pool.par(k % 3))) for k in range(N)]
    np.testing.assert_allclose(lowered(pool, roots), judged(pool, roots), rtol=1e-15)


@pytest.mark.parametrize("op", ["neg", "sin", "cos", "exp", "sqrt", "fabs", "sign", "floor", "tanh"])
def test_one_operand(op: str) -> None:
    pool = pool_of(N)
    roots = [pool.make(op, pool.sub(pool.var(k), pool.const(0.01 * k))) for k in range(N)]
    np.testing.assert_allclose(lowered(pool, roots), judged(pool, roots), rtol=1e-15)


@pytest.mark.parametrize("op", ["and", "or", "not"])
def test_logic_of_relations(op: str) -> None:
    pool = pool_of(N)
    above = [pool.make("gt", pool.var(k), pool.const(0.1 * (k % 7))) for k in range(N)]
    below = [pool.make("lt", pool.var(k), pool.const(0.2 * (k % 5))) for k in range(N)]
    operands = zip(above, strict=True) if op == "not" else zip(above, below, strict=True)
    roots = [pool.make(op, *pair) for pair in operands]
    np.testing.assert_array_equal(lowered(pool, roots), judged(pool, roots))


def test_a_boolean_variable_is_true_from_one_half_on() -> None:
    """Integrators leave 1e-20 where a boolean that they carry was zero: it must not have become true."""
    pool = pool_of(2)
    off, on = pool.var(0), pool.var(1)
    roots = [pool.where(b, pool.const(5.0), pool.const(7.0)) for b in (off, on)]
    roots += [pool.make("not", off), pool.make("and", on, on), pool.make("or", off, off)]
    builder = Builder(pool, ca.SX(0), ca.SX(0, 1), {})
    x = ca.SX.sym("x", 2)
    builder.assign(range(2), x)
    found = ca.Function("f", [x], [ca.vertcat(*builder.lower(roots))])([1e-20, 1 - 1e-12])
    assert np.array(found).ravel().tolist() == [7.0, 5.0, 1.0, 1.0, 0.0]


def test_levels_branches_time_and_few_of_a_kind() -> None:
    pool = pool_of(N)
    chain, roots = pool.time, []
    for k in range(N):
        square = pool.mul(pool.var(k), pool.var(k))
        chain = pool.add(pool.mul(chain, square), pool.const(0.5))  # one per level
        roots += [chain, pool.where(pool.make("gt", pool.var(k), pool.const(0.6)), square, chain)]
    np.testing.assert_allclose(lowered(pool, roots), judged(pool, roots), rtol=1e-14)


def test_defined_variables_stand_for_their_nodes() -> None:
    pool = pool_of(N + 2)
    first = pool.add(pool.var(0), pool.var(1))
    second = pool.mul(pool.var(N), pool.const(3.0))
    found = lowered(pool, [pool.var(N + 1), pool.neg(pool.var(N))], {N: first, N + 1: second})
    np.testing.assert_allclose(found, [3.0 * 0.7, -0.7], rtol=1e-15)


def test_nothing_below_a_mode_is_asked_for() -> None:
    pool = pool_of(1)
    relation = pool.make("gt", pool.var(0), pool.zero)  # variable 0 is never made known
    builder = Builder(pool, ca.SX.sym("t"), ca.SX.sym("p", 0), {relation: ca.SX(1)})
    chosen = builder.lower([pool.where(relation, pool.const(2.0), pool.const(5.0))])[0]
    assert float(ca.DM(ca.Function("f", [], [chosen])()["o0"])) == 2.0


def test_unknown_variables_are_an_error_of_the_compiler() -> None:
    pool = pool_of(1)
    builder = Builder(pool, ca.SX.sym("t"), ca.SX.sym("p", 0), {})
    with pytest.raises(KeyError, match="variable 0"):
        builder.column([pool.var(0)])


Tree = tuple[Any, ...]

ONE: dict[str, tuple[Any, Any]] = {
    "neg": (lambda a: -a, np.negative),
    "sin": (acausal.sin, np.sin),
    "cos": (acausal.cos, np.cos),
    "tanh": (acausal.tanh, np.tanh),
    "atan": (acausal.atan, np.arctan),
    "exp": (lambda a: acausal.exp(acausal.sin(a)), lambda a: np.exp(np.sin(a))),
    "log": (lambda a: acausal.log(1.5 + a * a), lambda a: np.log(1.5 + a * a)),
    "sqrt": (lambda a: acausal.sqrt(0.5 + a * a), lambda a: np.sqrt(0.5 + a * a)),
    "fabs": (abs, np.abs),
    "square": (lambda a: a**2, np.square),
    "inverse": (lambda a: 1 / (2.0 + a * a), lambda a: 1 / (2.0 + a * a)),
    "one": (lambda a: a**1, lambda a: a),
    "zero": (lambda a: 0 * a, lambda a: 0 * a),
}
TWO: dict[str, tuple[Any, Any]] = {
    "add": (lambda a, b: a + b, np.add),
    "sub": (lambda a, b: a - b, np.subtract),
    "mul": (lambda a, b: a * b, np.multiply),
    "div": (lambda a, b: a / (1.5 + b * b), lambda a, b: a / (1.5 + b * b)),
    "min": (minimum, np.minimum),
    "max": (acausal.maximum, np.maximum),
    "atan2": (lambda a, b: acausal.atan2(a, 1.5 + b * b), lambda a, b: np.arctan2(a, 1.5 + b * b)),
    "pow": (lambda a, b: (1.1 + a * a) ** acausal.sin(b), lambda a, b: (1.1 + a * a) ** np.sin(b)),
    "where": (lambda a, b: where(a < b, a * b, a - b), lambda a, b: np.where(a < b, a * b, a - b)),
}


class Names(Component):
    x: Real = variable()
    y: Real = variable()
    z: Real = variable()


DRAWN_NAMES = Names()
POINTS = np.random.default_rng(11).uniform(-1.5, 1.5, (3, 7))

LEAVES = st.one_of(
    st.sampled_from("xyz").map(lambda name: ("leaf", name)),
    st.sampled_from([0.0, 1.0, -1.0, 0.5, 2.0]).map(lambda number: ("number", number)),
)
TREES: st.SearchStrategy[Tree] = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(sorted(ONE)), inner), st.tuples(st.sampled_from(sorted(TWO)), inner, inner)
    ),
    max_leaves=12,
)


def written(tree: Tree) -> Any:
    """The tree in the language; a number stays a Python number, as a modeller would write it."""
    kind, *inner = tree
    if kind == "leaf":
        return getattr(DRAWN_NAMES, inner[0])
    if kind == "number":
        return inner[0]
    operands = [written(t) for t in inner]
    if not any(isinstance(o, Expr) for o in operands):
        operands[0] = acausal.as_expr(operands[0])
    return (ONE if len(inner) == 1 else TWO)[kind][0](*operands)


def value_of(tree: Tree) -> Any:
    """The same by numpy at all points."""
    kind, *inner = tree
    if kind == "leaf":
        return POINTS["xyz".index(inner[0])]
    if kind == "number":
        return np.full(POINTS.shape[1], inner[0])
    return (ONE if len(inner) == 1 else TWO)[kind][1](*[value_of(t) for t in inner])


def pooled(*trees: Tree) -> tuple[Pool, list[int]]:
    pool = Pool()
    pool.new_variables(3)
    expressions = [acausal.as_expr(written(tree)) for tree in trees]
    done: dict[int, Scalars] = {}
    return pool, [scalars(pool, e, lambda s: (pool.var("xyz".index(s.name)),), done)[0] for e in expressions]


def function_of(pool: Pool, nodes: list[int], count: int) -> Any:
    """CasADi function of the first `count` variables."""
    x = ca.SX.sym("x", count)
    builder = Builder(pool, ca.SX(0), ca.SX(0, 1), {})
    builder.assign(range(count), x)
    return ca.Function("f", [x], [builder.column(nodes)])


@given(TREES)
@example(("sub", ("neg", ("leaf", "x")), ("neg", ("leaf", "y"))))
@example(("mul", ("number", -1.0), ("neg", ("sub", ("leaf", "x"), ("number", 0.0)))))
@example(("where", ("number", 1.0), ("number", 2.0)))
def test_value(tree: Tree) -> None:
    expected = np.broadcast_to(value_of(tree), POINTS.shape[1])
    pool, (node,) = pooled(tree)
    here = values(pool, [node], {"var": POINTS.__getitem__})[node]
    np.testing.assert_allclose(np.broadcast_to(here, expected.shape), expected, rtol=1e-12, atol=1e-12)
    found = np.array(function_of(pool, [node], 3)(POINTS)).ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    collected = pool.collected(node)
    again = values(pool, [collected], {"var": POINTS.__getitem__})[collected]
    np.testing.assert_allclose(np.broadcast_to(again, expected.shape), expected, rtol=1e-11, atol=1e-11)


@given(st.lists(TREES, min_size=2, max_size=5), st.sampled_from(sorted(TWO)))
def test_many_at_once(trees: list[Tree], name: str) -> None:
    """Equal operations of one level are lowered as a column: every tree combined with every other is one of those."""
    pairs: list[Tree] = [(name, a, b) for a in trees for b in trees]
    pool, nodes = pooled(*pairs)
    found = np.array(function_of(pool, nodes, 3)(POINTS[:, 2])).ravel()
    expected = [np.broadcast_to(value_of(tree), POINTS.shape[1])[2] for tree in pairs]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@given(TREES)
def test_slopes(tree: Tree) -> None:
    """Sampled gradients and symbolic time derivatives against CasADi's derivatives of the lowered expression."""
    pool, (node,) = pooled(tree)
    f = function_of(pool, [node], 3)
    x = ca.SX.sym("x", 3)
    jacobian = ca.Function("j", [x], [ca.densify(ca.jacobian(f(x), x))])
    expected = np.array([np.array(jacobian(p)).ravel() for p in POINTS.T])
    rows = gradients(pool, [node], range(3), {"var": POINTS.__getitem__})
    for k in range(3):
        sampled = np.broadcast_to(rows[0].get(k, 0.0), POINTS.shape[1])
        np.testing.assert_allclose(sampled, expected[:, k], rtol=1e-10, atol=1e-11)
    rates = np.array([0.3, -0.7, 1.1])
    derivative = differentiate(pool, node)
    place = {pool.derivative(k): rates[k] for k in range(3)}
    leaves = {"var": lambda v: place[v] if v in place else POINTS[v]}
    slope = np.broadcast_to(values(pool, [derivative], leaves)[derivative], POINTS.shape[1])
    np.testing.assert_allclose(slope, expected @ rates, rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("name", [*ONE, *TWO])
def test_every_operator_alone(name: str) -> None:
    """So that none is left to chance."""
    leaves = [("leaf", "x"), ("leaf", "y")]
    tree = (name, *leaves[: 1 if name in ONE else 2])
    pool, (node,) = pooled(tree)
    found = np.array(function_of(pool, [node], 3)(POINTS)).ravel()
    np.testing.assert_allclose(found, value_of(tree), rtol=1e-13, atol=1e-13)
