"""Units to choose from for a declared one: those in which its dimension is commonly read."""

from __future__ import annotations

from functools import cache

from acausal.plot.scale import to_unit
from acausal.units import parse

_COMMON = (
    ("m", "mm", "um", "cm", "km"),
    ("s", "ms", "us", "min", "h"),
    ("m/s", "mm/s", "m/min", "mm/min", "km/h"),
    ("m/s2", "mm/s2"),
    ("rad", "deg", "mrad"),
    ("rad/s", "deg/s"),
    ("1/s", "Hz", "1/min", "kHz"),
    ("kg", "g", "t"),
    ("N", "mN", "kN", "MN"),
    ("N.m", "mN.m", "kN.m"),
    ("Pa", "kPa", "MPa", "GPa", "bar", "N/mm2"),
    ("N/m", "N/mm", "kN/m", "MN/m"),
    ("J", "mJ", "kJ", "MJ", "kWh"),
    ("W", "mW", "kW", "MW"),
    ("V", "mV", "uV", "kV"),
    ("A", "mA", "uA", "kA"),
    ("Ohm", "mOhm", "kOhm", "MOhm"),
    ("F", "mF", "uF", "nF", "pF"),
    ("H", "mH", "uH"),
    ("C", "mC", "uC"),
    ("K", "degC"),
    ("m2", "mm2", "cm2"),
    ("m3", "l", "cm3", "mm3"),
    ("m3/s", "l/s", "l/min"),
)


@cache
def choices(declared: str) -> tuple[tuple[str, float, float], ...]:
    """Units with the slope and the offset by which declared values are shown in them; the declared one first."""
    own = (declared, 1.0, 0.0)
    if not declared or declared == "1":
        return (own,)
    dimension = parse(declared).dimension
    # Turns and radians, torque and work have one dimension: what the unit itself stands among comes first.
    fitting = [units for units in _COMMON if parse(units[0]).dimension == dimension]
    found = next((units for units in fitting if declared in units), fitting[0] if fitting else ())
    scales = [to_unit(declared, unit) for unit in found if unit != declared]
    return own, *((s.unit, s.slope, s.offset) for s in scales)
