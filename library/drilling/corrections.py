"""Correction factors of the specific cutting force, as rules of thumb of the literature state them.

All factors of a drilling force (`K_rake`, `K_wear`, `K_speed`) are 1 unless given. These functions give numbers for
them; each says where its rule is from and where it holds. They take SI units.
"""

from __future__ import annotations

import math

from acausal.errors import DeclarationError


def rake_correction(gamma: float, gamma_0: float = math.radians(6.0)) -> float:
    """Factor of the rake angle: 1.5 % less force for every degree above the angle the table was measured at.

    K_rake = 1 - (gamma - gamma_0) / 66.7 deg. Source: H. Tschätsch, Praxis der Zerspantechnik, section on the main
    cutting force, which states gamma_0 = 6 degrees for the usual tables of steel and 2 degrees for cast iron.

    Parameters
    ----------
    gamma
        Rake angle of the edge [rad].
    gamma_0
        Rake angle that k_c11 was measured at [rad].

    Raises
    ------
    DeclarationError
        AC160 outside -20 to 30 degrees, where the straight line is no longer meant.
    """
    within("rake angle", math.degrees(gamma), -20.0, 30.0, "degrees")
    return 1.0 - math.degrees(gamma - gamma_0) / 66.7


def wear_correction(worn: float) -> float:
    """Factor of the wear: from 1 for a sharp edge to 1.5 for one at the end of its life.

    Source: H. Tschätsch, Praxis der Zerspantechnik: K_wear = 1.3 to 1.5 for a worn edge; the upper value here.

    Parameters
    ----------
    worn
        Used part of the tool life [1], from 0 to 1.

    Raises
    ------
    DeclarationError
        AC160 outside 0 to 1.
    """
    within("used tool life", worn, 0.0, 1.0, "")
    return 1.0 + 0.5 * worn


def speed_correction(v_c: float) -> float:
    """Factor of the cutting speed, for steel: 1 near 100 m/min, more below.

    K_speed = 2.023 v_c**-0.153 up to 100 m/min, 1.380 v_c**-0.07 above, v_c in m/min. Source: H. Tschätsch,
    Praxis der Zerspantechnik, section on the main cutting force.

    Parameters
    ----------
    v_c
        Cutting speed [m/s], for a drill that of its corner, pi d n.

    Raises
    ------
    DeclarationError
        AC160 outside 20 to 600 m/min.
    """
    in_minutes = v_c * 60.0
    within("cutting speed", in_minutes, 20.0, 600.0, "m/min")
    if in_minutes <= 100.0:
        return float(2.023 * in_minutes**-0.153)
    return float(1.380 * in_minutes**-0.07)


def within(what: str, value: float, low: float, high: float, unit: str) -> None:
    """Raise AC160 when a rule is asked for what it was not made for."""
    if not low <= value <= high:
        raise DeclarationError(
            "AC160",
            f"a {what} of {value:g} {unit}".rstrip() + f" is outside of {low:g} to {high:g}",
            cause="the rule was measured inside of this range",
            help="give the factor itself, from a measurement of your own",
        )
