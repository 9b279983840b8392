"""Random algebraic and linear systems: solutions known by construction, or from dense linear algebra."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import assume, event, example, given, settings
from hypothesis import strategies as st

import acausal
from acausal import AcausalError, Component, Equations, Expr, Real, der, fixed, guess, parameter, structural, variable
from acausal.errors import StructureError
from tests.expected import fails_with
from tests.simulate.linear_oracle import Descriptor

N = 5
SMALL = st.integers(-3, 3).map(float)
Matrix = tuple[tuple[float, ...], ...]


class Linear(Component):
    """A v = b(x): constant factors or parameters, the right side moves with a state."""

    A: Matrix = structural()
    b: tuple[float, ...] = structural()
    as_parameters: bool = structural(default=False)
    P: Real = parameter(shape=(N, N), default=lambda self: self.A)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(shape=N)

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        for i in range(N):
            factors = [self.P[i, j] if self.as_parameters and a else a for j, a in enumerate(self.A[i])]
            terms = [f * self.v[j] for j, f in enumerate(factors) if isinstance(f, Expr) or f]
            yield sum(terms, acausal.as_expr(0.0)) == self.b[i] * self.x


MATRICES = st.lists(st.lists(st.one_of(st.just(0.0), SMALL), min_size=N, max_size=N), min_size=N, max_size=N)
VECTORS = st.lists(SMALL, min_size=N, max_size=N)


@given(MATRICES, VECTORS, st.booleans())
@example(np.eye(N).tolist(), [1.0] * N, False)
@example((np.ones((N, N)) - np.eye(N)).tolist(), [1.0, 2.0, 3.0, 4.0, 5.0], True)
@example(np.ones((N, N)).tolist(), [1.0] * N, False)
def test_linear_blocks(rows: list[list[float]], b: list[float], as_parameters: bool) -> None:
    """Against numpy.linalg.solve; a singular matrix is refused."""
    A = np.array(rows)
    model = Linear(A=tuple(map(tuple, rows)), b=tuple(b), as_parameters=as_parameters)
    if np.linalg.matrix_rank(A) < N:
        with pytest.raises(AcausalError, match=r"AC[23]\d\d"):
            acausal.simulate(model)
        return
    assume(np.linalg.cond(A) < 1e4)
    result = acausal.simulate(model, stop_time=1.0)
    for k in (0, -1):
        expected = np.linalg.solve(A, np.array(b) * result["x"][k])
        np.testing.assert_allclose(result["v"][k], expected, rtol=0, atol=1e-9 * (1 + np.max(np.abs(expected))))


FUNCTIONS: list[tuple[Any, Any]] = [
    (acausal.sin, np.sin),
    (acausal.tanh, np.tanh),
    (lambda v: v**3, lambda v: v**3),
    (lambda v: acausal.exp(0.3 * v), lambda v: np.exp(0.3 * v)),
]


class Nonlinear(Component):
    """v_i + 0.2 sum_j w_ij f(v_j) = c_i x, with c such that v is known for x = 1: strongly monotone, one solution."""

    w: Matrix = structural()
    f: tuple[int, ...] = structural()
    solution: tuple[float, ...] = structural()
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(shape=N, default=guess(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == -0.1 * self.x
        for i in range(N):
            right = self.solution[i]
            left = self.v[i]
            for j in range(N):
                if self.w[i][j]:
                    symbolic, numeric = FUNCTIONS[self.f[j]]
                    left = left + 0.05 * self.w[i][j] * symbolic(self.v[j])
                    right += 0.05 * self.w[i][j] * float(numeric(self.solution[j]))
            yield left == right * self.x


def residual(model: Nonlinear, v: Any, x: float) -> Any:
    def side(values: Any) -> Any:
        f = np.array([FUNCTIONS[k][1](a) for k, a in zip(model.f, values, strict=True)])
        return values + 0.05 * np.array(model.w) @ f

    return side(np.asarray(v)) - side(np.array(model.solution)) * x


KINDS = st.lists(st.integers(0, 3), min_size=N, max_size=N)
SOLUTIONS = st.lists(st.floats(-1, 1), min_size=N, max_size=N)


@given(MATRICES, KINDS, SOLUTIONS, st.sampled_from(["torn", "dae"]))
def test_nonlinear_blocks(rows: list[list[float]], f: list[int], solution: list[float], formulation: str) -> None:
    """Torn or left whole, the solution is found and followed."""
    model = Nonlinear(w=tuple(map(tuple, rows)), f=tuple(f), solution=tuple(solution))
    compiled = acausal.compile(model, formulation=formulation)
    result = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-8)
    np.testing.assert_allclose(residual(model, result["v"][0], 1.0), 0.0, atol=1e-9)
    np.testing.assert_allclose(residual(model, result["v"][-1], float(result["x"][-1])), 0.0, atol=1e-5)


class Square(Component):
    """Two equations that differ by a factor only."""

    a: Real = variable()
    b: Real = variable()

    def equations(self) -> Equations:
        yield acausal.sin(self.a) + self.b == 1.0
        yield 2 * acausal.sin(self.a) + 2 * self.b == 2.0


def test_dependent_nonlinear_equations() -> None:
    with fails_with(StructureError, "AC204"):
        acausal.compile(Square())


SIZE = 6
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
    v: Real = variable(shape=SIZE, default=guess(1.0))

    def equations(self) -> Equations:
        for row in self.rows:
            left = der(self.v[row.i]) if row.kind == "der" else self.v[row.i]
            right: Expr | float = row.a
            if row.kind != "number":
                right = self.v[row.j] if row.a == 1.0 else row.a * self.v[row.j]
                right = right + row.b * self.v[row.k] if row.b else right
            yield left == right
        for i in range(len(self.rows), SIZE):
            yield self.v[i] == float(i)


PLACE = st.integers(0, SIZE - 1)
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
    rows = draw(st.lists(ROWS, min_size=1, max_size=SIZE))
    lefts = draw(st.permutations(range(SIZE)))
    spread = draw(st.integers(0, 3)) > 0
    return tuple(row._replace(i=left) if spread else row for row, left in zip(rows, lefts, strict=False))


def oracle(rows: tuple[Row, ...]) -> Descriptor:
    E, A, b = (
        np.zeros((SIZE, SIZE)),
        np.zeros((SIZE, SIZE)),
        np.zeros(SIZE),
    )
    for r in range(SIZE):
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
@settings(max_examples=600)
@given(systems())
def test_many_small_systems(rows: tuple[Row, ...]) -> None:
    compare(rows)


class Ring(Component):
    """Exchanges around a ring that depend on differences only: the level is free, unless one place leaks."""

    n: int = structural(default=220)
    leaks: bool = structural(default=False)
    rate: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(shape=220)

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        for k in range(self.n):
            before, here, after = self.v[k - 1], self.v[k], self.v[(k + 1) % self.n]
            given = (here - before) ** 3 + here - before + (here - after) ** 3 + here - after
            lost = self.rate * here if self.leaks and k == 0 else 0.0
            yield given + self.v[(k + 7) % self.n] - here + lost == self.x * (k - (self.n - 1) / 2)


def test_a_free_level_is_found() -> None:
    """The sum of all equations holds no unknown."""
    with pytest.raises(StructureError, match="AC204"):
        acausal.compile(Ring())


def test_a_leak_fixes_the_level() -> None:
    assert acausal.compile(Ring(leaks=True)).states == ("x",)
