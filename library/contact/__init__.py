"""Contact: compliant laws and friction, shapes, collision detection, and scenes of many bodies."""

from __future__ import annotations

from acausal.library.contact.collide.penetration import penetration as penetration
from acausal.library.contact.collide.shapes import Box as Box
from acausal.library.contact.collide.shapes import Capsule as Capsule
from acausal.library.contact.collide.shapes import Cone as Cone
from acausal.library.contact.collide.shapes import ConvexHull as ConvexHull
from acausal.library.contact.collide.shapes import Cylinder as Cylinder
from acausal.library.contact.collide.shapes import HalfSpace as HalfSpace
from acausal.library.contact.collide.shapes import PointedDrill as PointedDrill
from acausal.library.contact.collide.shapes import Shape as Shape
from acausal.library.contact.collide.shapes import Sphere as Sphere
from acausal.library.contact.manifold.touch import Touch as Touch
from acausal.library.contact.manifold.touch import touches as touches
from acausal.library.contact.scene.bodies import ContactBody as ContactBody
from acausal.library.contact.scene.bodies import Surfaces as Surfaces
from acausal.library.contact.scene.broad_phase import PairReport as PairReport
from acausal.library.contact.scene.friction import Coulomb as Coulomb
from acausal.library.contact.scene.friction import FrictionLaw as FrictionLaw
from acausal.library.contact.scene.friction import Hybrid as Hybrid
from acausal.library.contact.scene.friction import LuGre as LuGre
from acausal.library.contact.scene.friction import Stribeck as Stribeck
from acausal.library.contact.scene.laws import DampedPowerLaw as DampedPowerLaw
from acausal.library.contact.scene.laws import Flores as Flores
from acausal.library.contact.scene.laws import HuntCrossley as HuntCrossley
from acausal.library.contact.scene.laws import KelvinVoigt as KelvinVoigt
from acausal.library.contact.scene.laws import LankaraniNikravesh as LankaraniNikravesh
from acausal.library.contact.scene.laws import NormalLaw as NormalLaw
from acausal.library.contact.scene.scene import ContactScene as ContactScene
from acausal.library.contact.scene.surface import AT_FRAME as AT_FRAME
from acausal.library.contact.scene.surface import SurfaceContact as SurfaceContact

# How its components are drawn: loaded by animations only.
__looks__ = "acausal.library.contact.looks"
