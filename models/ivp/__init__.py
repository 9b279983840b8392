"""Published initial value problems with reference solutions, equations as published; `acausal.models.ivp`.

Sources are named in each file; most come from Mazzia, Magherini, Iavernaro: Test Set for Initial Value Problem Solvers,
University of Bari. Absolute tolerances are a thousandth of the relative tolerance times `nominal`, so components that
become very small have small nominal values.
"""

from __future__ import annotations

from acausal.models.ivp.andrews_squeezer import AndrewsSqueezer
from acausal.models.ivp.car_axis import CarAxis
from acausal.models.ivp.charge_pump import ChargePump
from acausal.models.ivp.chemical_akzo_nobel import ChemicalAkzoNobel
from acausal.models.ivp.e5 import E5
from acausal.models.ivp.fekete_points import FeketePoints
from acausal.models.ivp.hires import Hires
from acausal.models.ivp.oregonator import Oregonator
from acausal.models.ivp.planar_pendulum import PlanarPendulum
from acausal.models.ivp.pleiades import Pleiades
from acausal.models.ivp.pollution import Pollution
from acausal.models.ivp.ring_modulator import RingModulator
from acausal.models.ivp.robertson import Robertson
from acausal.models.ivp.transistor_amplifier import TransistorAmplifier
from acausal.models.ivp.vanderpol import VanDerPol
from acausal.models.ivp.wheelset import Wheelset

__all__ = [
    "E5",
    "AndrewsSqueezer",
    "CarAxis",
    "ChargePump",
    "ChemicalAkzoNobel",
    "FeketePoints",
    "Hires",
    "Oregonator",
    "PlanarPendulum",
    "Pleiades",
    "Pollution",
    "RingModulator",
    "Robertson",
    "TransistorAmplifier",
    "VanDerPol",
    "Wheelset",
]
