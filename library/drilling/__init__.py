"""Drilling: geometry of drill and plate, drilled depth, cutting and contact force, tools and materials.

A compliant drilling-force model for multibody scenes, in the three blocks of the founding paper (its Figure 3):
`DrillGeometry`, `DrillDepthCalculation` and `DrillContactForce` make `DrillingForce`. See docs/drilling.md.
"""

from __future__ import annotations

from acausal.library.drilling.corrections import RAKE_ALUMINIUM as RAKE_ALUMINIUM
from acausal.library.drilling.corrections import RAKE_CAST_IRON as RAKE_CAST_IRON
from acausal.library.drilling.corrections import RAKE_STEEL as RAKE_STEEL
from acausal.library.drilling.corrections import SPEED_CARBIDE as SPEED_CARBIDE
from acausal.library.drilling.corrections import SPEED_HSS as SPEED_HSS
from acausal.library.drilling.corrections import WORN as WORN
from acausal.library.drilling.corrections import rake_correction as rake_correction
from acausal.library.drilling.depth import DrillDepthCalculation as DrillDepthCalculation
from acausal.library.drilling.drilling_force import DrillingForce as DrillingForce
from acausal.library.drilling.drives import FeedCap as FeedCap
from acausal.library.drilling.drives import FeedDrive as FeedDrive
from acausal.library.drilling.drives import Spindle as Spindle
from acausal.library.drilling.energy import EnergyBalance as EnergyBalance
from acausal.library.drilling.flank import FlankContact as FlankContact
from acausal.library.drilling.flank import GuidedDrillingForce as GuidedDrillingForce
from acausal.library.drilling.force import DrillContactForce as DrillContactForce
from acausal.library.drilling.force_control import ForceControl as ForceControl
from acausal.library.drilling.force_control import feed_rate_under as feed_rate_under
from acausal.library.drilling.friction import MarginFriction as MarginFriction
from acausal.library.drilling.friction import TipFriction as TipFriction
from acausal.library.drilling.full_drilling_force import FullDrillingForce as FullDrillingForce
from acausal.library.drilling.geometry import DrillGeometry as DrillGeometry
from acausal.library.drilling.geometry_convex import ConvexDrillGeometry as ConvexDrillGeometry
from acausal.library.drilling.geometry_convex import ConvexLevel as ConvexLevel
from acausal.library.drilling.geometry_convex import PlateLevel as PlateLevel
from acausal.library.drilling.kinematic import KinematicCuttingForce as KinematicCuttingForce
from acausal.library.drilling.kinematic import KinematicDrillingForce as KinematicDrillingForce
from acausal.library.drilling.material_table import load_materials as load_materials
from acausal.library.drilling.materials import STEEL_34CRMO4 as STEEL_34CRMO4
from acausal.library.drilling.materials import STEEL_C45 as STEEL_C45
from acausal.library.drilling.materials import Material as Material
from acausal.library.drilling.scene import DrillBody as DrillBody
from acausal.library.drilling.scene import WorkpieceBody as WorkpieceBody
from acausal.library.drilling.tool import TWIST_DRILL_16MM as TWIST_DRILL_16MM
from acausal.library.drilling.tool import Tool as Tool
from acausal.library.drilling.workpiece import Workpiece as Workpiece

# How its components are drawn: loaded by animations only.
__looks__ = "acausal.library.drilling.looks"
