"""Vector and matrix expressions of the language, entry by entry, against numpy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from acausal import Component, Real, cross, der, dot, identity, norm, skew, time, variable, where, zeros
from acausal.flatten.flat import suffix, suffixes
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.scalarise import Scalars, scalars
from acausal.language.expressions.expression import Expr, Symbol, as_expr
from acausal.numeric.evaluate import values

Array = NDArray[np.float64]


class Body(Component):
    """Something of every shape."""

    a: Real = variable(shape=3)
    b: Real = variable(shape=3)
    R: Real = variable(shape=(3, 3))
    S: Real = variable(shape=(2, 3))
    k: Real = variable()


BODY = Body()
_RANDOM = np.random.default_rng(7)
NUMBERS: dict[str, Array] = {
    "a": _RANDOM.standard_normal(3),
    "b": _RANDOM.standard_normal(3),
    "R": _RANDOM.standard_normal((3, 3)),
    "S": _RANDOM.standard_normal((2, 3)),
    "k": _RANDOM.standard_normal(()),
}


def evaluate(e: Expr) -> Array:
    """Value of an expression of BODY with the numbers above; derivatives of variable i are 10 + i."""
    pool = Pool()
    first: dict[str, int] = {}
    flat: list[float] = []
    for name, number in NUMBERS.items():
        first[name] = pool.new_variables(number.size)
        flat += number.ravel().tolist()

    def resolve(symbol: Symbol) -> Scalars:
        return tuple(pool.var(first[symbol.name] + k) for k in range(NUMBERS[symbol.name].size))

    nodes = scalars(pool, e, resolve, {})

    def variable_(k: int) -> float:
        return flat[k] if k < len(flat) else 10.0 + pool.integral_of[k]

    found = values(pool, nodes, {"var": variable_, "par": float, "time": lambda _: 0.25})
    return np.array([found[n] for n in nodes], dtype=float).reshape(e.shape)


a, b, R, S, k = (NUMBERS[n] for n in ("a", "b", "R", "S", "k"))
B = BODY


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        pytest.param(lambda: B.a + B.b, a + b, id="a+b"),
        pytest.param(lambda: B.a - B.b, a - b, id="a-b"),
        pytest.param(lambda: -B.a, -a, id="-a"),
        pytest.param(lambda: B.k * B.a, k * a, id="ka"),
        pytest.param(lambda: B.R * B.k, k * R, id="Rk"),
        pytest.param(lambda: B.R / B.k, R / k, id="R/k"),
        pytest.param(lambda: 2 / B.k, 2 / k, id="2/k"),
        pytest.param(lambda: B.a + 1, a + 1, id="a+1"),
        pytest.param(lambda: 1 - B.R, 1 - R, id="1-R"),
        pytest.param(lambda: B.R @ B.a, R @ a, id="Ra"),
        pytest.param(lambda: B.a @ B.R, a @ R, id="aR"),
        pytest.param(lambda: B.R @ B.R, R @ R, id="RR"),
        pytest.param(lambda: B.S @ B.R, S @ R, id="SR"),
        pytest.param(lambda: B.S @ B.a, S @ a, id="Sa"),
        pytest.param(lambda: B.S @ B.S.T, S @ S.T, id="S S'"),
        pytest.param(lambda: B.S.T @ B.S, S.T @ S, id="S' S"),
        pytest.param(lambda: B.a @ B.b, a @ b, id="a@b"),
        pytest.param(lambda: dot(B.a, B.b), a @ b, id="dot"),
        pytest.param(lambda: cross(B.a, B.b), np.cross(a, b), id="cross"),
        pytest.param(lambda: norm(B.a), np.linalg.norm(a), id="norm"),
        pytest.param(lambda: skew(B.a) @ B.b, np.cross(a, b), id="skew"),
        pytest.param(lambda: identity(3) @ B.a, a, id="identity"),
        pytest.param(lambda: zeros(2, 3) + B.S, S, id="zeros"),
        pytest.param(lambda: B.R.T, R.T, id="R'"),
        pytest.param(lambda: B.R[1, 2], R[1, 2], id="R[1,2]"),
        pytest.param(lambda: B.S[-1, -2], S[-1, -2], id="S[-1,-2]"),
        pytest.param(lambda: B.a[-1], a[-1], id="a[-1]"),
        pytest.param(lambda: as_expr((B.a, B.b)), np.stack([a, b]), id="rows"),
        pytest.param(lambda: as_expr((B.k, 2.0, B.a[0])), np.array([k, 2.0, a[0]]), id="stacked"),
        pytest.param(lambda: as_expr(((1.0, 0.0, 0.0), B.a)) @ B.b, np.array([b[0], a @ b]), id="mixed rows"),
        pytest.param(lambda: B.a @ np.eye(3).tolist(), a, id="list right"),
        pytest.param(lambda: np.diag([1.0, 2.0, 3.0]) @ B.a, np.array([1.0, 2.0, 3.0]) * a, id="numpy left"),
        pytest.param(lambda: np.array([1.0, 2.0, 3.0]) + B.a, np.array([1.0, 2.0, 3.0]) + a, id="numpy sum"),
        pytest.param(lambda: np.float64(2.0) * B.a, 2 * a, id="numpy number"),
        pytest.param(lambda: where(B.k > 10, B.a, B.b), b, id="where vector"),
        pytest.param(lambda: where(B.k < 10, B.R, 0.0), R, id="where literal"),
        pytest.param(lambda: time * B.a, 0.25 * a, id="time"),
        pytest.param(lambda: sum(B.a), a.sum(), id="sum"),
        pytest.param(lambda: abs(B.k), abs(k), id="abs"),
        pytest.param(lambda: +B.a, a, id="+a"),
    ],
)
def test_against_numpy(make: Callable[[], Any], expected: Array) -> None:
    e = as_expr(make())
    assert e.shape == np.shape(expected)
    np.testing.assert_allclose(evaluate(e), expected, rtol=1e-14, atol=1e-15)


def test_derivative_of_a_product_of_matrices() -> None:
    """(R a)' = R' a + R a'; the derivative of variable number i is 10 + i here."""
    place = {"a": np.arange(3.0), "b": np.arange(3.0) + 3, "R": (np.arange(9.0) + 6).reshape(3, 3)}
    expected = (10 + place["R"]) @ a + R @ (10 + place["a"])
    np.testing.assert_allclose(evaluate(der(B.R @ B.a)), expected, rtol=1e-14)
    np.testing.assert_allclose(
        evaluate(der(cross(B.a, B.b))), np.cross(10 + place["a"], b) + np.cross(a, 10 + place["b"]), rtol=1e-14
    )


def test_equal_entries_are_one_node() -> None:
    """Both sides of R R' = (R R')' are the same six numbers off and on the diagonal."""
    pool = Pool()
    first = pool.new_variables(9)
    nodes = scalars(pool, B.R @ B.R.T, lambda s: tuple(pool.var(first + i) for i in range(9)), {})
    assert nodes[1] == nodes[3]
    assert nodes[2] == nodes[6]
    assert len(set(nodes)) == 6


def test_the_index_of_an_entry_is_that_of_its_place_in_the_list() -> None:
    """Row-major, as NumPy counts; a scalar has none."""
    for shape in ((), (3,), (2, 3), (12,), (2, 3, 4)):
        found = suffixes(shape)
        assert found == ["[" + ",".join(map(str, k)) + "]" if shape else "" for k in np.ndindex(*shape)]
        assert [suffix(shape, place) for place in range(len(found))] == found
