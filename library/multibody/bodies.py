"""Rigid bodies: mass, inertia and the equations of Newton and Euler.

The equations are those of Modelica.Mechanics.MultiBody.Parts.Body, stated about the origin of frame_a and resolved in
frame_a. A body whose orientation is not determined by a joint becomes the root of its island and integrates a
quaternion.
"""

from __future__ import annotations

from acausal import (
    Equations,
    Expr,
    Real,
    as_expr,
    assert_,
    branch,
    cross,
    der,
    fabs,
    fixed,
    guess,
    identity,
    is_root,
    maximum,
    parameter,
    potential_root,
    variable,
)
from acausal.errors import DeclarationError
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.rotations import quaternion_rates, quaternion_rotation
from acausal.library.multibody.world import PartialHeavy

_FREE = "a body can move freely in this direction and nothing says where it starts: give it r_0, v_0, Q and w_a"


class PartialBody(PartialHeavy):
    """Motion of a rigid body's frame_a.

    A free body starts from `r_0`, `v_0`, `w_a` and the quaternion `Q` (of any length; see `quaternion(R)`). A body
    attached to joints, or to another body, starts from their coordinates; a `Q` that is fixed is refused there (AC130).
    """

    frame_a: Frame = Frame()
    r_0: Real = variable(unit="m", shape=3, doc="Position of frame_a, in world axes", hint=_FREE)
    v_0: Real = variable(unit="m/s", shape=3, doc="Velocity of frame_a, in world axes", hint=_FREE)
    a_0: Real = variable(unit="m/s2", shape=3, doc="Acceleration of frame_a, in world axes")
    w_a: Real = variable(unit="rad/s", shape=3, doc="Angular velocity, in frame_a", hint=_FREE)
    z_a: Real = variable(unit="rad/s2", shape=3, doc="Angular acceleration, in frame_a")
    Q: Real = variable(
        unit="1",
        shape=4,
        default=guess((0.0, 0.0, 0.0, 1.0)),
        doc="Quaternion, vector part first; unused unless a root",
    )

    def ties(self) -> Equations:
        yield potential_root(self.frame_a)

    def equations(self) -> Equations:
        a = self.frame_a
        yield self.r_0 == a.r_0
        yield self.v_0 == der(self.r_0)
        yield self.a_0 == der(self.v_0)
        yield self.w_a == a.w
        yield self.z_a == der(self.w_a)
        if is_root(a):
            yield a.R == quaternion_rotation(self.Q)
            yield der(self.Q) == quaternion_rates(self.Q, self.w_a)
        else:
            self._refuse_orientation()
            yield self.Q == (0.0, 0.0, 0.0, 1.0)

    def _refuse_orientation(self) -> None:
        """Raise AC130 if the start of `Q` is fixed, which would be without effect."""
        if isinstance(self.__dict__["_given"].get("Q"), type(fixed(0.0))):
            raise DeclarationError(
                "AC130",
                "Q is given, but this orientation follows from the parts that the body is fixed to",
                cause="another body of the same assembly has the quaternion as its states, or joints to the world do",
                help="leave Q out; give start values to the joints, or Q to that body (a note names starts not given)",
            )

    def newton_euler(self, m: Expr, r_CM: Expr, tensor: Expr, force: Expr, torque: Expr) -> Equations:
        """The six equations of motion, and the assertion that the inertia tensor is valid.

        Parameters
        ----------
        m, r_CM, tensor
            Mass [kg], centre of mass [m] in frame_a, inertia [kg.m2] about it, 3x3, along the axes of frame_a.
        force, torque
            All loads on the body except gravity [N, N.m], about the origin of frame_a, in frame_a.
        """
        yield assert_(_is_inertia(tensor), "the inertia tensor is not symmetric and positive semidefinite")
        a, w, z = self.frame_a, self.w_a, self.z_a
        if is_root(a):  # joints may prevent rotation about those axes whose moments no masses could have
            of_mass = identity(3) * ((tensor[0, 0] + tensor[1, 1] + tensor[2, 2]) / 2) - tensor
            yield assert_(_is_inertia(of_mass), _NO_MASSES, level="warning")
        g = self.gravity_at(self.r_0 + a.R @ r_CM)
        of_centre = cross(z, r_CM) + cross(w, cross(w, r_CM))
        # In the axes in which the equation is explicit: a free body is solved for its acceleration, others for force.
        if is_root(a):
            yield a.R @ force == m * (self.a_0 - g + a.R @ of_centre)
        else:
            yield force == m * (a.R.T @ (self.a_0 - g) + of_centre)
        # Written with the force rather than mass times acceleration, so that a free body's z is the only unknown here.
        yield torque == tensor @ z + cross(w, tensor @ w) + cross(r_CM, force)


class PartialMassiveBody(PartialBody):
    """A body whose mass, centre and inertia are given."""

    m: Real = parameter(unit="kg", min=0.0, doc="Mass")
    r_CM: Real = parameter(default=(0.0, 0.0, 0.0), unit="m", shape=3, doc="Centre of mass, in frame_a")
    I_11: Real = parameter(default=0.001, unit="kg.m2", min=0.0, doc="Inertia about the centre of mass, along frame_a")
    I_22: Real = parameter(default=0.001, unit="kg.m2", min=0.0, doc="Inertia about the centre of mass, along frame_a")
    I_33: Real = parameter(default=0.001, unit="kg.m2", min=0.0, doc="Inertia about the centre of mass, along frame_a")
    I_21: Real = parameter(default=0.0, unit="kg.m2", doc="Element of the inertia tensor")
    I_31: Real = parameter(default=0.0, unit="kg.m2", doc="Element of the inertia tensor")
    I_32: Real = parameter(default=0.0, unit="kg.m2", doc="Element of the inertia tensor")

    def inertia_tensor(self) -> Expr:
        """The inertia about the centre of mass [kg.m2], 3x3, in axes parallel to frame_a."""
        return as_expr(
            (
                (self.I_11, self.I_21, self.I_31),
                (self.I_21, self.I_22, self.I_32),
                (self.I_31, self.I_32, self.I_33),
            )
        )


class Body(PartialMassiveBody):
    """Rigid body with one frame.

    The tensor elements I_ij are taken about the centre of mass, along the axes of frame_a, as in Modelica.
    """

    def equations(self) -> Equations:
        a = self.frame_a
        yield from self.newton_euler(self.m, self.r_CM, self.inertia_tensor(), a.f, a.t)


class PartialTwoFrameBody(PartialBody):
    """A body with a second frame, parallel to the first.

    Unlike in Modelica, it does not consist of a Body and a FixedTranslation, which halves the unknowns of a chain.
    """

    frame_b: Frame = Frame()
    r: Real = parameter(unit="m", shape=3, doc="From frame_a to frame_b, in frame_a")

    def ties(self) -> Equations:
        yield branch(self.frame_a, self.frame_b)

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        yield b.r_0 == a.r_0 + a.R @ self.r
        yield b.R == a.R
        yield b.w == a.w

    def balance(self, m: Expr, r_CM: Expr, tensor: Expr) -> Equations:
        """The equations of motion with loads at both frames."""
        a, b = self.frame_a, self.frame_b
        yield from self.newton_euler(m, r_CM, tensor, a.f + b.f, a.t + b.t + cross(self.r, b.f))


class BodyShape(PartialTwoFrameBody, PartialMassiveBody):
    """Rigid body with two frames; frame_b is at `r`."""

    def equations(self) -> Equations:
        yield from self.balance(self.m, self.r_CM, self.inertia_tensor())


def _is_inertia(tensor: Expr) -> Expr:
    """Whether the tensor is symmetric with non-negative principal minors, up to rounding errors.

    The triangle inequality of principal inertias is not required: idealised bodies violate it, such as the motors of
    Modelica's robot with a moment about one axis only, and their motion is determined nevertheless. For a freely moving
    body, a violation is noted.
    """
    (a, b, c), (f, d, e), (g, h, i) = ([tensor[j, k] for k in range(3)] for j in range(3))
    size = fabs(a) + fabs(d) + fabs(i)
    determinant = a * (d * i - e * h) - b * (f * i - e * g) + c * (f * h - d * g)
    minors = (a * d - b * f, a * i - c * g, d * i - e * h)
    lopsided = maximum(fabs(b - f), maximum(fabs(c - g), fabs(e - h)))
    is_positive = (a >= -_ROUNDING * size) & (d >= -_ROUNDING * size) & (i >= -_ROUNDING * size)
    for minor in minors:
        is_positive = is_positive & (minor >= -_ROUNDING * size * size)
    return is_positive & (determinant >= -_ROUNDING * size**3) & (lopsided <= _ROUNDING * size)


_ROUNDING = 1e-9
_NO_MASSES = "no masses have this inertia: a principal moment is larger than the sum of the two others"
