"""Drilling: geometry of drill and plate, drilled depth, cutting and contact force, tools and materials.

A compliant drilling-force model for multibody scenes, in the three blocks of the founding paper (its Figure 3):
`DrillGeometry`, `DrillDepthCalculation` and `DrillContactForce` make `DrillingForce`. See docs/drilling.md.
"""

from __future__ import annotations

from acausal.library.drilling.corrections import rake_correction as rake_correction
from acausal.library.drilling.corrections import speed_correction as speed_correction
from acausal.library.drilling.corrections import wear_correction as wear_correction
from acausal.library.drilling.depth import DrillDepthCalculation as DrillDepthCalculation
from acausal.library.drilling.drilling_force import DrillingForce as DrillingForce
from acausal.library.drilling.energy import EnergyBalance as EnergyBalance
from acausal.library.drilling.force import DrillContactForce as DrillContactForce
from acausal.library.drilling.geometry import DrillGeometry as DrillGeometry
from acausal.library.drilling.kinematic import KinematicCuttingForce as KinematicCuttingForce
from acausal.library.drilling.kinematic import KinematicDrillingForce as KinematicDrillingForce
from acausal.library.drilling.materials import STEEL_34CRMO4 as STEEL_34CRMO4
from acausal.library.drilling.materials import Material as Material
from acausal.library.drilling.tool import TWIST_DRILL_16MM as TWIST_DRILL_16MM
from acausal.library.drilling.tool import Tool as Tool
from acausal.library.drilling.workpiece import Workpiece as Workpiece
