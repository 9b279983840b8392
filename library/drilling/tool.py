"""Drilling tools: the dimensions that the force law needs."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Tool:
    """A twist drill with straight edges that meet in a sharp point.

    Parameters
    ----------
    d
        Diameter [m].
    sigma
        Point angle, the full angle of the cone [rad].
    z_E
        Number of cutting edges [1].
    source
        Publication from which the numbers are taken.
    """

    name: str
    d: float
    sigma: float
    z_E: int
    source: str


TWIST_DRILL_16MM = Tool(
    name="twist drill, 16 mm, 118 degrees",
    d=0.016,
    sigma=math.radians(118.0),
    z_E=2,
    source="A Drilling Force Model for Use in Multibody System Simulation Environments, section 3",
)
"""Tool of both examples of the paper."""
