"""Steps of Radau IIA (order 9, five stages) with exact derivatives.

A step is an equation W == x0 + h A F(W) for its stages W. Its Jacobian, factorised once, serves all directions and,
transposed, all adjoints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from acausal.arrays import Vector
from acausal.errors import IntegrationError
from acausal.export.variation.control import Control
from acausal.export.variation.element import LEAST, SMALL, Interval
from acausal.export.variation.slopes import Slopes
from acausal.export.variation.tables import RADAU, STAGES

_ITERATIONS = 8
# Relative rounding error of a term, with a safety margin.
_ROUNDED = 2e-15
_NODES, _A = RADAU.nodes, RADAU.matrix
# For each node, the product of its differences from the others.
_NODE_PRODUCTS = np.where(np.eye(STAGES, dtype=bool), 1.0, _NODES[:, None] - _NODES[None, :]).prod(axis=1)


class Matrix:
    """A factorised matrix, dense or sparse, for linear systems."""

    def __init__(self, matrix: Any) -> None:
        self._matrix = matrix if isinstance(matrix, np.ndarray) else scipy.sparse.linalg.splu(matrix)

    def solve(self, right: Vector) -> Vector:
        """Solution for right-hand sides of shape (stages * n,) or (stages * n, k)."""
        if isinstance(self._matrix, np.ndarray):
            return np.asarray(np.linalg.solve(self._matrix, right), dtype=np.float64)
        return np.asarray(self._matrix.solve(right))

    def solve_transposed(self, right: Vector) -> Vector:
        """As `solve`, shapes included, with the transposed matrix."""
        if isinstance(self._matrix, np.ndarray):
            return np.asarray(np.linalg.solve(self._matrix.T, right), dtype=np.float64)
        return np.asarray(self._matrix.solve(right, "T"))


@dataclass(frozen=True, eq=False)
class RadauElement:
    """A Radau step, see `Element`.

    `matrix` is the derivative of the stage equation by the stages; `right`, shape (stages * n, parameters), is minus
    its derivative by parameters.
    """

    t: float
    w: Vector
    x: Vector
    matrix: Matrix
    right: Vector
    nx: int

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """See `Element`."""
        end = np.zeros((len(self.right), len(rows)))
        end[self._part(STAGES - 1)] = rows.T
        found = self.matrix.solve_transposed(end).T
        return np.asarray(sum(found[:, self._part(k)] for k in range(STAGES))), found @ self.right

    def _part(self, stage: int) -> slice:
        """Slice of the states of a stage."""
        first = stage * (len(self.right) // STAGES)
        return slice(first, first + self.nx)


def radau(slopes: Slopes, interval: Interval, x: Vector, parameters: bool) -> Iterator[RadauElement]:
    """Yield steps over an interval; `x` and `parameters` as in `explicit`.

    Raises IntegrationError: AC408 if no step is small enough.
    """
    return _Stepping(slopes, interval, x, parameters).elements()


def tolerance_of(tolerance: float) -> float:
    """Tolerance of the embedded error estimate, which has order five, for steps of order nine.

    It is tight because a kink inside a step causes an error of the order of the step squared in the solution, and of
    the step in its derivatives: with ten times this tolerance, derivatives of ThickBlock at 1e-8 were off by 2e-5
    instead of 6e-8.
    """
    return float(1e-3 * tolerance**0.75)


class _Stepping:
    def __init__(self, slopes: Slopes, interval: Interval, x: Vector, parameters: bool) -> None:
        self.slopes, self.interval = slopes, interval
        self.n, self.nx = slopes.n, slopes.nx
        self.tolerance = tolerance_of(interval.tolerance)
        self.x, self.parameters = x, parameters
        self.control = Control(interval.accuracy, self.tolerance, x, interval.start)
        inside = slopes.columns < self.n
        self._inside, self._outside = np.flatnonzero(inside), np.flatnonzero(~inside)
        self._places = self._sparse_places() if not slopes.is_small else None

    def elements(self) -> Iterator[RadauElement]:
        interval, slopes = self.interval, self.slopes
        t, w, ends, end = interval.start, interval.w, iter(interval.ends), interval.ends[-1]
        until = next(ends)
        value, entries = slopes.at(t, w, *interval.numbers)
        rate = float(np.abs(value[: self.nx] / (SMALL + np.abs(w[: self.nx]))).max(initial=1e-12))
        h = min(end - t, self.tolerance ** (1 / (STAGES + 1)) / rate)
        guess = np.tile(w, (STAGES, 1))
        while t < end:
            if t >= until:
                until = next(ends)
            whole, h = h, until - t if t + 1.01 * h >= until else h
            if t + h <= t or h < LEAST * (end - interval.start):
                raise step_too_small(t)
            found = self._stages(t, h, w, guess)
            if found is None:
                h, guess = h / 4, np.tile(w, (STAGES, 1))
                continue
            stages, matrix, right = found
            after, error = self._judged(t, h, w, stages, (value, entries), found[1:])
            growth = 0.9 * error ** (-1 / 8) if error > 0 else 8.0
            if error > 1:
                h, guess = h * self.control.shorter(max(0.2, min(growth, 0.9))), np.tile(w, (STAGES, 1))
                continue
            t, before, w = until if h == until - t else t + h, h, stages[-1]
            self.x = self.control.accepted(after)
            yield RadauElement(t, w, self.x, matrix, right, self.nx)
            value, entries = slopes.at(t, w, *interval.numbers)
            h = self.control.longer(h, whole, growth)
            guess = _extrapolate(stages, min(h, end - t) / before)

    def _stages(self, t: float, h: float, w: Vector, guess: Vector) -> tuple[Vector, Matrix, Vector] | None:
        """(Stages (STAGES, n), derivative of their equation, minus that by parameters); None without convergence."""
        found, last = guess.ravel().copy(), np.inf
        for _ in range(_ITERATIONS):
            values, entries = self.slopes.many(t + h * _NODES, found.reshape(STAGES, self.n), *self.interval.numbers)
            residual = values.copy()
            residual[:, : self.nx] = found.reshape(STAGES, self.n)[:, : self.nx] - w[: self.nx]
            residual[:, : self.nx] -= h * _A @ values[:, : self.nx]
            if not (np.isfinite(residual).all() and np.isfinite(entries).all()):
                return None
            try:
                factors = Matrix(self._matrix(h, entries))
                move = factors.solve(residual.ravel())
            except (np.linalg.LinAlgError, RuntimeError):
                return None
            found = found - move
            size = float(np.abs(move / (SMALL + np.abs(found))).max(initial=0.0))
            if not np.isfinite(size) or size > 2 * last:
                return None
            if size <= 1e-4 * self.tolerance or size <= 1e-13:
                return found.reshape(STAGES, self.n), factors, self._right(h, entries)
            last = size
        return None

    def _matrix(self, h: float, entries: Vector) -> Any:
        """Derivative of the stage equation by the stages, (STAGES * n, STAGES * n)."""
        n, nx = self.n, self.nx
        if self._places is not None:
            kinds, weights, source, pattern = self._places
            data = np.where(kinds == 0, 1.0, np.where(kinds == 1, -h * weights, 1.0) * entries.ravel()[source])
            return scipy.sparse.csc_matrix((data, pattern), shape=(STAGES * n, STAGES * n))
        blocks = self.slopes.dense(entries)
        matrix = np.zeros((STAGES, n, STAGES, n))
        matrix[:, :nx] = -h * np.einsum("ij,jrc->irjc", _A, blocks[:, :nx, :n])
        for k in range(STAGES):
            matrix[k, range(nx), k, range(nx)] += 1.0
            matrix[k, nx:, k] = blocks[k, nx:, :n]
        return matrix.reshape(STAGES * n, STAGES * n)

    def _sparse_places(self) -> tuple[Any, Any, Any, Any]:
        """Entries of the sparse stage matrix: kind (0 identity, 1 rate, 2 residual), weight, source entry, position."""
        n, nx, count = self.n, self.nx, len(self.slopes.rows)
        rows, columns = self.slopes.rows[self._inside], self.slopes.columns[self._inside]
        rates, rests = self._inside[rows < nx], self._inside[rows >= nx]
        found = [(0, 0.0, np.zeros(nx, dtype=int), k * n + np.arange(nx), k * n + np.arange(nx)) for k in range(STAGES)]
        for j in range(STAGES):
            at = j * count
            below = rows[rows >= nx]
            found.append((2, 1.0, at + rests, j * n + below, j * n + columns[rows >= nx]))
            for i in range(STAGES):
                above = i * n + rows[rows < nx]
                found.append((1, _A[i, j], at + rates, above, j * n + columns[rows < nx]))
        kinds, weights = (np.concatenate([np.full(len(f[2]), f[k]) for f in found]) for k in (0, 1))
        source, row, column = (np.concatenate([f[k] for f in found]) for k in (2, 3, 4))
        return kinds, weights, source, (row, column)

    def _right(self, h: float, entries: Vector) -> Vector:
        """Minus the derivative of the stage equation by parameters, shape (STAGES * n, count)."""
        n, nx = self.n, self.nx
        by_p = np.zeros((STAGES, n, self.slopes.count))
        own = self._outside
        by_p[:, self.slopes.rows[own], self.slopes.columns[own] - n] = -entries[:, own]
        by_p[:, :nx] = -h * np.einsum("ij,jrc->irc", _A, by_p[:, :nx])
        return by_p.reshape(STAGES * n, self.slopes.count)

    def _judged(
        self, t: float, h: float, w: Vector, stages: Vector, start: tuple[Vector, Vector], linear: tuple[Matrix, Vector]
    ) -> tuple[Vector, float]:
        """(Variations at the end of a step, shape (nx, k); error of the step, by the embedded method, in tolerances).

        `start`: value and entries at the start; `linear`: matrix of the stages, and minus the derivative of their
        equation by parameters.
        """
        nx, (value, entries) = self.nx, start
        try:
            matrix = Matrix(self._small_matrix(h, entries))
            found = self._embedded(matrix, h, stages[:, :nx] - w[:nx], value[:nx])
            size = self.tolerance * (SMALL + np.maximum(np.abs(w[:nx]), np.abs(stages[-1, :nx])))
            error = float(_estimate(found, size)) if nx else 0.0
            if error > 1 or not (nx and self.x.shape[1]):
                return self.x, error
            x = self._variations(*linear)
            after = x[-1, :nx]
            if self.control.accuracy is None:
                return after, error
            own_x, x = self.x[:, : self.control.count], x[:, :, : self.control.count]
            rate, rounding = self._rate_of_variations(h, entries, own_x)
            found = self._embedded(matrix, h, x[:, :nx] - own_x, rate)
        except (np.linalg.LinAlgError, RuntimeError):
            return self.x, np.inf
        if not np.isfinite(found).all():
            return after, np.inf
        own_after = x[-1, :nx]
        allowed = self.control.allowed(own_x, own_after)
        ratio, whole = float(_estimate(found, allowed + rounding).max()), float(np.abs(found[0] / allowed).max())
        return after, max(error, self.control.judged(t, h, ratio, own_after - own_x, found[0], whole))

    def _small_matrix(self, h: float, entries: Vector) -> Any:
        """The matrix of the embedded error, (n, n)."""
        n, inside = self.n, self._inside
        diagonal = np.zeros(n)
        diagonal[: self.nx] = RADAU.real / h
        rows, columns = self.slopes.rows[inside], self.slopes.columns[inside]
        if self.slopes.is_small:
            matrix: Any = np.diag(diagonal)
            matrix[rows, columns] -= entries[inside]
            return matrix
        slopes = scipy.sparse.csc_matrix((entries[inside], (rows, columns)), shape=(n, n))
        return (scipy.sparse.diags(diagonal) - slopes).tocsc()

    def _embedded(self, matrix: Matrix, h: float, moved: Vector, rate: Vector) -> Vector:
        """Both embedded errors of the states, (2, nx, ...), from their changes and their rate at the start.

        `moved`: stages minus the start, shape (STAGES, nx, ...); `rate`: shape (nx, ...).
        """
        right = np.zeros((self.n, 2, *moved.shape[2:]))
        right[: self.nx] = np.moveaxis(np.tensordot(RADAU.weights, moved, 1) / h + rate, 0, 1)
        found = matrix.solve(right.reshape(self.n, -1)).reshape(right.shape)
        return np.moveaxis(found[: self.nx], 0, 1)

    def _variations(self, matrix: Matrix, right: Vector) -> Vector:
        """Variations at the stages, shape (STAGES, n, k)."""
        right_all = np.zeros((len(right), self.x.shape[1]))
        if self.parameters:
            right_all[:, : right.shape[1]] = right
        for k in range(STAGES):
            right_all[k * self.n : k * self.n + self.nx] += self.x
        return matrix.solve(right_all).reshape(STAGES, self.n, -1)

    def _rate_of_variations(self, h: float, entries: Vector, x: Vector) -> tuple[Vector, Vector]:
        """(Rates of the variations `x` at the start of a step, rounding error of each), shapes (nx, k).

        A fast equation keeps its variable where its terms cancel: the rounding error of the variable is that of the
        largest term, divided by the slope of the equation in its variable.
        """
        n, nx, is_small = self.n, self.nx, self.slopes.is_small
        slopes: Any
        if is_small:
            slopes = self.slopes.dense(entries[None])[0]
        else:
            shape = n, n + self.slopes.count
            slopes = scipy.sparse.csc_matrix((entries, self.slopes.rows, self.slopes.starts), shape=shape)
        rate, all_x = slopes[:, :nx] @ x, x
        if self.parameters:
            rate = rate + (slopes[:, n:] if is_small else slopes[:, n:].toarray())
        if n > nx:
            by_z = slopes[:, nx:n]
            algebraic = Matrix(by_z[nx:] if is_small else by_z[nx:].tocsc()).solve(-rate[nx:])
            rate, all_x = rate[:nx] + by_z[:nx] @ algebraic, np.vstack([x, algebraic])
        inside = slopes[:nx, :n]
        fast = RADAU.real / h + np.abs(inside.diagonal())
        return np.asarray(rate), _ROUNDED * (abs(inside) @ np.abs(all_x)) / fast[:, None]


def _estimate(errors: Vector, size: Vector) -> Any:
    """Error of a step for each column, from both embedded errors, (2, nx, ...), in units of `size`, shape (nx, ...).

    It has order 7 where the solution is smooth, and order 5 where it is not and both errors are similar (as in DOP853).
    """
    five, three = np.mean((errors / size) ** 2, axis=1)
    both = five + 0.01 * three
    return five / np.sqrt(np.where(both > 0, both, 1.0))


def step_too_small(t: float) -> IntegrationError:
    """IntegrationError AC408 for a step that would be too small."""
    return IntegrationError(
        "AC408",
        f"the derivatives of the run cannot be continued from t = {t:.9g} s: no step is small enough",
        cause="an equation has no derivative there, or a solution ends",
        help="end the run before it, or use differences of runs",
    )


def _extrapolate(stages: Vector, ratio: float) -> Vector:
    """Extrapolated stages of the next step, `ratio` times as long; shape (STAGES, n)."""
    apart = (1 + ratio * _NODES)[:, None] - _NODES[None, :]
    factors = np.where(np.eye(STAGES, dtype=bool)[None], 1.0, apart[:, None, :]).prod(axis=2)
    return np.asarray(factors / _NODE_PRODUCTS @ stages)
