"""Numbers that cancel but for rounding are no pivots: linear systems have as many states as they have modes."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, as_expr, der, structural, variable
from acausal.errors import StructureError

N = 4
Rows = tuple[tuple[float, ...], ...]


class Implicit(Component):
    """E x' = A x + (1, 2, 3, 4) with a singular matrix E, all entries literal numbers."""

    E: Rows = structural(default=())
    A: Rows = structural(default=())
    x: Real = variable(shape=N)

    def equations(self) -> Equations:
        for i in range(N):
            left, right = as_expr(0.0), as_expr(i + 1.0)
            for k in range(N):
                left = left + self.E[i][k] * der(self.x[k])
                right = right + self.A[i][k] * self.x[k]
            yield left == right


def degree(E: Rows, A: Rows) -> int:
    """Degree of det(s E - A), the number of modes; -1 for a singular pencil."""
    points = np.arange(1.0, N + 2)
    values = [round(float(np.linalg.det(s * np.array(E) - np.array(A)))) for s in points]
    found = np.polyfit(points, values, N)
    places = np.flatnonzero(np.abs(found) > 1e-4)
    return N - int(places[0]) if len(places) else -1


@pytest.mark.parametrize("seed", [*range(30), 40, 50, 78, 86, 89, 122, 124])
def test_states_are_as_many_as_modes(seed: int) -> None:
    random = np.random.default_rng(seed)
    rank = int(random.integers(1, N))
    singular = random.integers(-2, 3, (N, rank)) @ random.integers(-2, 3, (rank, N))
    E: Rows = tuple(tuple(float(v) for v in row) for row in singular)
    kept = random.integers(-3, 4, (N, N)) * (random.random((N, N)) < 0.7)
    A: Rows = tuple(tuple(float(v) for v in row) for row in kept)
    modes = degree(E, A)
    if modes < 0:
        with pytest.raises(StructureError):
            acausal.compile(Implicit(E=E, A=A))
    else:
        assert len(acausal.compile(Implicit(E=E, A=A)).states) == modes
