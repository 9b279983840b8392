"""Gravity fields: the acceleration of gravity at the centre of mass of a body.

Bodies use the field of the surrounding `World`: its vector `g_0` and, for non-uniform fields, its function `gravity`.
Both may be overridden for individual bodies.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from acausal import Expr, dot, quantity, sqrt
from acausal.errors import DeclarationError

STANDARD_GRAVITY = 9.80665
"""Acceleration of free fall [m/s2] (3rd General Conference on Weights and Measures, 1901)."""

Field = Callable[[Expr, Expr], Expr]
"""A field of gravity: from `g_0` [m/s2] and the position `r_0` [m] to the acceleration [m/s2], all in world axes."""


def uniform_field(g_0: Expr, r_0: Expr) -> Expr:
    """The same acceleration `g_0` everywhere."""
    return g_0


def field_of_world(g_0: Expr, r_0: Expr) -> Expr:
    """Placeholder for the field of the surrounding world; the body replaces it (`PartialHeavy.gravity_at`)."""
    raise DeclarationError(
        "AC110", "field_of_world is only a placeholder", help="leave gravity out, or give World(gravity=...)"
    )


@dataclass(frozen=True)
class PointField:
    """Field of a point mass at the origin of the world, as a comparable and picklable function."""

    mu: float | Expr

    def __call__(self, g_0: Expr, r_0: Expr) -> Expr:
        """Acceleration [m/s2] at `r_0` [m], both of shape (3,); `g_0` is ignored."""
        distance = sqrt(dot(r_0, r_0))
        strength = self.mu if isinstance(self.mu, Expr) else quantity(self.mu, "m3/s2")
        return -strength / (distance * distance * distance) * r_0


def point_field(mu: float | Expr) -> Field:
    """The field of a mass at the world's origin; `mu` [m3/s2] is its mass times the constant of gravitation."""
    return PointField(mu)
