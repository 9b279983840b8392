"""The pool: equal expressions are one number, simplifications change no value."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable

import pytest

from acausal.flatten.pool import Pool
from acausal.numeric.evaluate import values

X, Y = 1.7, -0.6  # generic: no two of the expressions below coincide by accident


def _fresh() -> tuple[Pool, int, int, int]:
    pool = Pool()
    first = pool.new_variables(2)
    return pool, pool.var(first), pool.var(first + 1), pool.par(0)


def _value(pool: Pool, node: int) -> float:
    leaves = {"var": lambda k: (X, Y)[k], "par": lambda k: 0.8, "time": lambda _: 0.3}
    return float(values(pool, [node], leaves)[node])


Build = Callable[[Pool, int, int], tuple[int, int]]


@pytest.mark.parametrize(
    "build",
    [
        pytest.param(lambda p, x, y: (p.add(x, y), p.add(y, x)), id="x+y = y+x"),
        pytest.param(lambda p, x, y: (p.mul(x, y), p.mul(y, x)), id="xy = yx"),
        pytest.param(lambda p, x, y: (p.sub(x, p.neg(y)), p.add(x, y)), id="x-(-y) = x+y"),
        pytest.param(lambda p, x, y: (p.add(x, p.neg(y)), p.sub(x, y)), id="x+(-y) = x-y"),
        pytest.param(lambda p, x, y: (p.neg(p.neg(x)), x), id="-(-x) = x"),
        pytest.param(lambda p, x, y: (p.neg(p.sub(x, y)), p.sub(y, x)), id="-(x-y) = y-x"),
        pytest.param(lambda p, x, y: (p.mul(p.neg(x), p.neg(y)), p.mul(x, y)), id="(-x)(-y) = xy"),
        pytest.param(lambda p, x, y: (p.mul(p.const(-1.0), x), p.neg(x)), id="-1 x = -x"),
        pytest.param(lambda p, x, y: (p.div(x, p.const(-1.0)), p.neg(x)), id="x/(-1) = -x"),
        pytest.param(lambda p, x, y: (p.sub(x, x), p.zero), id="x-x = 0"),
        pytest.param(lambda p, x, y: (p.add(x, p.zero), x), id="x+0 = x"),
        pytest.param(lambda p, x, y: (p.sub(p.zero, x), p.neg(x)), id="0-x = -x"),
        pytest.param(lambda p, x, y: (p.mul(x, p.zero), p.zero), id="0 x = 0"),
        pytest.param(lambda p, x, y: (p.mul(p.one, x), x), id="1 x = x"),
        pytest.param(lambda p, x, y: (p.div(x, p.one), x), id="x/1 = x"),
        pytest.param(lambda p, x, y: (p.make("pow", x, p.one), x), id="x^1 = x"),
        pytest.param(lambda p, x, y: (p.make("pow", x, p.zero), p.one), id="x^0 = 1"),
        pytest.param(lambda p, x, y: (p.where(p.one, x, y), x), id="where(true)"),
        pytest.param(lambda p, x, y: (p.where(p.zero, x, y), y), id="where(false)"),
        pytest.param(lambda p, x, y: (p.where(p.make("lt", x, y), x, x), x), id="where(c, x, x) = x"),
        pytest.param(lambda p, x, y: (p.const(-0.0), p.zero), id="-0 = 0"),
        pytest.param(lambda p, x, y: (p.sum([x, y, p.neg(x)]), p.sub(p.add(x, y), x)), id="sum"),
    ],
)
def test_equal_expressions_are_one_number(build: Build) -> None:
    pool, x, y, _ = _fresh()
    found, expected = build(pool, x, y)
    assert found == expected


@pytest.mark.parametrize(
    ("op", "args", "expected"),
    [
        ("add", (2.0, 3.0), 5.0),
        ("sub", (2.0, 3.0), -1.0),
        ("mul", (2.0, -3.0), -6.0),
        ("div", (1.0, -4.0), -0.25),
        ("neg", (2.0,), -2.0),
        ("pow", (2.0, -2.0), 0.25),
        ("min", (2.0, -1.0), -1.0),
        ("max", (2.0, -1.0), 2.0),
        ("atan2", (1.0, -1.0), 0.75 * math.pi),
        ("sign", (-3.0,), -1.0),
        ("floor", (-1.5,), -2.0),
        ("ceil", (-1.5,), -1.0),
        ("fabs", (-1.5,), 1.5),
        ("lt", (1.0, 2.0), 1.0),
        ("ge", (1.0, 2.0), 0.0),
        ("le", (2.0, 2.0), 1.0),
        ("gt", (2.0, 2.0), 0.0),
        ("and", (1.0, 0.0), 0.0),
        ("or", (1.0, 0.0), 1.0),
        ("not", (1.0,), 0.0),
        ("where", (1.0, 5.0, 6.0), 5.0),
    ],
)
def test_constants_are_folded(op: str, args: tuple[float, ...], expected: float) -> None:
    pool = Pool()
    assert pool.value(pool.make(op, *map(pool.const, args))) == expected


@pytest.mark.parametrize(
    ("op", "args"),
    [("log", (-1.0,)), ("sqrt", (-1.0,)), ("asin", (2.0,)), ("div", (1.0, 0.0)), ("pow", (0.0, -1.0)), ("exp", (1e4,))],
)
def test_what_has_no_value_is_left_for_the_run(op: str, args: tuple[float, ...]) -> None:
    """Folding must not raise: the message of the start names the equation."""
    pool = Pool()
    node = pool.make(op, *map(pool.const, args))
    assert pool.value(node) is None or not math.isfinite(pool.value(node) or 0.0)


def test_division_by_a_variable_is_not_cancelled() -> None:
    """0/x is not 0 and x/x is not 1 where x = 0; a parameter in the denominator is no 0 of the model's."""
    pool, x, _, k = _fresh()
    assert pool.div(pool.zero, x) != pool.zero
    assert pool.div(x, x) != pool.one
    assert pool.div(pool.zero, k) == pool.zero


def test_every_variable_has_one_derivative() -> None:
    pool = Pool()
    x = pool.new_variables(1)
    dx = pool.derivative(x)
    assert pool.derivative(x) == dx
    assert pool.integral_of[dx] == x
    assert pool.derivative(dx) not in (x, dx)


def test_reachable_is_an_evaluation_order() -> None:
    pool, x, y, k = _fresh()
    root = pool.add(pool.mul(k, x), pool.make("sin", pool.sub(x, y)))
    order = pool.reachable([root])
    place = {n: i for i, n in enumerate(order)}
    for number in order:
        node = pool.nodes[number]
        if node[0] not in ("var", "par", "const", "time"):
            assert all(place[c] < place[number] for c in node[1:])
    assert pool.variables_in(root) == {0, 1}
    assert _value(pool, root) == pytest.approx(0.8 * X + math.sin(X - Y), abs=1e-15)


def test_rewrite_substitutes_and_simplifies() -> None:
    """x := 0 in k x + y leaves y; nothing of the old pool changes."""
    pool, x, y, k = _fresh()
    root = pool.add(pool.mul(k, x), y)
    done: dict[int, int] = {}
    pool.rewrite([root], lambda v: pool.zero if v == 0 else pool.var(v), done)
    assert done[root] == y
    assert _value(pool, root) == pytest.approx(0.8 * X + Y, abs=1e-15)


def test_deep_expressions_need_no_recursion() -> None:
    pool, x, y, _ = _fresh()
    total = x
    for k in range(20_000):
        total = pool.add(pool.mul(total, pool.const(0.5)), pool.mul(y, pool.const(float(k % 3))))
    done: dict[int, int] = {}
    pool.rewrite([total], pool.var, done)
    assert done[total] == total
    assert len(pool.reachable([total])) > 20_000


@pytest.mark.parametrize(
    ("build", "expected"),
    [
        pytest.param(lambda p, x, y: p.sub(p.sub(x, y), x), lambda p, x, y: p.neg(y), id="(x-y)-x"),
        pytest.param(lambda p, x, y: p.add(p.neg(p.add(x, y)), x), lambda p, x, y: p.neg(y), id="-(x+y)+x"),
        pytest.param(lambda p, x, y: p.sub(p.add(x, y), p.add(y, x)), lambda p, x, y: p.zero, id="(x+y)-(y+x)"),
        pytest.param(
            lambda p, x, y: p.sub(p.mul(p.const(3.0), p.sub(x, y)), p.mul(x, p.const(3.0))),
            lambda p, x, y: p.mul(p.const(-3.0), y),
            id="3(x-y)-3x",
        ),
        pytest.param(lambda p, x, y: p.sub(p.add(p.mul(x, y), y), p.mul(y, x)), lambda p, x, y: y, id="(xy+y)-yx"),
        pytest.param(lambda p, x, y: p.add(x, x), lambda p, x, y: p.mul(p.const(2.0), x), id="x+x"),
    ],
)
def test_equal_terms_are_collected(build: Callable[..., int], expected: Callable[..., int]) -> None:
    pool, x, y, _ = _fresh()
    assert pool.collected(build(pool, x, y)) == expected(pool, x, y)


def test_collecting_leaves_other_sums_alone_and_copes_with_shared_ones() -> None:
    """2^60 x as sixty doublings: each shared sum is looked at once."""
    pool, x, y, k = _fresh()
    root = pool.sub(pool.mul(k, x), pool.add(y, pool.make("sin", x)))
    assert pool.collected(root) == root
    total = x
    for _ in range(60):
        total = pool.add(total, total)
    assert pool.collected(total) == pool.mul(pool.const(2.0**60), x)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_a_variable_has_one_node_in_a_pool_of_any_history(order: tuple[int, ...]) -> None:
    """Also in one whose table was dropped, in its pickled copy, and for the negative indices of stand-ins."""
    pool = Pool()
    pool.new_variables(3)
    wanted = {v: pool.var(v) for v in (order[0], -1)}
    pool.retire()
    for held in (pool, pickle.loads(pickle.dumps(pool))):
        for v in (*order, -1, -2, *order):
            node = held.var(v)
            assert held.nodes[node] == ("var", v)
            assert node == wanted.setdefault(v, node)
        assert len(held.nodes) == len(set(held.nodes))
