"""Equal parts at once: a program of columns gives the numbers of CasADi's interpreter, to the last bit."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, cos, der, exp, fixed, parameter, part, sin, structural, tanh
from acausal.simulate.equations.calls.columns import in_columns
from acausal.simulate.native import columns, policy
from acausal.simulate.native.cache import compiler

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


def _part(seed: int, *given: Any) -> Any:
    """One of equal parts: the same operations for the same seed, on other operands."""
    rng, known = random.Random(seed), list(given)
    for _ in range(120):
        if rng.random() < 0.4:
            known.append(rng.choice(UNARY)(rng.choice(known)))
        else:
            known.append(rng.choice(BINARY)(rng.choice(known), rng.choice(known)))
    return sum(known[-60:])


@pytest.mark.parametrize("seed", range(2))
def test_programs_compute_what_casadi_computes(seed: int) -> None:
    """Random functions of 60 equal parts, each with a number of its own, where some values are not finite."""
    x, p = ca.SX.sym("x", 61), ca.SX.sym("p", 60)
    parts = [_part(seed, x[k], x[k + 1], p[k], ca.SX(0.3 + 0.01 * k)) for k in range(60)]
    function = ca.Function("f", [x, p], [ca.vertcat(*parts), parts[3] * parts[4]])
    program = columns.program(function)
    assert program is not None
    assert program.columns < function.n_instructions() / 20
    made: Any = in_columns(function)
    rng = np.random.default_rng(seed)
    for scale in (0.5, 3.0, 0.0):
        given = scale * rng.standard_normal(61), scale * rng.standard_normal(60)
        for told, known in zip(made(*given), function(*given), strict=True):
            np.testing.assert_array_equal(np.array(told), np.array(known))


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
    monkeypatch.setattr(columns, "_LEAST", 500)
    used: list[int] = []
    run: Any = columns.library()

    def counted(program: Any, given: Any, wanted: Any) -> int:
        used.append(1)
        return int(run(program, given, wanted))

    monkeypatch.setattr(columns, "library", lambda: counted)
    together = acausal.simulate(model, **asked)
    counts: Any = together.stats
    assert len(used) == counts["rhs_evaluations"] > 0
    assert counts["steps"] == alone.stats["steps"]
    assert together.final("cells[7].x") == alone.final("cells[7].x")
