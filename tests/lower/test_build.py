"""Lowering to CasADi: columns and single operations give what the pool says, evaluated by NumPy."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from acausal.flatten.pool import Pool
from acausal.lower.build import Builder
from acausal.numeric.evaluate import values

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
