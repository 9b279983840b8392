"""Random expressions: written in the language, simplified in the pool, lowered to CasADi, they keep their value."""

from __future__ import annotations

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
from acausal.language.expressions.expression import Expr
from acausal.lower.build import Builder
from acausal.numeric.evaluate import gradients, values

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


NAMES = Names()
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
        return getattr(NAMES, inner[0])
    if kind == "number":
        return inner[0]
    operands = [written(t) for t in inner]
    if not any(isinstance(o, Expr) for o in operands):
        operands[0] = acausal.as_expr(operands[0])
    return (ONE if len(inner) == 1 else TWO)[kind][0](*operands)


def judged(tree: Tree) -> Any:
    """The same by numpy at all points."""
    kind, *inner = tree
    if kind == "leaf":
        return POINTS["xyz".index(inner[0])]
    if kind == "number":
        return np.full(POINTS.shape[1], inner[0])
    return (ONE if len(inner) == 1 else TWO)[kind][1](*[judged(t) for t in inner])


def pooled(*trees: Tree) -> tuple[Pool, list[int]]:
    pool = Pool()
    pool.new_variables(3)
    expressions = [acausal.as_expr(written(tree)) for tree in trees]
    done: dict[int, Scalars] = {}
    return pool, [scalars(pool, e, lambda s: (pool.var("xyz".index(s.name)),), done)[0] for e in expressions]


def lowered(pool: Pool, nodes: list[int], count: int) -> Any:
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
    expected = np.broadcast_to(judged(tree), POINTS.shape[1])
    pool, (node,) = pooled(tree)
    here = values(pool, [node], {"var": POINTS.__getitem__})[node]
    np.testing.assert_allclose(np.broadcast_to(here, expected.shape), expected, rtol=1e-12, atol=1e-12)
    found = np.array(lowered(pool, [node], 3)(POINTS)).ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    collected = pool.collected(node)
    again = values(pool, [collected], {"var": POINTS.__getitem__})[collected]
    np.testing.assert_allclose(np.broadcast_to(again, expected.shape), expected, rtol=1e-11, atol=1e-11)


@given(st.lists(TREES, min_size=2, max_size=5), st.sampled_from(sorted(TWO)))
def test_many_at_once(trees: list[Tree], name: str) -> None:
    """Equal operations of one level are lowered as a column: every tree combined with every other is one of those."""
    pairs: list[Tree] = [(name, a, b) for a in trees for b in trees]
    pool, nodes = pooled(*pairs)
    found = np.array(lowered(pool, nodes, 3)(POINTS[:, 2])).ravel()
    expected = [np.broadcast_to(judged(tree), POINTS.shape[1])[2] for tree in pairs]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@given(TREES)
def test_slopes(tree: Tree) -> None:
    """Sampled gradients and symbolic time derivatives against CasADi's derivatives of the lowered expression."""
    pool, (node,) = pooled(tree)
    f = lowered(pool, [node], 3)
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
    found = np.array(lowered(pool, [node], 3)(POINTS)).ravel()
    np.testing.assert_allclose(found, judged(tree), rtol=1e-13, atol=1e-13)
