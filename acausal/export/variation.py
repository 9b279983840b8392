"""The linear map of a stretch of a run: variations of its end from those of its start and of parameters.

The stretch is integrated by Radau IIA with three stages, order 5, and its own control of the error; each step is an
equation W == x0 + h A F(W) for its stages, whose derivative is exact and small: one matrix serves all directions, and,
transposed, all adjoints. An integrator that carries the directions in its states
factorises a matrix of all of them instead, and needs the derivatives of its Jacobian.

Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), IV.8 (the method, and the error by an
embedded one of order 3).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from acausal.errors import IntegrationError
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.quick import Quick

Vector = NDArray[np.float64]

_S6 = 6.0**0.5
_C = np.array([(4 - _S6) / 10, (4 + _S6) / 10, 1.0])
_A = np.array(
    [
        [(88 - 7 * _S6) / 360, (296 - 169 * _S6) / 1800, (-2 + 3 * _S6) / 225],
        [(296 + 169 * _S6) / 1800, (88 + 7 * _S6) / 360, (-2 - 3 * _S6) / 225],
        [(16 - _S6) / 36, (16 + _S6) / 36, 1 / 9],
    ]
)
# Real eigenvalue of the inverse of A, and weights of the stages in the error.
_REAL = 3.637834252744496
_E = np.array([-(13 + 7 * _S6), -13 + 7 * _S6, -1.0]) / 3
_ITERATIONS = 8
_DENSE = 30  # variables up to which small dense matrices are faster than sparse ones
_LEAST_STEP = 1e-40


class Matrix:
    """The derivative of the equation of the stages, dense or sparse, to be solved with."""

    def __init__(self, matrix: Any) -> None:
        self._matrix = matrix if isinstance(matrix, np.ndarray) else scipy.sparse.linalg.splu(matrix)

    def solve(self, right: Vector) -> Vector:
        """Solution for one right-hand side or several."""
        if isinstance(self._matrix, np.ndarray):
            return np.asarray(np.linalg.solve(self._matrix, right), dtype=np.float64)
        return np.asarray(self._matrix.solve(right))

    def solve_transposed(self, right: Vector) -> Vector:
        """The same with the transposed matrix."""
        if isinstance(self._matrix, np.ndarray):
            return np.asarray(np.linalg.solve(self._matrix.T, right), dtype=np.float64)
        return np.asarray(self._matrix.solve(right, "T"))


@dataclass(frozen=True, eq=False)
class Element:
    """One step to the time t, where states and algebraic variables are w, in units of the model.

    Variations are those of the states over their nominal magnitudes. `matrix` and `right`, shape (3 n, np), are the
    derivatives of the equation of the stages by these and by parameters.
    """

    t: float
    w: Vector
    matrix: Matrix
    right: Vector
    nx: int

    def forward(self, x: Vector, parameters: bool = True) -> Vector:
        """Variations at the end, shape (nx, k), from those at the start and, one in each column, from parameters."""
        right = self.right.copy() if parameters else np.zeros((len(self.right), x.shape[1]))
        for k in range(3):
            right[self._part(k)] += x
        return self.matrix.solve(right)[self._part(2)]

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """Derivatives by the states at the start and by parameters, of what has `rows`, (k, nx), at the end."""
        end = np.zeros((len(self.right), len(rows)))
        end[self._part(2)] = rows.T
        found = self.matrix.solve_transposed(end).T
        return np.asarray(sum(found[:, self._part(k)] for k in range(3))), found @ self.right

    def _part(self, stage: int) -> slice:
        """The states of a stage."""
        first = stage * (len(self.right) // 3)
        return slice(first, first + self.nx)


class Variation:
    """The equations of one regime with their slopes, on states and algebraic variables by their nominal magnitudes."""

    def __init__(self, compiled: CompiledModel, chosen: list[int]) -> None:
        nx, nz = len(compiled.states), len(compiled.algebraic)
        self.nx, self.n, self.count = nx, nx + nz, len(chosen)
        self.scale = np.concatenate([compiled.nominal_x, compiled.nominal_z])
        t, w, p = ca.SX.sym("t"), ca.SX.sym("w", self.n), ca.SX.sym("p", len(compiled.parameters))
        u, m = ca.SX.sym("u", len(compiled.inputs)), ca.SX.sym("m", compiled.n_modes)
        x, z = ca.vertsplit(w * ca.DM(self.scale), [0, nx, self.n])
        ode, alg = compiled.rhs(t, x, z, u, p, m)
        value = ca.densify(ca.vertcat(ode / ca.DM(compiled.nominal_x), alg))
        slopes = ca.horzcat(ca.jacobian(value, w), ca.jacobian(value, p)[:, chosen])
        self.sparse = self.n > _DENSE
        arguments = [t, w, u, p, m]
        if self.sparse:
            self._one: Any = ca.Function("one", arguments, [value, ca.jacobian(value, w)])
            self._all = self._system_of(ca.Function("slopes", arguments, [value, slopes]), u, p, m)
        else:
            whole = ca.Function("whole", arguments, ca.cse([value, ca.densify(slopes)]))
            self._one, self._three = Quick(whole), Quick(whole.map("stages", "serial", 3, [2, 3, 4], []))

    def _system_of(self, slopes: Any, u: Any, p: Any, m: Any) -> Any:
        """`(t, h, w, stages, u, p, m) -> (residual, matrix, right)` of the stages, sparse."""
        n, nx = self.n, self.nx
        t, h, w, stages = ca.SX.sym("t"), ca.SX.sym("h"), ca.SX.sym("w", n), ca.SX.sym("stages", 3 * n)
        each = ca.vertsplit(stages, [0, n, 2 * n, 3 * n])
        found = [slopes(t + h * c, v, u, p, m) for c, v in zip(_C, each, strict=True)]
        moved = ca.diagcat(ca.SX.eye(nx), ca.SX(n - nx, n - nx))
        residual, matrix, right = [], [], []
        for i, v in enumerate(each):
            weights = [h * float(a) for a in _A[i]]
            rates = [ca.SX(nx, 1), ca.SX(nx, n + self.count)]
            for a, f in zip(weights, found, strict=True):
                rates = [total + a * part[:nx, :] for total, part in zip(rates, f, strict=True)]
            residual.append(ca.vertcat(v[:nx] - w[:nx] - rates[0], found[i][0][nx:]))
            blocks = []
            for j, f in enumerate(found):
                below = f[1][nx:, :n] if i == j else ca.SX(n - nx, n)
                blocks.append(ca.vertcat(-weights[j] * f[1][:nx, :n], below) + (moved if i == j else 0))
            matrix.append(ca.horzcat(*blocks))
            right.append(ca.vertcat(rates[1][:, n:], -found[i][1][nx:, n:]))
        parts = [ca.densify(ca.vertcat(*residual)), ca.vertcat(*matrix), ca.densify(ca.vertcat(*right))]
        return ca.Function("system", [t, h, w, stages, u, p, m], parts)

    def elements(
        self,
        start: float,
        end: float,
        w: Vector,
        held: tuple[Vector, Vector, Vector],
        tolerance: float,
        stops: Sequence[float] = (),
    ) -> Iterator[Element]:
        """The steps from `start` to `end`; w are states and algebraic variables, `held` are (u, p, m).

        Steps end at the `stops`, which are between start and end, in order.

        Raises
        ------
        IntegrationError
            AC408 where no step is small enough.
        """
        tolerance = 0.01 * tolerance ** (2 / 3)  # the error is that of order 3, the step of order 5: as in RADAU5
        t, w = start, w / self.scale
        value, slopes = self._at(t, w, held)
        h = min(end - start, self._first(w, value, tolerance))
        guess = np.tile(w, (3, 1))
        ends = [*stops, end]
        while t < end:
            until = next(e for e in ends if e > t)
            whole, h = h, until - t if t + 1.01 * h >= until else h
            if t + h <= t or h < _LEAST_STEP * (end - start):
                raise IntegrationError(
                    "AC408",
                    f"the derivatives of the run cannot be carried on from t = {t:.9g} s: no step is small enough",
                    cause="an equation has no derivative there, or a solution ends",
                    help="end the run before it, or take differences of runs",
                )
            stages = self._stages(t, h, w, guess, held, tolerance)
            if stages is None:
                h, guess = h / 4, np.tile(w, (3, 1))
                continue
            found, matrix, right = stages
            error = self._error(h, w, found, value, slopes, tolerance)
            grown = 0.9 * error**-0.25 if error > 0 else 8.0
            if error > 1:
                h, guess = h * max(0.2, min(grown, 0.9)), np.tile(w, (3, 1))
                continue
            t, before, w = until if h == until - t else t + h, h, found[2]
            yield Element(t, w * self.scale, matrix, right, self.nx)
            value, slopes = self._at(t, w, held)
            h = max(h * min(max(grown, 0.3), 8.0), whole if h < whole else 0.0)
            guess = _extended(found, min(h, end - t) / before)

    def _at(self, t: float, w: Vector, held: tuple[Vector, Vector, Vector]) -> tuple[Vector, Any]:
        """Rates and residuals, and their derivatives, at a point."""
        value: Any
        slopes: Any
        value, slopes = self._one(t, w, *held)
        if self.sparse:
            return np.array(value).ravel(), _csc(slopes)
        return value, slopes.reshape(self.n, -1)[:, : self.n]

    def _first(self, w: Vector, value: Vector, tolerance: float) -> float:
        rate = float(np.abs(value[: self.nx] / (1e-3 + np.abs(w[: self.nx]))).max(initial=1e-12))
        return float(tolerance**0.25 / rate)

    def _stages(
        self, t: float, h: float, w: Vector, guess: Vector, held: tuple[Vector, Vector, Vector], tolerance: float
    ) -> tuple[Vector, Matrix, Vector] | None:
        """Values of the stages, the derivative of their equation, and minus that by parameters, if it converges."""
        found, last = guess.ravel().copy(), np.inf
        for _ in range(_ITERATIONS):
            residual, matrix, right = self._system(t, h, w, found, held)
            if not (np.isfinite(residual).all() and np.isfinite(right).all()):
                return None
            factors = Matrix(matrix)
            move = factors.solve(residual)
            found = found - move
            size = float(np.abs(move / (1e-3 + np.abs(found))).max(initial=0.0))
            if not np.isfinite(size) or size > 2 * last:
                return None
            if size <= 1e-4 * tolerance or size <= 1e-13:
                return found.reshape(3, self.n), factors, right
            last = size
        return None

    def _system(
        self, t: float, h: float, w: Vector, found: Vector, held: tuple[Vector, Vector, Vector]
    ) -> tuple[Vector, Any, Vector]:
        """Residual of the stages `found`, its derivative, and minus that by parameters."""
        n, nx = self.n, self.nx
        if self.sparse:
            residual, sparse, right = self._all(t, h, w, found, *held)
            return np.array(residual).ravel(), _csc(sparse), np.array(right).reshape(3 * n, self.count)
        columns, slopes = self._three(t + h * _C, found, *held)
        values, blocks = columns.T, slopes.reshape(n, 3, n + self.count).transpose(1, 0, 2)
        stages = values.copy()
        stages[:, :nx] = found.reshape(3, n)[:, :nx] - w[:nx] - h * _A @ values[:, :nx]
        matrix = np.zeros((3, n, 3, n))
        matrix[:, :nx] = -h * np.einsum("ij,jrc->irjc", _A, blocks[:, :nx, :n])
        for k in range(3):
            matrix[k, range(nx), k, range(nx)] += 1.0
            matrix[k, nx:, k] = blocks[k, nx:, :n]
        by_p = -blocks[:, :, n:]
        by_p[:, :nx] = h * np.einsum("ij,jrc->irc", _A, blocks[:, :nx, n:])
        return stages.ravel(), matrix.reshape(3 * n, 3 * n), by_p.reshape(3 * n, self.count)

    def _error(self, h: float, w: Vector, found: Vector, value: Vector, slopes: Any, tolerance: float) -> float:
        """The error of the step by the embedded method, in units of the tolerance."""
        nx, n = self.nx, self.n
        right = np.zeros(n)
        right[:nx] = _E @ (found[:, :nx] - w[:nx]) / h + value[:nx]
        own = np.zeros(n)
        own[:nx] = _REAL / h
        try:
            error = Matrix(scipy.sparse.diags(own, format="csc") - slopes if self.sparse else np.diag(own) - slopes)
            found_error = error.solve(right)
        except (np.linalg.LinAlgError, RuntimeError):
            return np.inf
        size = tolerance * (1e-3 + np.maximum(np.abs(w[:nx]), np.abs(found[2, :nx])))
        return float(np.sqrt(np.mean((found_error[:nx] / size) ** 2))) if nx else 0.0


def _extended(stages: Vector, ratio: float) -> Vector:
    """Values of the polynomial through the stages at those of the next step, `ratio` times as long."""
    nodes = np.array([np.prod([(1 + ratio * _C - c) / (_C[k] - c) for c in _C[_C != _C[k]]], axis=0) for k in range(3)])
    return np.asarray(nodes.T @ stages)


def _csc(matrix: Any) -> Any:
    """CasADi's sparse matrix as SciPy's."""
    pattern = matrix.sparsity()
    return scipy.sparse.csc_matrix((matrix.nonzeros(), pattern.row(), pattern.colind()), shape=matrix.shape)
