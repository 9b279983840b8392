"""Random systems of the equations that alias elimination is about, against dense linear algebra.

v_i == +-v_j, v_i == constant, der(v_i) == +-v_j and small sums, as many equations as variables. Where the pencil of the
system is regular the model must agree with its closed form; everything else must be refused with a code.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import event, example, given, settings
from hypothesis import strategies as st

import acausal
from acausal import AcausalError, Component, Equations, Expr, Real, der, guess, structural, variable
from tests.simulate.linear_oracle import Descriptor

N = 6
STOP = 0.5


class Row(NamedTuple):
    """`kind` v_i == a v_j + b v_k, or == number; kind "der" has the derivative of v_i on its left."""

    kind: str
    i: int
    j: int = 0
    a: float = 1.0
    k: int = 0
    b: float = 0.0


class Network(Component):
    rows: tuple[Row, ...] = structural()
    v: Real = variable(shape=N, default=guess(1.0))

    def equations(self) -> Equations:
        for row in self.rows:
            left = der(self.v[row.i]) if row.kind == "der" else self.v[row.i]
            right: Expr | float = row.a
            if row.kind != "number":
                right = self.v[row.j] if row.a == 1.0 else row.a * self.v[row.j]
                right = right + row.b * self.v[row.k] if row.b else right
            yield left == right
        for i in range(len(self.rows), N):
            yield self.v[i] == float(i)


PLACE = st.integers(0, N - 1)
FACTOR = st.sampled_from([1.0, 1.0, -1.0, -1.0, 2.0])
NUMBERS = st.sampled_from([0.0, 1.0, -2.0])
ROWS = st.one_of(
    st.tuples(st.just("alias"), PLACE, PLACE, FACTOR),
    st.tuples(st.just("alias"), PLACE, PLACE, FACTOR, PLACE, st.sampled_from([1.0, -1.0])),
    st.tuples(st.just("der"), PLACE, PLACE, FACTOR),
    st.tuples(st.just("der"), PLACE, PLACE, FACTOR),
    st.tuples(st.just("number"), PLACE, st.just(0), NUMBERS),
).map(lambda fields: Row(*fields))


@st.composite
def systems(draw: st.DrawFn) -> tuple[Row, ...]:
    """One row for every variable in most cases, so that most have a solution."""
    rows = draw(st.lists(ROWS, min_size=1, max_size=N))
    lefts = draw(st.permutations(range(N)))
    spread = draw(st.integers(0, 3)) > 0
    return tuple(row._replace(i=left) if spread else row for row, left in zip(rows, lefts, strict=False))


def oracle(rows: tuple[Row, ...]) -> Descriptor:
    E, A, b = np.zeros((N, N)), np.zeros((N, N)), np.zeros(N)
    for r in range(N):
        row = rows[r] if r < len(rows) else Row("number", r, 0, float(r))
        if row.kind == "der":
            E[r, row.i] = 1.0
        else:
            A[r, row.i] -= 1.0
        if row.kind == "number":
            b[r] = row.a
        else:
            A[r, row.j] += row.a
            A[r, row.k] += row.b
    return Descriptor(E, A, b)


def compare(rows: tuple[Row, ...]) -> None:
    dense = oracle(rows)
    is_regular = dense.is_regular()
    event(f"regular: {is_regular}")
    if not is_regular:
        with pytest.raises(AcausalError, match=r"AC[23]\d\d"):
            acausal.simulate(Network(rows=rows), stop_time=STOP)
        return
    result = acausal.simulate(Network(rows=rows), stop_time=STOP, tolerance=1e-10, output_interval=STOP / 4)
    v = result["v"]
    expected = dense.solve(dense.E @ v[0], STOP)
    np.testing.assert_allclose(v[-1], expected, rtol=0, atol=1e-7 * (1 + np.max(np.abs(expected))))


INDEX_FOUR = (
    Row("der", 5, 3, -1.0),
    Row("der", 3, 1, -1.0),
    Row("der", 2, 4, -1.0),
    Row("alias", 1, 2, -1.0),
    Row("alias", 0, 4, -1.0, 2, -1.0),
)


@given(systems())
@example((Row("alias", 0, 1), Row("alias", 1, 0)))
@example((Row("alias", 0, 1), Row("alias", 1, 0, -1.0)))
@example((Row("der", 0, 1), Row("der", 0, 0)))  # v = x', x' = x: once ran for ever
@example((Row("der", 0, 1), Row("der", 1, 2), Row("der", 1, 0)))
@example((Row("der", 0, 2), Row("der", 1, 3), Row("der", 0, 3), Row("der", 2, 0, -1.0)))  # two integrals of one speed
@example((Row("der", 0, 1), Row("number", 0, 0, 3.0)))
@example((Row("der", 0, 1, -1.0), Row("der", 1, 0)))
@example(INDEX_FOUR)
def test_small_systems(rows: tuple[Row, ...]) -> None:
    compare(rows)


@pytest.mark.slow
@settings(max_examples=1500)
@given(systems())
def test_many_small_systems(rows: tuple[Row, ...]) -> None:
    compare(rows)
