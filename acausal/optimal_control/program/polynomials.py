"""Polynomials on one interval: Radau collocation for the states, Bernstein polynomials for the inputs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector


@dataclass(frozen=True)
class Basis:
    """Collocation at the `degree` points of Radau IIA; inputs of degree `control` between the ends of an interval.

    Source: L. T. Biegler, Nonlinear Programming, SIAM 2010, chapter 10. A Bernstein polynomial lies within the range of
    its coefficients, so limits on the coefficients hold everywhere (R. T. Farouki, Computer Aided Geometric Design 29
    (2012) 379-419).
    """

    degree: int
    control: int

    @cached_property
    def points(self) -> Vector:
        """The collocation points in (0, 1], shape (degree,)."""
        return np.array(ca.collocation_points(self.degree, "radau"))

    @cached_property
    def slopes(self) -> Vector:
        """Weights of the values at 0 and at the points for derivatives at the points, shape (degree + 1, degree)."""
        return np.array(ca.collocation_coeff(self.points.tolist())[0])

    @cached_property
    def weights(self) -> Vector:
        """Weights of the quadrature at the points, shape (degree,)."""
        return np.array(ca.collocation_coeff(self.points.tolist())[2]).ravel()

    def bernstein(self, at: Vector) -> Vector:
        """Values of the Bernstein polynomials at n positions `at` in [0, 1], shape (control + 1, n)."""
        q = self.control
        return np.array([comb(q, i) * at**i * (1 - at) ** (q - i) for i in range(q + 1)])

    @cached_property
    def nodes(self) -> Vector:
        """Nodes of the Bernstein coefficients in an interval, shape (control + 1,)."""
        return np.linspace(0.0, 1.0, self.control + 1) if self.control else np.array([0.5])

    def of_states(self, at: Vector) -> Vector:
        """Weights of the values at 0 and at the points for values at n positions, shape (degree + 1, n)."""
        return _lagrange(np.concatenate([[0.0], self.points]), at)

    def of_algebraic(self, at: Vector) -> Vector:
        """Weights of the values at the points for values at n positions, shape (degree, n)."""
        return _lagrange(self.points, at)

    def blocks(self, block: Vector, intervals: int, overlap: int) -> Any:
        """Matrix for all intervals: copies of `block` along the diagonal, of which `overlap` rows coincide.

        With `block` of shape (r, c) the result has shape (intervals * (r - overlap) + overlap, intervals * c).
        """
        step = block.shape[0] - overlap
        rows, columns, values = [], [], []
        for k in range(intervals):
            for i, j in np.argwhere(block != 0.0).tolist():
                rows.append(k * step + i)
                columns.append(k * block.shape[1] + j)
                values.append(block[i, j])
        size = (intervals * step + overlap, intervals * block.shape[1])
        return ca.DM.triplet(rows, columns, ca.DM(values), *size)


def _lagrange(nodes: Vector, at: Vector) -> Vector:
    """Lagrange polynomials of the nodes at n positions, shape (nodes, n)."""
    found = np.ones((len(nodes), len(at)))
    for i, own in enumerate(nodes):
        for k, other in enumerate(nodes):
            if k != i:
                found[i] *= (at - other) / (own - other)
    return found
