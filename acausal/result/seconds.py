"""Conversion of times in data (numbers with a unit, durations) to seconds."""

from __future__ import annotations

from datetime import timedelta

import numpy as np
from numpy.typing import ArrayLike

from acausal.arrays import Vector
from acausal.errors import UnitError
from acausal.units import TIME, in_si, parse


def seconds(times: ArrayLike, unit: str = "") -> Vector:
    """Convert numbers in `unit` (by default s), or durations, to seconds; the result has the shape of `times`.

    Durations are those of Python, numpy and pandas; converted to plain numbers they would count nanoseconds or another
    unit.

    Raises
    ------
    TypeError
        For dates, because runs do not start at a date, and for values that are not numbers.
    UnitError
        AC150 for an unknown unit, AC151 for one that is not a unit of time: `time [m]` is in metres.
    """
    given = np.asarray(times)
    if given.dtype.kind == "O" and given.size and all(isinstance(t, timedelta) for t in given.flat):
        given = given.astype("timedelta64[us]")
    if given.dtype.kind == "M":
        raise TypeError("these are dates: subtract the date at which the run starts")
    if given.dtype.kind == "m":
        return np.asarray(given / np.timedelta64(1, "s"), dtype=np.float64)
    if unit and parse(unit).dimension != TIME:
        raise UnitError("AC151", f"times in {unit}", help="units of time are s, ms, min, h and d")
    return np.asarray(given, dtype=np.float64) * (in_si(1.0, unit) if unit else 1.0)
