"""Bounds of expressions contain their values: at random operands within them, and at the exact ends of arithmetic."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.numeric.evaluate import FUNCTIONS
from acausal.numeric.intervals import interval, partial

UNARY = (
    "neg",
    "sqrt",
    "fabs",
    "exp",
    "log",
    "sin",
    "cos",
    "tan",
    "tanh",
    "atan",
    "sinh",
    "cosh",
    "asin",
    "acos",
    "sign",
)
BINARY = ("add", "sub", "mul", "div", "pow", "min", "max", "atan2", "lt", "ge")
ENDS = (-300.0, -2.0, -1.0, -0.3, 0.0, 1e-3, 0.5, 1.0, 3.0, 20.0, 800.0)
EXPONENTS = (-3.0, -2.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0, 4.0)
EXACT: dict[str, Callable[[Fraction, Fraction], Fraction]] = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
}
# Short numbers, of which many are zero, one or whole, and numbers with all digits.
NUMBERS = st.one_of(st.integers(-4, 4).map(float), st.floats(-50.0, 50.0), st.floats(-1e-3, 1e-3))


def _box(rng: np.random.Generator) -> tuple[float, float]:
    low, high = sorted(np.where(rng.random(2) < 0.5, rng.choice(ENDS, 2), rng.normal(0.0, 2.0, 2)))
    return float(low), float(high)


@pytest.mark.parametrize("op", [*UNARY, *BINARY, "constant power", "square"])
def test_values_within_bounds(op: str) -> None:
    """Bounds of a single operation; those of an expression follow by induction."""
    rng = np.random.default_rng(1)
    name = {"constant power": "pow", "square": "mul"}.get(op, op)
    for _ in range(300):
        boxes = [_box(rng) for _ in range(1 if op in UNARY else 2)]
        if op == "constant power":
            boxes[1] = (float(rng.choice(EXPONENTS)),) * 2
        # inside, and at the ends
        points = [np.concatenate((box, rng.uniform(*box, 20), rng.permutation(box))) for box in boxes]
        if op == "square":
            boxes[1], points[1] = boxes[0], points[0]
        low, high = interval(name, [0, 0 if op == "square" else 1][: len(boxes)], boxes)
        with np.errstate(all="ignore"):
            value = FUNCTIONS[name](*points)
        assert np.all(np.isnan(value) | ((low <= value) & (value <= high))), boxes


@given(st.sampled_from(sorted(EXACT)), NUMBERS, NUMBERS)
def test_exact_results_within_bounds(op: str, x: float, y: float) -> None:
    """Bounds of two numbers contain the exact result, and are it if it is a floating-point number."""
    if op == "div" and y == 0.0:
        return
    exact = EXACT[op](Fraction(x), Fraction(y))
    low, high = (Fraction(end) for end in interval(op, [0, 1], [(x, x), (y, y)]))
    assert low <= exact <= high
    if exact == Fraction(float(exact)):
        assert low == exact == high


@pytest.mark.parametrize(
    ("op", "operands", "expected"),
    [
        ("sqrt", [(4.0, 9.0)], (2.0, 3.0)),
        ("pow", [(-3.0, 2.0), (2.0, 2.0)], (0.0, 9.0)),
        ("div", [(1.0, 2.0), (-4.0, -2.0)], (-1.0, -0.25)),
        ("div", [(1.0, 2.0), (2.0, math.inf)], (0.0, 1.0)),
        ("div", [(1.0, 2.0), (-1.0, 1.0)], (-math.inf, math.inf)),
        ("mul", [(0.0, 0.0), (-math.inf, math.inf)], (0.0, 0.0)),
        ("exp", [(-math.inf, math.inf)], (0.0, math.inf)),
        ("fabs", [(-3.0, 2.0)], (0.0, 3.0)),
    ],
)
def test_bounds_by_hand(op: str, operands: list[tuple[float, float]], expected: tuple[float, float]) -> None:
    assert interval(op, list(range(len(operands))), operands) == expected


@pytest.mark.parametrize(
    ("op", "operands", "expected"),
    [
        ("sqrt", [(0.0, 1.0)], False),
        ("sqrt", [(-1e-9, 1.0)], True),
        ("asin", [(-1.0, 1.0)], False),
        ("acos", [(0.0, 1.1)], True),
        ("pow", [(-1.0, 1.0), (3.0, 3.0)], False),
        ("pow", [(-1.0, 1.0), (0.5, 0.5)], True),
        ("exp", [(-1.0, 1.0)], False),
    ],
)
def test_domains(op: str, operands: list[tuple[float, float]], expected: bool) -> None:
    assert partial(op, operands) is expected
