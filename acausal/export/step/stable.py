"""Test whether an explicit step amplifies a mode, from a few rates near its stages.

The difference v0 of two stages and its products v1 = J v0 and v2 = J J v0 with the Jacobian determine one pair of
modes: v2 == a v1 + b v0 in least squares, with the roots of m^2 - a m - b as eigenvalues (Prony's method, 1795, in the
Krylov space of two vectors). A dominant pair is found whatever the units of the states are. The plain quotient
|v1| / |v0| of E. Hairer, G. Wanner (Solving Ordinary Differential Equations II, IV.2) depends on units: for
x'' = -w^2 x it lies between 1 and w^2.
"""

from __future__ import annotations

from math import factorial
from typing import Any

import casadi as ca

# A step counts as unstable if a mode grows by more than this per radian (or time constant), two percent per
# revolution. Heun's method amplifies undamped oscillations that it resolves well by less.
_GROWTH = 0.003
# Squares of relative magnitudes: below the first a difference of states is a rounding error, below the second two
# vectors count as parallel.
_ROUNDING, _PARALLEL = 1e-24, 1e-12


def differences(rates: Any, reach: Any, a: Any, ka: Any, b: Any) -> tuple[Any, Any, Any]:
    """(v0, J v0, J J v0) for the stages `a`, whose rates are `ka`, and `b`; `rates` is a function of states alone."""
    step = (rates(b) - ka) * reach
    return b - a, step / reach, (rates(a + step) - ka) / reach


def unstable(order: int, h: Any, x: Any, nominal: Any, vectors: tuple[Any, Any, Any]) -> Any:
    """1 if an explicit method whose order and number of stages are `order` amplifies a mode in a step `h`, else 0.

    `vectors`: (v0, J v0, J J v0), see `differences`, shape (nx,) each; `nominal`: nominal magnitudes of the states x.
    """
    v0, v1, v2 = (v / nominal for v in vectors)
    v1, v2 = h * v1, h * h * v2
    is_significant = ca.sumsqr(v0) > _ROUNDING * (1 + ca.sumsqr(x / nominal))
    g00, g01, g11 = ca.sumsqr(v0), ca.dot(v0, v1), ca.sumsqr(v1)
    r0, r1 = ca.dot(v0, v2), ca.dot(v1, v2)
    det = g00 * g11 - g01 * g01
    is_pair = det > _PARALLEL * g00 * g11
    det, g00 = ca.if_else(is_pair, det, 1), ca.if_else(is_significant, g00, 1)
    a = ca.if_else(is_pair, (g00 * r1 - g01 * r0) / det, g01 / g00)
    b = ca.if_else(is_pair, (g11 * r0 - g01 * r1) / det, 0)
    discriminant = a * a / 4 + b
    is_real = discriminant >= 0
    re = ca.if_else(is_real, a / 2 - ca.sqrt(ca.fmax(discriminant, 0)), a / 2)
    im = ca.if_else(is_real, 0, ca.sqrt(ca.fmax(-discriminant, 0)))
    growth = ca.log(amplification(order, re, im)) - ca.fmax(re, 0)
    return ca.logic_and(is_significant, growth > _GROWTH * ca.sqrt(re * re + im * im))


def amplification(order: int, re: Any, im: Any) -> Any:
    """|R(re + i im)| for the exponential series R up to `order`, the stability function of such a method."""
    power: tuple[Any, Any] = (1, 0)
    total: list[Any] = [1, 0]
    for k in range(1, order + 1):
        power = (power[0] * re - power[1] * im, power[0] * im + power[1] * re)
        total = [total[j] + power[j] / factorial(k) for j in range(2)]
    return ca.sqrt(total[0] * total[0] + total[1] * total[1])
