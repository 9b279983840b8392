"""What runs share changes no result, keeps no model alive, and is safe where threads share a model.

Expected values: a circle in (x, y) with x'^2 + y'^2 = a^2 is closed form; equal runs are equal to the last bit, because
nothing that is kept may depend on the run before.
"""

from __future__ import annotations

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, guess, parameter, variable, where
from acausal.lower.build import Symbols
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.equations.calls.buffered import BufferedFunction


class Circle(Component):
    """An oscillator with an algebraic variable and a start to be found."""

    a: Real = parameter(default=2.0)
    x: Real = variable(default=guess(0.3))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(0.5))

    def equations(self) -> Equations:
        yield der(self.x) == -self.a * self.y
        yield der(self.y) == self.a * self.x
        yield self.z + self.z * self.z * self.z == where(self.x > 0.0, self.x, 0.0)

    def initial_equations(self) -> Equations:
        yield self.x * self.x + self.y * self.y == 1.0


def _end(compiled: acausal.CompiledModel, a: float) -> tuple[bytes, float, float]:
    run = acausal.simulate(compiled, solver="idas", stop_time=0.5, tolerance=1e-9, parameters={"a": a}, native=False)
    return np.asarray(run["x"]).tobytes(), float(run.final("x")), float(run.final("z"))


def test_runs_do_not_depend_on_those_before() -> None:
    """Parameters changed and changed back, with integrators, starts and equations kept from one run to the next."""
    compiled = acausal.compile(Circle())
    first, x, z = _end(compiled, 2.0)
    for a in (0.5, 1.0, 1.5, 2.5, 3.0):
        assert _end(compiled, a)[1] == pytest.approx(np.cos(0.5 * a), abs=1e-8)
    assert _end(compiled, 2.0)[0] == first
    assert _end(acausal.compile(Circle()), 2.0)[0] == first
    assert x == pytest.approx(np.cos(1.0), abs=1e-8)
    assert z + z**3 == pytest.approx(x, abs=1e-12)


def test_a_model_is_forgotten_with_its_last_holder() -> None:
    gc.freeze()  # what tests before have made is none of this one's, and takes seconds to traverse
    compiled = replace(acausal.compile(Circle()))  # the cache of compiled models holds the one it gave
    _end(compiled, 2.0)
    gone = weakref.ref(compiled)
    del compiled
    gc.collect()
    assert gone() is None


def test_threads_may_share_a_model() -> None:
    compiled = acausal.compile(Circle())
    values = [1.0 + 0.05 * k for k in range(24)]
    with ThreadPoolExecutor(4) as threads:
        found = [end[1] for end in threads.map(lambda a: _end(compiled, a), values)]
    assert found == pytest.approx([np.cos(0.5 * a) for a in values], abs=1e-8)


def test_a_function_that_fails_gives_nothing_of_the_call_before() -> None:
    """Two lines cut by CasADi's QR, which refuses parallel ones: x + y = 3, x - a y = 1."""
    a = ca.SX.sym("a")
    parts = ca.Function("parts", [a], [ca.blockcat([[1, 1], [1, -a]]), ca.vertcat(3, 1)])
    given: Any = ca.MX.sym("given")
    matrix, right = parts(given)
    point: Any = ca.solve(matrix, right, "qr")
    cut = BufferedFunction(ca.Function("cut", [given], [point, given]))
    assert cut(1.0)[0] == pytest.approx([2.0, 1.0])
    assert all(np.isnan(v).all() for v in cut(-1.0))
    assert cut(3.0)[0] == pytest.approx([2.5, 0.5])


def test_what_switches_with_time_is_lowered_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second run of one compiled model takes the expressions of the first."""
    compiled = acausal.compile(ThickBlock())
    first = acausal.simulate(compiled, stop_time=3.0, native=False)
    monkeypatch.setattr(Symbols, "builder", None)
    assert np.array_equal(acausal.simulate(compiled, stop_time=3.0, native=False).matrix, first.matrix)


def test_so_many_points_go_by_columns_and_change_no_bit() -> None:
    # expected: the same function at one point after the other
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    kinked = ca.if_else(x[0] < p, ca.fmax(x[1], 0.0) ** p, ca.sqrt(x[0]) / x[1])
    y = ca.vertcat(kinked, ca.sin(x[0]) * ca.exp(-x[1]), ca.atan2(x[0], x[1]), 3.0, p)
    quick = BufferedFunction(ca.Function("f", [x, p, ca.SX.sym("none", 0)], [y]))
    points = np.random.default_rng(7).normal(size=(5000, 2))
    points[[3, 4, 5]] = [0.0, 0.0], [np.inf, 1.0], [np.nan, -0.0]
    found = quick.many(points, np.array([0.3]), np.zeros((5000, 0)))
    assert any(columns is not None for columns in quick._column_functions.values())
    np.testing.assert_array_equal(found, [quick(point, 0.3, [])[0] for point in points])


def test_a_function_at_many_points() -> None:
    """At any number of points as at one; rows that are padded to a power of two are not seen."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    quick = BufferedFunction(ca.Function("f", [x, p], [ca.vertcat(p * x[0], x[0] - x[1])]))
    for n in (1, 7, 8, 9, 33):
        points = np.column_stack([np.arange(n, dtype=float), np.arange(n) ** 2.0])
        found = quick.many(points, np.array([3.0]))
        assert np.array_equal(found, np.column_stack([3.0 * points[:, 0], points[:, 0] - points[:, 1]]))
