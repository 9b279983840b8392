"""Coefficients of DOP853 and Radau IIA.

Source: E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I (1993), II.5 (DOP853); II (1996),
IV.5 and IV.8 (Radau IIA, and its error by an embedded method).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.integrate

from acausal.arrays import Vector

STAGES = 5
# Stages that the error estimate of order 3 uses.
_OF_ORDER_3 = np.array([0, 2, 4])


@dataclass(frozen=True, eq=False)
class Radau:
    """Radau IIA with s = STAGES: `nodes` (s,), `matrix` (s, s), and error estimates of order s and 3.

    `weights`, shape (2, s), are the weights in both estimates of the differences between stages and start; `real` is
    the real eigenvalue of the inverse of `matrix`.
    """

    nodes: Vector
    matrix: Vector
    weights: Vector
    real: float


def _radau(s: int) -> Radau:
    polynomial: Any = np.polynomial.Polynomial([0.0] * (s - 1) + [1.0]) * np.polynomial.Polynomial([-1.0, 1.0]) ** s
    nodes = np.sort(np.real(polynomial.deriv(s - 1).roots()))
    nodes[-1] = 1.0
    powers = np.vander(nodes, s, increasing=True)
    order = np.arange(1, s + 1)
    matrix = (powers * nodes[:, None] / order) @ np.linalg.inv(powers)
    inverse = np.linalg.inv(matrix)
    eigenvalues = np.linalg.eigvals(inverse)
    real = float(eigenvalues[np.argmin(np.abs(eigenvalues.imag))].real)
    embedded = np.zeros((2, s))
    for row, used in zip(embedded, (order - 1, _OF_ORDER_3), strict=True):
        exact = order[: len(used)]
        row[used] = np.linalg.solve(powers[used, : len(used)].T, 1.0 / exact - (exact == 1) / real)
    return Radau(nodes, matrix, real * (embedded - matrix[-1]) @ inverse, real)


RADAU = _radau(STAGES)
_METHOD: Any = scipy.integrate.DOP853
EXPLICIT_STAGES = 12
EXPLICIT_C: Vector = np.append(_METHOD.C, 1.0)
EXPLICIT_A: Vector = np.vstack([_METHOD.A, _METHOD.B])  # the last row gives the end of the step
EXPLICIT_3: Vector = np.asarray(_METHOD.E3, dtype=float)
EXPLICIT_5: Vector = np.asarray(_METHOD.E5, dtype=float)


def in_c() -> str:
    """The coefficients as C source for `steps.c`."""
    parts = [f"#define STAGES {STAGES}", f"#define RADAU_REAL {RADAU.real!r}"]
    for name, vector in (
        ("RADAU_C", RADAU.nodes),
        ("RADAU_5", RADAU.weights[0]),
        ("RADAU_3", RADAU.weights[1]),
        ("EXPLICIT_C", EXPLICIT_C),
        ("EXPLICIT_B", EXPLICIT_A[-1]),
        ("EXPLICIT_3", EXPLICIT_3),
        ("EXPLICIT_5", EXPLICIT_5),
    ):
        parts.append(f"static const double {name}[] = {{{_listed(vector)}}};")
    for name, matrix in (("RADAU_A", RADAU.matrix), ("EXPLICIT_A", EXPLICIT_A[:-1])):
        rows = ", ".join(f"{{{_listed(row)}}}" for row in matrix)
        parts.append(f"static const double {name}[][{matrix.shape[1]}] = {{{rows}}};")
    return "\n".join(parts) + "\n"


def _listed(vector: Vector) -> str:
    return ", ".join(repr(float(v)) for v in vector)
