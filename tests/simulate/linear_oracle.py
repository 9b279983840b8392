"""Dense oracles for networks of linear components, written from the textbooks and not from the compiler.

`Descriptor` is E w' = A w + b. Mechanical networks are M q'' + D q' + K q = F with rigid constraints G q = g, reduced
by a basis of the null space of G; circuits are the modified nodal analysis of Ho, Ruehli and Brennan (1975). Both say
whether the network has exactly one solution, and give it in closed form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]

RANK = 1e-9  # relative: all values are of the order of one


class Part(NamedTuple):
    """A component: kind, the nodes its connectors go to, and its values."""

    kind: str
    nodes: tuple[int, ...]
    values: tuple[float, ...] = ()


@dataclass(frozen=True)
class Descriptor:
    """E w' = A w + b."""

    E: Array
    A: Array
    b: Array

    def is_regular(self) -> bool:
        """Whether the pencil has full rank somewhere: at a generic point it then has it nearly everywhere."""
        return _full_rank(1.37 * self.E - self.A)

    def has_index_one(self) -> bool:
        """Whether the equations without derivatives determine, as they stand, what has no derivative."""
        left, sizes, right = np.linalg.svd(self.E)
        rank = int(np.sum(sizes > RANK * max(1.0, sizes.max(initial=0.0))))
        return _full_rank(left[:, rank:].T @ self.A @ right[rank:].T)

    def solve(self, momentum: Array, stop: float) -> Array:
        """w(stop) from E w(0) = `momentum`, exact up to rounding for any index.

        With S = (s E - A)^-1 E for a generic s the space splits in two: on the range of S^n it is invertible and
        w' = S^-1 (s S - 1) w + ... is an ordinary differential equation, on the kernel of S^n it is nilpotent and
        constant b leaves only the constant solution of A w = -b there (Campbell, Singular Systems of Differential
        Equations, 1980, chapter 3). A Runge-Kutta method would divide rounding errors by a power of its step instead.
        """
        n, s = len(self.b), 1.37
        shifted = np.linalg.inv(s * self.E - self.A)
        S, b = shifted @ self.E, shifted @ self.b
        V, W = _lasting(S), _lasting(S.T)
        onto = np.linalg.solve(W.T @ V, W.T)  # coordinates in V of the part of a vector in the range
        m = V.shape[1]
        inner = onto @ S @ V
        speed = np.zeros((m + 1, m + 1))
        speed[:m, :m] = np.linalg.solve(inner, s * inner - np.eye(m))
        speed[:m, m] = np.linalg.solve(inner, onto @ b)
        start = np.linalg.solve(inner, onto @ shifted @ momentum)
        moving = V @ (expm(speed * stop) @ np.append(start, 1.0))[:m]
        still = b - V @ onto @ b
        rest = still.copy()
        for _ in range(n - m):  # 0 = (s S - 1) w + b on the kernel: a geometric series that ends
            still = s * (S @ still)
            still -= V @ (onto @ still)
            rest += still
        return np.asarray(moving + rest)


def _lasting(S: Array) -> Array:
    """Orthonormal basis of the range of S^n, by one decision on the rank for each power."""
    basis = np.eye(len(S))
    for _ in range(len(S)):
        left, sizes, _ = np.linalg.svd(S @ basis, full_matrices=False)
        rank = int(np.sum(sizes > RANK * max(1.0, sizes.max(initial=0.0))))
        if rank == basis.shape[1]:
            break
        basis = left[:, :rank]
    return np.asarray(basis)


def _full_rank(matrix: Array) -> bool:
    if not matrix.size:
        return len(matrix) == 0
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return bool(sizes[-1] > RANK * max(1.0, sizes[0])) and matrix.shape[0] <= matrix.shape[1]


class Mechanics:
    """A network of masses, springs, dampers, rods, gears, fixed points and forces over `n` junctions.

    Values: mass (m, length), spring (c, relaxed length), damper (d,), rod (length,), gear (ratio,), fixed (place,),
    force (f,).
    """

    def __init__(self, n: int, parts: Sequence[Part]) -> None:
        self.n, self.parts = n, parts
        self.M, self.D, self.K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        self.F = np.zeros(n)
        rows: list[Array] = []
        right: list[float] = []
        for part in parts:
            e = [self.unit(k) for k in part.nodes]
            if part.kind in ("mass", "rod"):
                rows.append(e[1] - e[0])
                right.append(part.values[-1])
            if part.kind == "mass":
                middle = (e[0] + e[1]) / 2
                self.M += part.values[0] * np.outer(middle, middle)
            elif part.kind == "spring":
                across = e[1] - e[0]
                self.K += part.values[0] * np.outer(across, across)
                self.F += part.values[0] * part.values[1] * across
            elif part.kind == "damper":
                self.D += part.values[0] * np.outer(e[1] - e[0], e[1] - e[0])
            elif part.kind == "gear":
                rows.append(e[0] - part.values[0] * e[1])
                right.append(0.0)
            elif part.kind == "fixed":
                rows.append(e[0])
                right.append(part.values[0])
            elif part.kind == "force":
                self.F += part.values[0] * e[0]
        self.G = np.array(rows).reshape(-1, n)
        self.g = np.array(right)
        self.independent = _full_rank(self.G)
        _, sizes, vectors = np.linalg.svd(self.G, full_matrices=True)
        rank = int(np.sum(sizes > RANK * max(1.0, sizes.max(initial=0.0))))
        self.N = vectors[rank:].T
        self.place = np.linalg.lstsq(self.G, self.g, rcond=None)[0] if len(rows) else np.zeros(n)

    def unit(self, k: int) -> Array:
        return np.asarray(np.eye(self.n)[k])

    def is_regular(self) -> bool:
        """One motion and one set of forces: no constraint too many, nothing that floats without mass and force."""
        free: Array = self.N.T @ (self.M + self.D + self.K) @ self.N
        return self.independent and _full_rank(free)

    def solve(self, q: Array, momentum: Array, stop: float) -> tuple[Array, Array, Array]:
        """q(stop), q'(stop) and M q''(stop), the last as seen by the free motions, from q(0) and M q'(0)."""
        n = self.N.shape[1]
        M, D, K = (self.N.T @ X @ self.N for X in (self.M, self.D, self.K))
        f = self.N.T @ (self.F - self.K @ self.place)
        E = np.block([[np.eye(n), np.zeros((n, n))], [np.zeros((n, n)), M]])
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -D]])
        start = np.concatenate([self.N.T @ (q - self.place), self.N.T @ momentum])
        w = Descriptor(E, A, np.concatenate([np.zeros(n), f])).solve(start, stop)
        y, v = w[:n], w[n:]
        return self.place + self.N @ y, self.N @ v, f - K @ y - D @ v


def circuit(n: int, parts: Sequence[Part]) -> Descriptor:
    """Modified nodal analysis over `n` nodes; further unknowns are the currents of L, V, T (primary) and G, in order.

    Values: R (resistance,), C (capacitance,), L (inductance,), V (voltage,), I (current p to n,), T (turns ratio,).
    """
    branches = [k for k, part in enumerate(parts) if part.kind in "LVTG"]
    size = n + len(branches)
    E, A, b = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for k, part in enumerate(parts):
        across = np.zeros(size)
        across[part.nodes[0]] += 1.0
        if part.kind != "G":
            across[part.nodes[1]] -= 1.0
        current = np.eye(size)[n + branches.index(k)] if k in branches else np.zeros(size)
        row = n + branches.index(k) if k in branches else -1
        # Kirchhoff's current law reads: E v' = A v + b with everything that leaves the node on the left.
        if part.kind == "R":
            A -= np.outer(across, across) / part.values[0]
        elif part.kind == "C":
            E += part.values[0] * np.outer(across, across)
        elif part.kind == "I":
            b -= part.values[0] * across
        elif part.kind == "T":
            second = np.zeros(size)
            second[part.nodes[2]] += 1.0
            second[part.nodes[3]] -= 1.0
            A -= np.outer(across - part.values[0] * second, current)
            A[row] += across - part.values[0] * second
        else:
            A -= np.outer(across, current)
            A[row] += across
        if part.kind == "L":
            E[row] += part.values[0] * current
        elif part.kind == "V":
            b[row] -= part.values[0]
    return Descriptor(E, A, b)
