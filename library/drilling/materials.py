"""Work materials: constants of Kienzle's law, each with its source."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """Kienzle constants of one material: k_c = k_c11 (h / 1 mm)**(-z).

    Parameters
    ----------
    k_c11
        Specific cutting force of a chip 1 mm thick and 1 mm wide [Pa].
    z
        Exponent of the chip thickness [1].
    source
        Publication from which the numbers are taken.
    """

    name: str
    k_c11: float
    z: float
    source: str


STEEL_34CRMO4 = Material(
    name="34CrMo4",
    k_c11=2240e6,
    z=0.21,
    source="A Drilling Force Model for Use in Multibody System Simulation Environments, example of section 3.1",
)
"""Quenched and tempered steel of the paper's examples. Others are added only with a source."""

STEEL_C45 = Material(
    name="C45",
    k_c11=2220e6,
    z=0.14,
    source="J. Dietrich, Praxis der Zerspanungstechnik, table 2.1 (Ck45)",
)
