"""Readable units for plots: 0.016 m as 16 mm, 230e6 Pa as 230 MPa."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from acausal.result.signals import Array
from acausal.units import convert

# Units that take a prefix when they come first; `kg` has one already, and kiloseconds are unusual (`_LARGEST`).
_LEADING = re.compile(r"(?P<unit>Ohm|Pa|Hz|Wb|N|W|J|V|A|F|H|C|S|T|m|s)(?P<power>[23]?)(?=$|[./])")
_PREFIXES = {-12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_LARGEST = {"s": 0, "m": 3}
# Stresses and specific cutting forces are usually given in N/mm2.
_STRESS = "N/m2"


_RAISED = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")


@dataclass(frozen=True)
class Scale:
    """A unit in which values are shown: shown = slope * declared + offset."""

    unit: str
    slope: float = 1.0
    offset: float = 0.0

    def __call__(self, values: Array) -> Array:
        """Values, of any shape, converted from the declared unit."""
        return values * self.slope + self.offset

    @property
    def label(self) -> str:
        """The unit in brackets for the label of an axis; empty for a dimensionless quantity."""
        if self.unit in ("", "1"):
            return ""
        # avoid mathtext: beside it, matplotlib looks up a line break in the font, and warns that it is missing
        text = re.sub(r"(?<=[A-Za-z)])(-?\d+)", lambda m: m[1].translate(_RAISED), self.unit)
        text = re.sub(r"\bu(?=Ohm|Pa|Hz|Wb|[NWJVAFHCSTms])", "\u00b5", text)
        text = re.sub(r"\bdeg(?=[CF]?\b)", "\u00b0", text)
        return f"[{text.replace('.', '·').replace('Ohm', 'Ω')}]"


def to_unit(declared: str, shown: str) -> Scale:
    """The conversion from the declared unit to another.

    Raises UnitError when a unit is unknown or the dimensions differ.
    """
    zero, one = (convert(f"{x} {declared or '1'}", shown) for x in (0, 1))
    return Scale(shown, one - zero, zero)


def same_unit(unit: str, other: str) -> Scale:
    """The conversion of values in the unit `other` to `unit`; none if either is unknown.

    Raises UnitError: AC151 for units that do not fit.
    """
    return to_unit(other, unit) if unit and other and unit != other else Scale(unit)


def readable(declared: str, magnitude: float) -> Scale:
    """The declared unit with the prefix that brings the largest magnitude to 1 .. 1000.

    From 0.1 to 1 no prefix is added either: 0.5 m reads better than 500 mm. A unit that already has a prefix was chosen
    by the author of the model and is kept.
    """
    if declared == _STRESS and 1e5 <= magnitude < math.inf:
        return Scale("N/mm2", 1e-6)
    match = _LEADING.match(declared)
    if match is None or not math.isfinite(magnitude) or magnitude == 0.0 or 0.1 <= magnitude < 1000.0:
        return Scale(declared)
    power = int(match["power"] or 1)
    if power > 1 and magnitude >= 1e-3:
        return Scale(declared)
    if match["unit"] == "m" and power == 3 and magnitude >= 1e-6:
        return Scale("c" + declared, 1e6)  # a step of the prefixes is a factor of 1e9 here
    exponent = 3 * math.floor(math.log10(magnitude) / (3 * power) + 1e-12)
    exponent = min(max(exponent, -12), _LARGEST.get(match["unit"], 9))
    return Scale(_PREFIXES[exponent] + declared, 10.0 ** (-exponent * power))
