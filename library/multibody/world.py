"""The inertial frame."""

from __future__ import annotations

from acausal import Component, Equations, Expr, Real, identity, outer, parameter, root, structural
from acausal.errors import DeclarationError
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.gravity import STANDARD_GRAVITY, Field, PointField, field_of_world, uniform_field
from acausal.library.multibody.orientation import Vector, unit_vector


class World(Component):
    """World frame and gravity.

    Components with a weight refer to the surrounding world (`outer`), as bodies in Modelica do, so one World in the
    model suffices. Without one, a World with these defaults is added, with a note.
    """

    frame_b: Frame = Frame()
    n: Vector = structural(default=(0.0, -1.0, 0.0), doc="Direction of gravity in world axes")
    g: Real = parameter(default=STANDARD_GRAVITY, unit="m/s2", doc="Acceleration of gravity")
    g_0: Real = parameter(
        default=lambda self: tuple(self.g * e for e in unit_vector(self.n)),
        unit="m/s2",
        shape=3,
        doc="Vector of gravity in world axes",
    )

    gravity: Field = structural(default=uniform_field, doc="Field of gravity; the uniform one is g_0 everywhere")

    def ties(self) -> Equations:
        yield root(self.frame_b)

    def equations(self) -> Equations:
        _refuse_idle(self, self.gravity, "g_0", "g", "n")
        yield self.frame_b.r_0 == 0
        yield self.frame_b.R == identity(3)
        yield self.frame_b.w == 0


class PartialHeavy(Component):
    """Component with a weight, which takes the gravity of the surrounding world."""

    world: World = outer(World, default=World(), doc="World whose gravity acts")
    g_0: Real = parameter(
        default=lambda self: self.world.g_0, unit="m/s2", shape=3, doc="Vector of gravity in world axes"
    )
    gravity: Field = structural(default=field_of_world, doc="Field of gravity; that of the world unless given")

    def gravity_at(self, r_0: Expr) -> Expr:
        """Acceleration of gravity [m/s2] at `r_0` [m], both in world axes, shape (3,); to be called in `equations`."""
        field = self.world.gravity if self.gravity is field_of_world else self.gravity
        _refuse_idle(self, field, "g_0")
        return field(self.g_0, r_0)


def _refuse_idle(component: Component, field: Field, *names: str) -> None:
    """Raise AC130 if one of the parameters `names` is given without effect: in the field of a point mass, or by g_0."""
    given = component.__dict__["_given"]
    idle = next((name for name in names if name in given), None)
    if isinstance(field, PointField) and idle is not None:
        raise DeclarationError(
            "AC130",
            f"{type(component).__name__}: {idle} is given, but has no effect in the field of a point mass",
            cause="it defines a uniform field; this one depends only on its mass and the position",
            help=f"leave {idle} out, or also give another field: gravity=uniform_field",
        )
    beside = next((name for name in names if name in given and name != "g_0"), None)
    if "g_0" in given and beside is not None:
        raise DeclarationError(
            "AC130",
            f"{type(component).__name__}: {beside} is given, but has no effect beside g_0",
            cause="g_0 is the whole vector of gravity; without it, the vector is g along n",
            help=f"leave {beside} or g_0 out",
        )
