"""Long sums: their terms, and that nothing is done for every partial sum."""

from __future__ import annotations

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
