"""Random algebraic systems: the solution is known because the equations are made around it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

import acausal
from acausal import AcausalError, Component, Equations, Expr, Real, der, fixed, guess, parameter, structural, variable
from acausal.errors import StructureError

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
    with pytest.raises(StructureError) as caught:
        acausal.compile(Square())
    assert caught.value.code == "AC204"
