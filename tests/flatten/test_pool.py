"""The pool: equal expressions are one number, simplifications change no value, long sums stay cheap."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from acausal.analyse.blocks.linear import LinearForm, linear_in
from acausal.flatten.pool import Pool
from acausal.flatten.terms import is_long, terms
from acausal.numeric.evaluate import gradients, values

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


class CountingPool(Pool):
    """A pool that counts the additions it is asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.asked = 0

    def add(self, a: int, b: int) -> int:
        self.asked += 1
        return super().add(a, b)

    def sub(self, a: int, b: int) -> int:
        self.asked += 1
        return super().sub(a, b)


def chain(pool: Pool, n: int) -> int:
    """x0 + 2 x1 - x2 + 2 x3 ... over n variables."""
    first = pool.new_variables(n)
    total = pool.zero
    for k in range(n):
        x = pool.var(first + k)
        if k % 2:
            x = pool.mul(pool.const(2.0), x)
        total = pool.sub(total, x) if k % 3 == 2 else pool.add(total, x)
    return total


def leaves(x: Any) -> dict[str, Callable[[int], Any]]:
    return {"var": lambda k: x[k], "par": lambda k: 0.0, "time": lambda _: 0.0}


def test_terms_with_their_signs() -> None:
    pool = Pool()
    a, b, c = (pool.var(pool.new_variables(1)) for _ in range(3))
    root = pool.sub(pool.add(a, pool.sub(b, c)), pool.neg(pool.add(a, c)))
    assert dict(terms(pool, root)) == {a: 2, b: 1}


def test_doubling_does_not_take_all_paths() -> None:
    """y = x + x, z = y + y, ...: 2^60 paths lead to the one term."""
    pool = Pool()
    x = root = pool.var(pool.new_variables(1))
    for _ in range(60):
        root = pool.make("add", root, root)
    assert terms(pool, root) == [(x, 2**60)]


def test_only_chains_are_long() -> None:
    pool = Pool()
    assert is_long(pool, chain(pool, 40))
    assert not is_long(pool, chain(pool, 12))


@pytest.mark.parametrize("n", [500, 2000])
def test_taking_a_sum_apart_asks_for_a_few_additions_a_term(n: int) -> None:
    """It was half a million for 1000 terms: every partial sum had its own table of coefficients."""
    pool = CountingPool()
    root = chain(pool, n)
    pool.asked = 0
    form = LinearForm(pool, range(n)).of(root)
    assert form is not None
    assert len(form[1]) == n
    assert pool.asked <= 4 * n


@pytest.mark.parametrize("n", [500, 2000])
def test_a_gradient_of_a_sum_adds_every_term_once(n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    import acausal.numeric.evaluate as evaluate

    pool = Pool()
    root = chain(pool, n)
    sizes = []
    combine = evaluate._combine

    def counted(parts: Any) -> Any:
        found = combine(parts)
        sizes.append(len(found))
        return found

    monkeypatch.setattr(evaluate, "_combine", counted)
    (slope,) = gradients(pool, [root], range(n), leaves(np.ones(n)))
    assert slope == {k: (2.0 if k % 2 else 1.0) * (-1.0 if k % 3 == 2 else 1.0) for k in range(n)}
    assert sum(sizes) <= 2 * n


Item = st.tuples(st.sampled_from(["add", "sub", "neg", "mul"]), st.integers(0, 30), st.integers(0, 30))


@given(st.lists(Item, min_size=30, max_size=90))
def test_coefficients_reproduce_the_value(items: list[tuple[str, int, int]]) -> None:
    """Any graph of sums over four variables: rest + coefficients * variables is the value itself."""
    pool = Pool()
    found = [pool.var(pool.new_variables(1)) for _ in range(4)]
    found += [pool.par(0), pool.const(3.0)]
    for op, i, j in items:
        a, b = found[-1 - i % len(found)], found[-1 - j % len(found)]
        found.append({"add": pool.add, "sub": pool.sub}[op](a, b) if op in ("add", "sub") else pool.neg(a))
    for k in range(len(found)):
        found[k] = pool.add(found[k], found[k - 1]) if k else found[k]
    x = [0.5, -1.25, 2.0, 0.75]
    root = found[-1]
    form = LinearForm(pool, range(4)).of(root)
    assert form is not None
    rest, coefficients = form
    at = leaves(x) | {"par": lambda k: 1.5}
    known = values(pool, [root, rest, *coefficients.values()], at)
    total = known[rest] + (sum(known[c] * x[v] for v, c in coefficients.items()) if coefficients else 0.0)
    scale = 1.0 + abs(float(known[root])) + abs(float(known[rest]))
    scale += sum(abs(float(known[c])) for c in coefficients.values())
    assert abs(float(total) - float(known[root])) <= 1e-9 * scale


Step = st.tuples(st.sampled_from(["add", "sub", "mul", "div", "neg"]), st.integers(0, 30), st.integers(0, 30))


@given(st.lists(Step, min_size=1, max_size=8), st.integers(0, 2))
@example([("mul", 4, 4), ("add", 0, 2)], 0)  # x*x + p
@example([("mul", 4, 4), ("sub", 5, 0)], 0)  # x - x*x
@example([("mul", 4, 2), ("sub", 2, 0)], 0)  # p - x*p
def test_a_form_in_one_variable_reproduces_the_value(steps: list[tuple[str, int, int]], variable: int) -> None:
    """Any expression that is taken for a linear one equals rest + factor * variable, at two values of the variable."""
    pool = Pool()
    found = [*(pool.var(pool.new_variables(1)) for _ in range(3)), pool.par(0), pool.const(3.0)]
    for op, i, j in steps:
        operands = [found[-1 - i % len(found)], found[-1 - j % len(found)]]
        found.append(pool.make(op, *operands[: 1 if op == "neg" else 2]))
    form = linear_in(pool, found[-1], variable)
    if form is None:
        return
    rest, factor = form[0], form[1].get(variable, pool.zero)
    assert variable not in pool.variables_in(rest, factor)
    for x in (0.75, -2.5):
        at = leaves([x if k == variable else 1.25 - k for k in range(3)]) | {"par": lambda k: 1.5}
        whole, a, b = (float(values(pool, [n], at)[n]) for n in (found[-1], rest, factor))
        if np.isfinite([whole, a, b]).all():
            assert abs(a + b * x - whole) <= 1e-9 * (1.0 + abs(a) + abs(b * x))
