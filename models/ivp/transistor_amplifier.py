"""A two-stage amplifier: five capacitors, three of which float between two unknown voltages."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Expr, Panel, Real, der, exp, fixed, sin, time, variable


class TransistorAmplifier(Component):
    """Two transistors, five capacitors: eight equations for eight voltages, three of which hide a constraint.

    Because of its exponentials, Jacobian entries of one row change by thirty orders of magnitude between two points.

    Source: P. Rentrop, in E. Hairer, Ch. Lubich, M. Roche, The numerical solution of differential-algebraic systems by
    Runge-Kutta methods, Springer 1989; problem `transamp` of the test set, equations as published.
    """

    U: Real = variable(shape=8, default=fixed((0.0, 3.0, 3.0, 6.0, 3.0, 3.0, 6.0, 0.0)))

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.2, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("U[0]", "U[7]"), title="Input and output"),)

    def equations(self) -> Equations:
        y = self.U
        R_0, R, U_b, alpha = 1e3, 9e3, 6.0, 0.99
        C = [1e-6 * k for k in (1, 2, 3, 4, 5)]
        U_e = 0.1 * sin(200.0 * math.pi * time)

        def g(x: Expr) -> Expr:
            return 1e-6 * (exp(x / 0.026) - 1.0)

        first, second = g(y[1] - y[2]), g(y[4] - y[5])
        yield C[0] * (der(y[1]) - der(y[0])) == (y[0] - U_e) / R_0
        yield C[0] * (der(y[0]) - der(y[1])) == 2.0 * y[1] / R - U_b / R + (1.0 - alpha) * first
        yield C[1] * der(y[2]) == first - y[2] / R
        yield C[2] * (der(y[4]) - der(y[3])) == (y[3] - U_b) / R + alpha * first
        yield C[2] * (der(y[3]) - der(y[4])) == 2.0 * y[4] / R - U_b / R + (1.0 - alpha) * second
        yield C[3] * der(y[5]) == second - y[5] / R
        yield C[4] * (der(y[7]) - der(y[6])) == (y[6] - U_b) / R + alpha * second
        yield C[4] * (der(y[6]) - der(y[7])) == y[7] / R
