"""Fields of gravity: the acceleration a body feels at its centre of mass.

Modelica's bodies look up the one `World` around them. Here nothing is global: the field is given to the body, as a
parameter (`g_0`, uniform) and, for other fields, as a function.
"""

from __future__ import annotations

from collections.abc import Callable

from acausal import Expr, dot, sqrt

STANDARD_GRAVITY = 9.80665
"""Acceleration of free fall [m/s2] (3rd General Conference on Weights and Measures, 1901)."""

Field = Callable[[Expr, Expr], Expr]
"""A field of gravity: from `g_0` [m/s2] and the place `r_0` [m] to the acceleration [m/s2], all in world axes."""


def uniform_field(g_0: Expr, r_0: Expr) -> Expr:
    """The same acceleration `g_0` everywhere."""
    return g_0


def point_field(mu: float | Expr) -> Field:
    """The field of a mass at the world's origin; `mu` [m3/s2] is its mass times the constant of gravitation."""

    def field(g_0: Expr, r_0: Expr) -> Expr:
        distance = sqrt(dot(r_0, r_0))
        return -mu / (distance * distance * distance) * r_0

    return field
