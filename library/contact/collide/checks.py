"""Checks of shapes before anything is computed with them; errors name the body."""

from __future__ import annotations

from acausal.errors import DeclarationError
from acausal.library.contact.collide.shapes import Shape


def check_shape(shape: object, body: str) -> None:
    """Raise DeclarationError AC174 unless `shape` is a shape with a volume."""
    if not isinstance(shape, Shape):
        raise DeclarationError(
            "AC174",
            f"the shape of {body} is {shown(shape)}, not a shape",
            help="give a Sphere, Box, Cylinder, Capsule, Cone, PointedDrill, HalfSpace or ConvexHull",
        )
    shape.check(body)


def shown(value: object) -> str:
    """A value as text in an error message, shortened to one line."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
