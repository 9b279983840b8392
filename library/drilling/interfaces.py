"""Partial component of the kinematic and the dynamic drilling force."""

from __future__ import annotations

import math

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    assert_,
    connect,
    der,
    dot,
    initial,
    no_event,
    parameter,
    part,
    signal_output,
    sin,
    structural,
)
from acausal.errors import DeclarationError
from acausal.library.contact.collide.checks import check_shape
from acausal.library.contact.scene.checks import check_pose
from acausal.library.drilling.cutting import PartialCuttingForce
from acausal.library.drilling.geometry import DrillGeometry, PartialDrillGeometry
from acausal.library.drilling.geometry_convex import ConvexDrillGeometry, ConvexLevel, PlateLevel
from acausal.library.drilling.materials import STEEL_34CRMO4, Material
from acausal.library.drilling.tool import TWIST_DRILL_16MM, Tool
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import Vector


class PartialDrillingForce(Component):
    """Force between a drill and one plate; subclasses add the force block.

    `frame_a` belongs to the body of the drill, `frame_w` to the entry face of the workpiece (`Workpiece.frame_b`).
    The dimensions of the plate are bound to those of the workpiece. Tool and material are records that provide
    defaults; every number can also be set individually.

    With a `ConvexLevel` the workpiece is any convex body, and `frame_w` is its frame.
    """

    frame_a: Frame = Frame()
    frame_w: Frame = Frame()

    tool: Tool = structural(default=TWIST_DRILL_16MM, doc="Record that gives d, sigma, z_E")
    material: Material = structural(default=STEEL_34CRMO4, doc="Record that gives k_c11, z")
    axis_a: Vector = structural(default=(0.0, 0.0, 1.0), doc="Direction from shank to tip, resolved in frame_a")
    level: PlateLevel | ConvexLevel = structural(default=PlateLevel(), doc="Level of detail of the geometry")
    d: Real = parameter(default=lambda self: self.tool.d, unit="m", min=1e-6, max=10.0, doc="Diameter of the drill")
    sigma: Real = parameter(
        default=lambda self: self.tool.sigma, unit="rad", min=0.01, max=math.pi, doc="Point angle of the drill"
    )
    z_E: Real = parameter(default=lambda self: float(self.tool.z_E), unit="1", min=1.0, doc="Number of cutting edges")
    length: Real = parameter(default=0.0, unit="m", doc="Distance from frame_a to the tip along the axis")
    k_c11: Real = parameter(
        default=lambda self: self.material.k_c11, unit="Pa", min=0.0, doc="Specific cutting force at h = b = 1 mm"
    )
    z: Real = parameter(
        default=lambda self: self.material.z, unit="1", min=0.0, max=1.0, doc="Exponent of the chip thickness"
    )
    h_min: Real = parameter(
        default=1e-6, unit="m", min=1e-15, max=1e-3, doc="Chip thickness below which k_c stays constant"
    )
    K_rake: Real = parameter(default=1.0, unit="1", min=0.0, doc="Correction of k_c for the rake angle")
    K_wear: Real = parameter(default=1.0, unit="1", min=0.0, doc="Correction of k_c for wear")
    K_speed: Real = parameter(default=1.0, unit="1", min=0.0, doc="Correction of k_c for the cutting speed")
    feed_force_factor: Real = parameter(
        default=lambda self: sin(self.sigma), unit="1", min=0.0, doc="F_f / F_c; sin(sigma) as printed in the paper"
    )
    t: Real = parameter(unit="m", min=1e-6, doc="Thickness of the plate")
    width: Real = parameter(default=0.1, unit="m", min=0.0, doc="Extent of the plate along x of frame_w")
    height: Real = parameter(default=0.1, unit="m", min=0.0, doc="Extent of the plate along y of frame_w")

    geometry: PartialDrillGeometry = part()

    s: Real = signal_output(unit="m", nominal=1e-3, doc="Depth of the tip behind the entry face, along the drill axis")
    d_O: Real = signal_output(unit="m", nominal=1e-3, doc="Outer diameter of the engaged part of the edges")
    d_I: Real = signal_output(unit="m", nominal=1e-3, doc="Inner diameter of the engaged part of the edges")
    n: Real = signal_output(unit="1/s", doc="Rotational speed, without sign")
    f_z: Real = signal_output(unit="m", nominal=1e-4, doc="Feed per edge and revolution")
    k_c: Real = signal_output(unit="Pa", nominal=1e9, doc="Specific cutting force")
    F_c: Real = signal_output(unit="N", nominal=1e3, doc="Cutting force")
    F_f: Real = signal_output(unit="N", nominal=1e3, doc="Feed force: on the drill along its axis, against the feed")
    torque: Real = signal_output(unit="N.m", nominal=10.0, doc="Cutting torque, without sign")
    v_axial: Real = signal_output(
        unit="m/s", nominal=1e-3, doc="Velocity of the tip relative to the plate, along the axis"
    )

    def build(self) -> None:
        level = self.level
        if not isinstance(level, PlateLevel | ConvexLevel):
            raise DeclarationError(
                "AC173",
                f"the level of the drill's geometry is {level!r}",
                help="give PlateLevel() or ConvexLevel(shape, pose, name)",
            )
        self.geometry = self._convex(level) if isinstance(level, ConvexLevel) else self._plate()

    def _plate(self) -> DrillGeometry:
        return DrillGeometry(
            body=self.level.name,
            axis_a=self.axis_a,
            d=self.d,
            sigma=self.sigma,
            length=self.length,
            t=self.t,
            width=self.width,
            height=self.height,
        )

    def _convex(self, level: ConvexLevel) -> ConvexDrillGeometry:
        check_shape(level.shape, level.name)
        check_pose(level.pose, level.name)
        lowest, highest = level.shape.bounding_box()
        self.t = min(highest[2] - lowest[2], 1e3)
        return ConvexDrillGeometry(
            axis_a=self.axis_a,
            d=self.d,
            sigma=self.sigma,
            length=self.length,
            workpiece=level.shape,
            pose=level.pose,
            body=level.name,
        )

    def corrected_k_c11(self) -> Expr:
        """The constant of Kienzle's law with the corrections for rake angle, wear and cutting speed [Pa].

        The factors multiply each other and the specific cutting force: O. Kienzle, H. Victor, VDI-Z 94 (1952)
        299-305. See `corrections.py` for their values.
        """
        return self.k_c11 * self.K_rake * self.K_wear * self.K_speed

    def linked(self, force: PartialCuttingForce) -> Equations:
        """Equations that connect `force` to the geometry and to the result variables."""
        geometry = self.geometry
        yield connect(self.frame_a, geometry.frame_a, force.frame_a)
        yield connect(self.frame_w, geometry.frame_w, force.frame_w)
        yield connect(geometry.tip, force.tip)
        yield connect(geometry.axis, force.axis)
        yield connect(geometry.d_O, force.d_O)
        yield connect(geometry.d_I, force.d_I)
        yield connect(geometry.omega, force.omega)
        yield connect(geometry.n, force.n)

        yield self.s == geometry.s
        yield self.d_O == geometry.d_O
        yield self.d_I == geometry.d_I
        yield self.n == geometry.n
        yield self.f_z == force.f_z
        yield self.k_c == force.k_c
        yield self.F_c == force.F_c
        yield self.F_f == force.F_f
        yield self.torque == force.torque
        yield assert_(
            ~initial() | no_event(self.feed_force_factor > _FEEBLE),
            "AC196: the feed force is less than a fifth of the cutting force, since its factor sin(sigma), as printed "
            "in the paper, vanishes for a flat drill: such a drill falls through; set feed_force_factor, in most of "
            "the literature sin(sigma/2)",
            level="warning",
        )
        # The position of the tip is resolved in frame_w, so its derivative is the velocity relative to the plate.
        yield self.v_axial == dot(geometry.axis, der(geometry.tip))


_FEEBLE = 0.2
"""Ratio of feed force to cutting force below which a drill is hardly held: point angles above 168 degrees."""
