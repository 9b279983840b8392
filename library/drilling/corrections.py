"""Correction factors of the specific cutting force, by rules of thumb from the literature.

All factors of a drilling force (`K_rake`, `K_wear`, `K_speed`) default to 1. This module has values for them:
`DrillingForce(..., K_rake=rake_correction(math.radians(20.0)), K_speed=SPEED_HSS)`.

Source: J. Dietrich, Praxis der Zerspanungstechnik (founded by H. Tschätsch), 11th edition, 2014, section on the main
cutting force.
"""

from __future__ import annotations

import math
import sys

from acausal.errors import DeclarationError, Span

SPEED_CARBIDE = 1.0
"""Factor of the cutting speed for carbide: the tables were measured at its speeds."""
SPEED_HSS = 1.2
"""Factor of the cutting speed for high-speed steel: slower cuts need more force."""
WORN = 1.3
"""Factor of an edge at the end of its life; 1 for a sharp one."""

RAKE_STEEL = math.radians(6.0)
RAKE_CAST_IRON = math.radians(2.0)
RAKE_ALUMINIUM = 0.0
"""Rake angles [rad] that the tables of these materials refer to."""


def rake_correction(gamma: float, gamma_0: float = RAKE_STEEL) -> float:
    """Factor of the rake angle: 1 % less force for every degree above the angle of the table.

    Parameters
    ----------
    gamma
        Rake angle of the edge [rad].
    gamma_0
        Rake angle that k_c11 refers to [rad].

    Raises
    ------
    DeclarationError
        AC180 outside -30 to 45 degrees: such angles do not occur; the value may be in degrees.
    """
    if not -30.0 <= math.degrees(gamma) <= 45.0:
        caller = sys._getframe(1)
        raise DeclarationError(
            "AC180",
            f"a rake angle of {gamma:g} rad does not occur on drills",
            where=(Span(caller.f_code.co_filename, caller.f_lineno),),
            cause="perhaps it is given in degrees" if abs(gamma) > 1.0 else None,
            help="rake_correction(math.radians(20.0)), between -30 and 45 degrees",
        )
    return 1.0 - math.degrees(gamma - gamma_0) / 100.0
