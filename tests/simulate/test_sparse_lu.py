"""The LU of generated Rosenbrock integrators: backward stable row by row, or refused.

Law: Higham, Accuracy and Stability of Numerical Algorithms (2002), theorems 9.3 and 9.4: the computed solution
satisfies (A + E) x = b with |E| <= 3 n eps |L||U|, and the factorisation is accepted where |L||U| is at most 1000 times
the largest entry of each row.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from acausal.simulate.native import cache
from acausal.simulate.native.sparse_lu import _code, elimination, with_lu

pytestmark = pytest.mark.skipif(cache.compiler() is None, reason="needs a C compiler")
_HEAD = """#include <math.h>
typedef double casadi_real;
typedef long long casadi_int;
static int casadi_ivp_isfinite(casadi_real x) { return isfinite(x); }
"""
_ENTRY = """
int attempt(const double* a, double* lu, double* x, double* v) {
  int accepted = acausal_lu(a, lu, x);
  if (accepted) acausal_lu_solve(lu, v, x);
  return accepted;
}
"""


Array = NDArray[np.float64]


def _solver(pattern: ca.Sparsity) -> Callable[[Array, Array], Array | None]:
    """`(A, b) -> x` for matrices with these entries; None where the factorisation is refused."""
    plan = elimination(pattern)
    assert plan is not None
    text = _HEAD + _code(plan) + _ENTRY
    library = cache.made(cache.key("test of the LU", text), lambda: text, lambda path: ctypes.CDLL(str(path)))
    assert library is not None
    rows, columns = pattern.get_triplet()

    def solve(matrix: Array, b: Array) -> Array | None:
        a, v = np.ascontiguousarray(matrix[rows, columns]), b.copy()
        lu, x = np.full(plan.numbers, np.nan), np.full(len(b), np.nan)
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in (a, lu, x, v))
        return v if library.attempt(*pointers) else None

    return solve


def _pattern(rng: np.random.Generator, n: int) -> ca.Sparsity:
    return ca.DM((rng.random((n, n)) < 3.0 / n) | np.eye(n, dtype=bool)).sparsity()


@pytest.mark.parametrize("n", [13, 45])
def test_what_is_accepted_is_backward_stable_in_each_row(n: int) -> None:
    """Of 13 rows factorisation and solution are written out, of 45 they are not."""
    rng = np.random.default_rng(3)
    pattern = _pattern(rng, n)
    solve = _solver(pattern)
    there = np.array(ca.DM(pattern, 1.0).full(), dtype=bool)
    accepted = 0
    for shift in np.repeat([0.0, 1e-6, 1e-2, 1.0, 10.0, 1e6], 60):
        # the units of equations and states differ by twelve orders
        matrix = np.where(there, rng.normal(size=(n, n)), 0.0) + shift * np.eye(n)
        matrix = 10.0 ** rng.uniform(-6, 6, (n, 1)) * matrix * 10.0 ** rng.uniform(-1, 1, n)
        b = np.abs(matrix).max(axis=1) * rng.normal(size=n)
        x = solve(matrix, b)
        if x is None:
            continue
        accepted += 1
        bound = 3 * n * np.finfo(float).eps * 1e3 * np.abs(matrix).max(axis=1) * np.abs(x).sum()
        assert (np.abs(matrix @ x - b) <= bound).all()
    assert accepted > 100  # nearly all that are dominated by their diagonal


@pytest.mark.parametrize(
    "matrix",
    [
        pytest.param([[1e-20, 1.0], [1.0, 1.0]], id="needs a pivot"),
        pytest.param([[0.0, 1.0], [1.0, 0.0]], id="zero on the diagonal"),
        pytest.param([[1.0, 2.0], [2.0, 4.0]], id="singular"),
        pytest.param([[0.0, 0.0], [0.0, 0.0]], id="zero"),
        pytest.param([[np.nan, 1.0], [1.0, 1.0]], id="not a number"),
        pytest.param([[1.0, np.inf], [1.0, 1.0]], id="infinite"),
    ],
)
def test_what_needs_pivots_or_is_singular_is_left_to_qr(matrix: list[list[float]]) -> None:
    assert _solver(ca.Sparsity.dense(2, 2))(np.array(matrix), np.ones(2)) is None


def test_a_diagonal_with_structural_zeros_is_left_to_qr() -> None:
    assert elimination(ca.sparsify(ca.DM([[1, 1], [1, 0]])).sparsity()) is None


def test_minimum_degree_keeps_arrows_and_bands_without_fill() -> None:
    arrow = np.eye(50)
    arrow[0, :] = arrow[:, 0] = 1.0
    band = np.eye(50) + np.eye(50, k=1) + np.eye(50, k=-1)
    for matrix in (arrow, band):
        plan = elimination(ca.sparsify(ca.DM(matrix)).sparsity())
        assert plan is not None
        assert plan.numbers == np.count_nonzero(matrix) + 50


def test_generated_integrators_of_this_casadi_get_it() -> None:
    x = ca.SX.sym("x", 2)
    dae = {"x": x, "ode": ca.vertcat(-1e3 * x[0] * x[1], x[0] - x[1])}
    generator = ca.CodeGenerator("model.c")
    generator.add(ca.integrator("segment", "rosenbrock", dae, 0.0, [0.5, 1.0]))
    assert "acausal_lu_solve(" in with_lu(generator.dump())
