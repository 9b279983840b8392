"""The mechanical connector of three-dimensional bodies, and the meaning of its variables.

Conventions, stated once for the whole library:

- `r_0` is resolved in world axes; `R` turns components in the frame into world components, `v_0 == R @ v`.
- `w` is the angular velocity of the frame relative to the world, resolved in the frame: `der(R) == R @ skew(w)`.
- `f` and `t` are resolved in the frame and positive into the component.

The Modelica library stores the transposed matrix `T`; here the columns of `R` are the frame's axes, seen from the
world, as in robotics.
"""

from __future__ import annotations

from acausal import Connector, Equations, Real, atan2, der, flow, skew, variable

_LOOP = (
    "the cut forces and torques cannot all be determined: a planar loop, or joints that constrain the same motion; "
    "in a planar loop make one joint a RevolutePlanarLoopConstraint"
)


class Frame(Connector):
    """Coordinate system fixed to a body, with the force and torque that are cut there."""

    r_0: Real = variable(unit="m", shape=3, doc="Position of the origin, from the world's origin, in world axes")
    R: Real = variable(shape=(3, 3), overconstrained=True, doc="Rotation matrix, frame components to world components")
    w: Real = variable(unit="rad/s", shape=3, overconstrained=True, doc="Absolute angular velocity, in the frame")
    f: Real = flow(unit="N", shape=3, doc="Cut force, in the frame", hint=_LOOP)
    t: Real = flow(unit="N.m", shape=3, doc="Cut torque, in the frame", hint=_LOOP)

    def rates(self) -> Equations:
        """Derivative of the rotation matrix, so that its nine entries need not be differentiated."""
        yield der(self.R) == self.R @ skew(self.w)

    def residuals(self, other: Frame) -> Equations:
        """Three equations that make two orientations equal, for the cut of a loop.

        Each angle vanishes with one off-diagonal entry of the relative rotation; `atan2` excludes the spurious
        solutions at half a turn, at which the entry vanishes too. (Modelica.Mechanics.MultiBody,
        Frames.Orientation.equalityConstraint.)
        """
        relative = self.R.T @ other.R
        yield atan2(relative[2, 1], relative[0, 0]) == 0
        yield atan2(-relative[2, 0], relative[1, 1]) == 0
        yield atan2(relative[1, 0], relative[2, 2]) == 0
