"""Functions rewritten to have finite derivatives: where a base can vanish, and that nothing is left where it cannot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from acausal.export.casadi.finite import finite

# Of x, p and q; and parameters with which the base is zero for x = 0.
VANISHING: dict[str, tuple[Callable[[Any, Any, Any], Any], tuple[float, float]]] = {
    "a floor of zero": (lambda x, p, q: (ca.fmax(x, p) / q) ** 0.7, (0.0, 2.0)),
    "a floor below zero": (lambda x, p, q: ca.fmax(x, p) ** q, (-1.0, 1.5)),
    "a negative floor times a negative number": (lambda x, p, q: ca.sqrt(ca.fmax(x, p) * q), (-1.0, -1.0)),
    "a floor times a negative number": (lambda x, p, q: p * ca.sqrt(-3 * ca.fmax(x, -2)) + q, (1.0, 1.0)),
    "a square less a number": (lambda x, p, q: ca.sqrt((x + 2) ** 2 + p * q), (-4.0, 1.0)),
    "a sum of squares": (lambda x, p, q: ca.sqrt(ca.sqrt(x**2 + p * x**2)) + q, (1.0, 1.0)),
    "a floor above nothing": (lambda x, p, q: ca.sqrt(q * (ca.fmax(x, -2) + 2)) + p * ca.sqrt(x), (1.0, 1.0)),
    "a power of a parameter": (lambda x, p, q: x * p**q, (0.0, 0.5)),
    "an exponent of zero": (lambda x, p, q: x**p + q, (0.0, 1.0)),
    "an exponent below zero": (lambda x, p, q: x ** (-p) + q, (0.5, 1.0)),
    "the same base twice": (lambda x, p, q: x**0.3 + ca.sqrt(x) * x**p + q, (1.2, 1.0)),
    "a power whose third derivative is infinite": (lambda x, p, q: (p * x) ** 2.5 + q, (1.0, 1.0)),
}
# Parameters with which the base is above zero for every x.
STANDING: dict[str, tuple[Callable[[Any, Any, Any], Any], tuple[float, float]]] = {
    "a floor": (lambda x, p, q: (ca.fmax(x, p) / q) ** -0.7, (1e-6, 1e-3)),
    "a sum of squares and a number": (lambda x, p, q: ca.sqrt(x**2 + (q * x) ** 2 + p**2), (1e-3, 2.0)),
    "a hyperbolic cosine": (lambda x, p, q: p * ca.sqrt(ca.cosh(x)) + q, (1.0, 1.0)),
    "a magnitude above a number": (lambda x, p, q: (q * (ca.fabs(x) + p)) ** 0.3, (1.0, 2.0)),
}


def function(expression: Callable[[Any, Any, Any], Any]) -> Any:
    x, p = ca.SX.sym("x"), ca.SX.sym("p", 2)
    return ca.Function("f", [x, p], [expression(x, p[0], p[1])], ["x", "p"], ["y"])


def derivatives(f: Any) -> Any:
    """First and second derivatives by x and p."""
    at = ca.SX.sym("at", 3)
    hessian, slope = ca.hessian(f(at[0], at[1:]), at)
    return ca.Function("d", [at], [ca.densify(slope), ca.densify(hessian)])


@pytest.mark.parametrize("name", VANISHING)
def test_derivatives_where_the_base_vanishes(name: str) -> None:
    expression, p = VANISHING[name]
    own, rewritten = function(expression), finite(function(expression))
    for x in (0.0, 0.3, 1.7):
        assert float(rewritten(x, p)) == pytest.approx(float(own(x, p)), rel=1e-15, abs=0.0, nan_ok=True)
    found = derivatives(rewritten)([0.0, *p])
    assert all(np.isfinite(np.array(v)).all() for v in found)


@pytest.mark.parametrize("name", [*VANISHING, *STANDING])
def test_elsewhere_nothing_changes(name: str) -> None:
    expression, _ = {**VANISHING, **STANDING}[name]
    own, rewritten = function(expression), finite(function(expression))
    for x in (0.4, 1.7):
        for p in ((0.6, 0.9), (1.4, 2.0)):
            for a, b in zip(derivatives(own)([x, *p]), derivatives(rewritten)([x, *p]), strict=True):
                np.testing.assert_allclose(np.array(a), np.array(b), rtol=1e-13)


@pytest.mark.parametrize("name", STANDING)
def test_nothing_is_left_of_the_question_with_numbers_for_parameters(name: str) -> None:
    expression, p = STANDING[name]
    x = ca.SX.sym("x")
    lengths = [
        ca.Function("g", [x], [f(x, ca.SX(ca.DM(p)))]).n_instructions()
        for f in (function(expression), finite(function(expression)))
    ]
    assert lengths[0] == lengths[1]


def test_equal_bases_and_floors_are_asked_about_once() -> None:
    """Two powers of one base: a test of the base, one of its floor, and four operations to put 1 in place of zero."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    base = ca.fmax(x, p)
    f = ca.Function("f", [x, p], [base**-0.2 + base**-1.2], ["x", "p"], ["y"])
    operations = [finite(f).instruction_id(k) for k in range(finite(f).n_instructions())]
    assert operations.count(ca.OP_EQ) == 1
    assert operations.count(ca.OP_LT) == 1
