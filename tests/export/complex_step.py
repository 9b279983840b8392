"""Derivatives by complex steps: an SX function evaluated in numpy's complex arithmetic, without CasADi's derivatives.

f(x + i h d) has the imaginary part h f'(x) d + O(h**3): there is no difference of nearly equal numbers, so h = 1e-30
gives the derivative to rounding (W. Squire, G. Trapp, SIAM Review 40 (1998) 110-112). Branches are decided by real
parts: beside a kink, however near, it is the derivative on the side on which the value lies. Functions that are called
(a search for where two bodies touch) answer with derivatives of their own, which their own tests judge.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[Any]

STEP = 1e-30

_PLAIN: Mapping[int, Callable[..., Any]] = {
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_LOG1P: np.log1p,
    ca.OP_EXPM1: np.expm1,
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_HYPOT: lambda a, b: np.sqrt(a * a + b * b),
}
_RELATIONS: Mapping[int, Callable[..., Any]] = {
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_FMIN: np.less_equal,
    ca.OP_FMAX: np.greater_equal,
}
_TRUTHS: Mapping[int, Callable[..., Any]] = {
    ca.OP_NOT: lambda a: a.real == 0,
    ca.OP_AND: lambda a, b: (a.real != 0) & (b.real != 0),
    ca.OP_OR: lambda a, b: (a.real != 0) | (b.real != 0),
    ca.OP_FLOOR: lambda a: np.floor(a.real),
    ca.OP_CEIL: lambda a: np.ceil(a.real),
    ca.OP_SIGN: lambda a: np.sign(a.real),
}


def stepped(function: Any, at: Vector, along: Vector) -> tuple[Vector, Vector]:
    """Values and derivatives of an SX function of one column at n points, each in a direction of its own.

    `at` and `along` have shape (arguments, n), what is returned (results, n).
    """
    n = at.shape[1]
    given = at.astype(complex) + 1j * STEP * along
    results = np.zeros((function.nnz_out(0), n), dtype=complex)
    work: list[Any] = [None] * function.sz_w()
    nodes = ca.vertsplit(function.instructions_sx())
    with np.errstate(all="ignore"):
        for k in range(function.n_instructions()):
            op, places, to = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
            if op == ca.OP_CONST:
                work[to[0]] = np.full(n, function.instruction_constant(k), dtype=complex)
            elif op == ca.OP_INPUT:
                work[to[0]] = given[places[1]]
            elif op == ca.OP_OUTPUT:
                results[to[1]] = work[places[0]]
            elif op == ca.OP_CALL:
                found = _called(nodes[k].which_function(), np.array([work[p] for p in places]))
                for place, row in zip(to, found, strict=True):
                    if place >= 0:
                        work[place] = row
            else:
                work[to[0]] = _applied(op, [work[p] for p in places])
    return results.real, results.imag / STEP


def _applied(op: int, operands: list[Any]) -> Any:
    if op in _PLAIN:
        return _PLAIN[op](*operands)
    a, b = operands[0], operands[-1]
    if op in _RELATIONS:
        truth = _RELATIONS[op](a.real, b.real)
        return np.where(truth, a, b) if op in (ca.OP_FMIN, ca.OP_FMAX) else truth.astype(complex)
    if op in _TRUTHS:
        return _TRUTHS[op](*operands).astype(complex)
    if op == ca.OP_FABS:
        return np.where(a.real < 0, -a, a)
    if op == ca.OP_IF_ELSE_ZERO:
        return np.where(a.real != 0, b, 0)
    if op in (ca.OP_POW, ca.OP_CONSTPOW):
        return _power(a, b)
    if op == ca.OP_ATAN2:
        size = a.real**2 + b.real**2
        return np.arctan2(a.real, b.real) + 1j * (a.imag * b.real - b.imag * a.real) / np.where(size > 0, size, 1)
    raise NotImplementedError(f"operation {op}")


def _called(function: Any, given: Vector) -> Vector:
    """Results of a function that is called, all entries in a row, at n points."""
    n = given.shape[1]
    sizes = [function.nnz_in(k) for k in range(function.n_in())]
    split = [np.split(v, np.cumsum(sizes)[:-1]) for v in (given.real, given.imag / STEP)]
    values, seeds = ([ca.DM(v) if v.size else ca.DM(v.shape[0], n) for v in half] for half in split)
    found = function.map(n).call(values)
    slopes = function.forward(1).map(n).call([*values, *found, *seeds])
    both = [np.array(v) + 1j * STEP * np.array(d) for v, d in zip(found, slopes, strict=True)]
    return np.vstack(both)


def _power(a: Any, b: Any) -> Any:
    """a**b; of a base below zero with a constant whole exponent, by its real power."""
    value = np.power(a.real, b.real)
    slope = b.real * np.power(a.real, b.real - 1) * a.imag
    slope = np.where(a.imag == 0, 0, slope)
    by_exponent = np.where(b.imag == 0, 0, value * np.log(np.where(a.real > 0, a.real, 1)) * b.imag)
    return value + 1j * (slope + by_exponent)
