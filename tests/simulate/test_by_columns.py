"""Equal parts at once: a program of columns gives CasADi's numbers to the last bit."""

from __future__ import annotations

import ctypes
import math
import random
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, cos, der, exp, fixed, parameter, part, sin, structural, tanh
from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.equations.calls.columns import by_columns
from acausal.simulate.equations.calls.in_columns import in_columns
from acausal.simulate.equations.calls.raw import Kept
from acausal.simulate.native import policy
from acausal.simulate.native.cache import compiler
from acausal.simulate.native.columns import tangents, translation
from acausal.simulate.native.program import address

pytestmark = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")

NAMES = (
    "exp log sqrt sin cos tan asin acos atan floor ceil fabs sign sinh cosh tanh logic_not",
    "fmin fmax atan2 fmod copysign hypot power logic_and logic_or",
)
UNARY: list[Callable[[Any], Any]] = [
    *(getattr(ca, name) for name in NAMES[0].split()),
    *(lambda v: -v, lambda v: v * v, lambda v: 2 * v, lambda v: 1 / v),
]
BINARY: list[Callable[[Any, Any], Any]] = [
    *(getattr(ca, name) for name in NAMES[1].split()),
    *(lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: a / b),
    *(lambda a, b: a < b, lambda a, b: a <= b, lambda a, b: a == b, lambda a, b: a != b),
    lambda a, b: ca.if_else(a > b, b, 0),
]


def _part(seed: int, *given: Any, length: int = 120) -> Any:
    """One of equal parts: the same operations for the same seed, on other operands."""
    rng, known = random.Random(seed), list(given)
    for _ in range(length):
        if rng.random() < 0.4:
            known.append(rng.choice(UNARY)(rng.choice(known)))
        else:
            known.append(rng.choice(BINARY)(rng.choice(known), rng.choice(known)))
    return sum(known[-length // 2 :])


@pytest.mark.parametrize("seed", range(2))
def test_programs_compute_what_casadi_computes(seed: int) -> None:
    """Random functions of 60 equal parts, each with a number of its own, where some values are not finite."""
    x, p = ca.SX.sym("x", 61), ca.SX.sym("p", 60)
    parts = [_part(seed, x[k], x[k + 1], p[k], ca.SX(0.3 + 0.01 * k)) for k in range(60)]
    function = ca.Function("f", [x, p], [ca.vertcat(*parts), parts[3] * parts[4]])
    program = translation.program(function)
    assert program is not None
    assert program.columns < function.n_instructions() / 20
    made: Any = in_columns(function)
    rng = np.random.default_rng(seed)
    for scale in (0.5, 3.0, 0.0):
        given = scale * rng.standard_normal(61), scale * rng.standard_normal(60)
        for told, known in zip(made(*given), function(*given), strict=True):
            np.testing.assert_array_equal(np.array(told), np.array(known))


def _derivatives(function: Any, *given: Any) -> tuple[Any, int]:
    """The derivatives of the first result by the first argument, and how many of them are not zero everywhere."""
    program, library = translation.program(function), translation.library()
    assert program is not None
    assert library is not None
    found = tangents.jacobian(program, 0, function.numel_out(0), function.numel_in(0))
    arguments = (ctypes.c_void_p * len(given))(*(address(g) for g in given))
    numbers = np.zeros(found.sparsity.nnz())
    library.acausal_columns(ctypes.byref(program), arguments, (ctypes.c_void_p * function.n_out())())
    library.acausal_tangents(ctypes.byref(found.tangents), ctypes.c_void_p(address(numbers)))
    return ca.DM(found.sparsity, numbers).full(), found.sparsity.nnz()


def test_derivatives_are_those_that_casadi_writes_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of random functions, where they and CasADi's derivatives are finite; no entry is stored that is always zero."""
    monkeypatch.setattr(translation, "_LEAST", 500)
    x, p = ca.SX.sym("x", 41), ca.SX.sym("p", 40)
    compared = 0
    for seed in range(6):
        parts = [_part(seed, x[k], x[k + 1], p[k], ca.SX(0.3 + 0.01 * k), length=30) for k in range(40)]
        function = ca.Function("f", [x, p], [ca.vertcat(*parts, parts[3] * parts[4], p[0]), parts[0]])
        oracle = ca.Function("oracle", [x, p], [ca.jacobian(function(x, p)[0], x)])
        rng = np.random.default_rng(seed)
        for scale in (0.3, 0.6, 3.0):
            given = scale * (0.1 + rng.random(41)), scale * rng.standard_normal(40)
            told, count = _derivatives(function, *given)
            known = oracle(*given).full()
            finite = np.isfinite(known).all(axis=1) & np.isfinite(function(*given)[0].full().ravel())
            compared += int((known[finite] != 0.0).sum())
            size = np.abs(known[finite]).max(initial=0.0)
            np.testing.assert_allclose(told[finite], known[finite], rtol=1e-9, atol=1e-12 * size)
            assert count <= oracle.sparsity_out(0).nnz()
    assert compared > 300


def test_what_is_not_chosen_has_no_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slope of a root at zero is infinite: `x > 1 ? sqrt(x) : 0` is as flat at zero as it looks."""
    monkeypatch.setattr(translation, "_LEAST", 1)
    x = ca.SX.sym("x", 20)
    chosen = ca.vertcat(*(ca.if_else(x[k] > 1, x[k], 0) for k in range(20)))
    told, _ = _derivatives(ca.Function("f", [x], [ca.sqrt(chosen)]), np.array([0.0] * 19 + [4.0]))
    np.testing.assert_array_equal(told, np.diag([0.0] * 19 + [0.25]))


@pytest.mark.parametrize("operation", range(len(UNARY) + len(BINARY)))
def test_derivatives_of_each_operation(operation: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against differences, at points where the operation is smooth."""
    monkeypatch.setattr(translation, "_LEAST", 1)
    x = ca.SX.sym("x", 40)
    made = UNARY[operation](x[:20]) if operation < len(UNARY) else BINARY[operation - len(UNARY)](x[:20], x[20:])
    function = ca.Function("f", [x], [made])
    rng = np.random.default_rng(operation)
    here = np.concatenate([0.1 + 0.8 * rng.random(20), -0.1 - 0.8 * rng.random(20)])
    if operation < len(UNARY) or function.instruction_id(40) in (ca.OP_POW, ca.OP_FMOD):
        here = np.abs(here)
    step = 1e-6
    sides = [np.array([function(here + s * one).full().ravel() for one in np.eye(40)]).T for s in (step, -step)]
    told, _ = _derivatives(function, here)
    np.testing.assert_allclose(told, (sides[0] - sides[1]) / (2 * step), rtol=1e-6, atol=1e-7)


class Cell(Component):
    """A cell with a long law of its own, beside two others."""

    a: Real = parameter(default=1.0)
    x: Real = acausal.variable(default=fixed(0.1))
    left: Real = acausal.variable()

    def equations(self) -> Equations:
        v = self.x
        for k in range(4):
            v = sin(self.a * v + 0.1 * k) + 0.1 * tanh(v) * cos(v - self.left) + exp(-v * v)
        yield der(self.x) == v - self.x


class Row(Component):
    n: int = structural(default=12)
    cells: list[Cell] = part()

    def build(self) -> None:
        self.cells = [Cell(a=1.0 + 0.01 * k) for k in range(self.n)]

    def equations(self) -> Equations:
        for k, cell in enumerate(self.cells):
            yield cell.left == self.cells[k - 1].x


@pytest.mark.parametrize("solver", ["cvodes", "idas"])
def test_a_run_by_columns_takes_the_same_steps(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = acausal.compile(Row())
    asked: dict[str, Any] = {"stop_time": 1.0, "solver": solver, "tolerance": 1e-7}
    alone = acausal.simulate(model, native=False, **asked)
    monkeypatch.setattr(policy, "_REPAID", 0.0)
    monkeypatch.setattr(translation, "_LEAST", 500)
    used: list[int] = []
    library: Any = translation.library()

    class Counted:
        """The library that counts evaluations."""

        @staticmethod
        def acausal_columns(program: Any, given: Any, wanted: Any) -> int:
            used.append(1)
            return int(library.acausal_columns(program, given, wanted))

    monkeypatch.setattr(translation, "library", lambda: Counted)
    together = acausal.simulate(model, **asked)
    counts: Any = together.stats
    assert len(used) == counts["rhs_evaluations"] > 0
    assert counts["steps"] == alone.stats["steps"]
    assert together.final("cells[7].x") == alone.final("cells[7].x")


ROWS = np.array([-1.0, -0.0, 0.0, 1.0, math.nan, math.inf, -math.inf, 2.5, 3.0])


@pytest.mark.parametrize("number", [2.5, 0.0, -3.0, math.inf, -math.inf, math.nan])
def test_extrema_are_those_of_c(number: float) -> None:
    rows = ROWS[np.isfinite(ROWS)] if math.isnan(number) else ROWS
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    values = ca.vertcat(ca.fmax(x, p), ca.fmin(p, x), ca.fmax(0, x), ca.fmin(x, 0), ca.fmax(x, 2), ca.fmax(x, -x))
    function = by_columns(ca.Function("f", [x, p], [values]), len(rows), [1])
    assert function is not None
    others = (np.fmax, number), (np.fmin, number), (np.fmax, 0.0), (np.fmin, 0.0), (np.fmax, 2.0), (np.fmax, -rows)
    expected = np.column_stack([extremum(rows, other) for extremum, other in others])
    np.testing.assert_array_equal(np.array(function(rows, number)), expected)


def test_rows_are_the_function_at_each_instant() -> None:
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    function = ca.Function("f", [ca.SX.sym("t"), x, p], [ca.vertcat(x * p[0], ca.sin(p[1]))])
    points = np.arange(12.0).reshape(4, 3)
    found = rows(function, (np.zeros((4, 1)), points, np.array([2.0, 0.5])))
    np.testing.assert_array_equal(found, np.hstack([2.0 * points, np.full((4, 1), np.sin(0.5))]))


def test_rows_take_transposed_views_and_empty_arguments() -> None:
    x = ca.SX.sym("x", 2)
    function = ca.Function("f", [x, ca.SX.sym("z", 0)], [x[0] - x[1]])
    trajectory = np.array([[1.0, 2.0, 3.0], [0.5, 0.5, 0.5]])
    assert rows(function, (trajectory.T, np.zeros((3, 0)))).tolist() == [[0.5], [1.5], [2.5]]


def integrator(end: float = 0.75, **options: float) -> ca.Function:
    """x' = x*x, which is 1/(1 - t) from 1: infinite at t = 1."""
    x, none = ca.SX.sym("x"), ca.SX(0, 1)
    arguments = [ca.SX.sym("t"), x, *(ca.SX.sym(name, 0) for name in "zpu")]
    dae = ca.Function("dae", arguments, [x * x, none, none, none], ["t", *"xzpu"], ["ode", "alg", "quad", "zero"])
    return ca.integrator("run", "cvodes", dae, 0.0, [0.5, end], dict(options))


def test_integrators_give_states_and_statistics() -> None:
    (x, z), stats = Kept(integrator(reltol=1e-10, abstol=1e-12))({"x0": np.ones(1)}, ("xf", "zf"))
    np.testing.assert_allclose(x, [[2.0], [4.0]], rtol=1e-7)
    assert z.shape == (2, 0)
    assert stats["nsteps"] > 10


def test_a_failure_is_a_runtime_error() -> None:
    with pytest.raises(RuntimeError, match="CVode"):
        Kept(integrator(end=2.0, max_num_steps=500))({"x0": np.ones(1)}, ("xf",))
