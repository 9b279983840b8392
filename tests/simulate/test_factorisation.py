"""Newton matrices are factorised by what fills least, whatever order the states are declared in."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, reset, variable, when
from acausal.simulate.equations import factorisation as counted
from acausal.simulate.equations.factorisation import FEW, factorisation
from acausal.simulate.equations.scaled import scaled_equations

K = 3.0


def pattern(entries: set[tuple[int, int]], n: int) -> Any:
    """A square pattern with its diagonal."""
    rows, columns = zip(*entries, strict=True)
    return ca.Sparsity.triplet(n, n, list(rows), list(columns)) + ca.Sparsity.diag(n)


def band(n: int, first: int = 0) -> set[tuple[int, int]]:
    return {(first + i, first + i + s) for i in range(n) for s in (-1, 0, 1) if 0 <= i + s < n}


def test_two_fields_behind_each_other_are_no_band_and_take_qr() -> None:
    """Ordered by minimum degree, QR of two coupled chains has a few entries a column; LU as declared fills n by n."""
    n = 300
    coupled = {(i, n + i) for i in range(n)} | {(n + i, i) for i in range(n)}
    assert factorisation(pattern(band(n) | band(n, n) | coupled, 2 * n), 2 * n) is None


@pytest.mark.parametrize("place", [0, 150, 299])
def test_what_all_others_meet_comes_last(place: int) -> None:
    """Eliminated last, the long row and column fill nothing; QR has the product of the row with itself."""
    n = 300
    star = {(i, i) for i in range(n)} | {(place, i) for i in range(n)} | {(i, place) for i in range(n)}
    found = factorisation(pattern(star, n), n)
    assert found is not None
    assert place in found.x[-2:]  # with one leaf left, the two are alike


def test_a_grid_takes_lu_in_a_better_order_than_its_rows() -> None:
    """Fill of a grid of n cells: n log n by minimum degree, n^1.5 row by row (George 1973)."""
    m = 40
    at = {(i, j): m * i + j for i in range(m) for j in range(m)}
    near = {(k, at[i + a, j + b]) for (i, j), k in at.items() for a, b in ((0, 1), (1, 0)) if (i + a, j + b) in at}
    assert factorisation(pattern(near | {(b, a) for a, b in near}, m * m), m * m) is not None


def test_small_models_are_not_counted() -> None:
    assert factorisation(ca.Sparsity.dense(FEW, FEW), FEW) is None


class Hub(Component):
    """n cells that exchange heat with one hub: x' = k (h - x), h' = k (mean of x - h).

    Mean m and hub h: h + m is constant, h - m decays with 2 k, and each cell's distance from the mean with k.
    """

    n: int = acausal.structural(default=100)
    h: Real = variable(default=acausal.fixed(1.0))
    x: list[Any] = acausal.part()

    def build(self) -> None:
        self.x = [Cell(start=i / self.n) for i in range(self.n)]

    def equations(self) -> Equations:
        for cell in self.x:
            yield cell.q == K * (self.h - cell.x)
        yield der(self.h) == -sum(cell.q for cell in self.x) / self.n


class Cell(Component):
    start: Real = acausal.parameter(default=0.0)
    x: Real = variable()
    q: Real = variable()

    def initial_equations(self) -> Equations:
        yield self.x == self.start

    def equations(self) -> Equations:
        yield der(self.x) == self.q


class Implicit(Component):
    """The same with rates that are functions of the root of a cubic equation each, so that all cells have one."""

    n: int = acausal.structural(default=100)
    h: Real = variable(default=acausal.fixed(1.0))
    x: list[Any] = acausal.part()

    def build(self) -> None:
        self.x = [CubicCell(start=i / self.n) for i in range(self.n)]

    def equations(self) -> Equations:
        for cell in self.x:
            yield cell.w**3 + cell.w == K * (self.h - cell.x)
        yield der(self.h) == -sum(cell.q for cell in self.x) / self.n


class CubicCell(Cell):
    w: Real = variable(default=acausal.guess(1.0))

    def equations(self) -> Equations:
        yield self.q == self.w**3 + self.w


class Struck(Hub):
    """The hub is put back to 1 where it has fallen to 0.8."""

    def equations(self) -> Equations:
        yield when(self.h < 0.8, reset(self.h, 1.0))


def exact(t: Any, n: int, i: int, h: float = 1.0, m: float | None = None) -> tuple[Any, Any]:
    """Hub, and cell i, at the time t after a start with these values of hub and mean."""
    mean = (n - 1) / (2.0 * n)
    m = mean if m is None else m
    apart = (h - m) * np.exp(-2.0 * K * t)
    return (h + m + apart) / 2.0, (h + m - apart) / 2.0 + (i / n - mean) * np.exp(-K * t)


@pytest.mark.parametrize(("solver", "model"), [("idas", Hub), ("cvodes", Hub), ("idas", Implicit)])
def test_states_come_back_in_their_own_places(
    solver: str, model: type[Component], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(counted, "_PIVOTING", 0.0)  # LU for the one with algebraic variables, too
    compiled = acausal.compile(model())
    assert len(compiled.algebraic) == (100 if model is Implicit else 0)
    used = scaled_equations(compiled, np.array(compiled.parameter_values), np.zeros(0)).factorisation
    assert used is not None
    assert used.x[0] != 0  # the hub comes late
    result = acausal.simulate(compiled, solver=solver, stop_time=0.5, tolerance=1e-8)
    for i in (0, 17, 99):
        hub, cell = exact(result.time, 100, i)
        np.testing.assert_allclose(result["h"], hub, atol=1e-7)
        np.testing.assert_allclose(result[f"x[{i}].x"], cell, atol=1e-7)
        np.testing.assert_allclose(result[f"x[{i}].q"], K * (hub - cell), atol=1e-6)


def test_an_event_meets_the_states_in_their_own_places() -> None:
    """h = 0.8 where exp(-2 k t) = (1.6 - h - m) / (h - m); from there on the same with h = 1 and what m is."""
    result = acausal.simulate(Struck(), solver="idas", stop_time=0.5, tolerance=1e-8)
    n = 100
    m = (n - 1) / (2.0 * n)
    struck = -np.log((1.6 - 1.0 - m) / (1.0 - m)) / (2.0 * K)
    assert [e.time for e in result.events][:1] == pytest.approx([struck], abs=1e-7)
    after = (result.time > struck + 1e-6) & (result.time < struck + 0.05)
    assert after.any()
    mean = exact(struck, n, 0)[1] + m * np.exp(-K * struck)
    hub, _ = exact(result.time[after] - struck, n, 0, 1.0, mean)
    np.testing.assert_allclose(result["h"][after], hub, atol=1e-6)
