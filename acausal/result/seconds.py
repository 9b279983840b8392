"""Times of data, of whatever kind, in seconds."""

from __future__ import annotations

from datetime import timedelta

import numpy as np
from numpy.typing import ArrayLike

from acausal.arrays import Vector
from acausal.errors import UnitError
from acausal.units import TIME, in_si, parse


def seconds(times: ArrayLike, unit: str = "") -> Vector:
    """Numbers in `unit`, which is s where none is given, or durations, in seconds; of the shape of `times`.

    Durations are those of Python, numpy and pandas. As plain numbers they would count nanoseconds, or whatever else.

    Raises
    ------
    TypeError
        For dates, which no run begins at, and for what is no number.
    UnitError
        AC150 for an unknown unit, AC151 for one that is none of time: `time [m]` is in metres.
    """
    given = np.asarray(times)
    if given.dtype.kind == "O" and given.size and all(isinstance(t, timedelta) for t in given.flat):
        given = given.astype("timedelta64[us]")
    if given.dtype.kind == "M":
        raise TypeError("these are dates: subtract the one at which the run begins")
    if given.dtype.kind == "m":
        return np.asarray(given / np.timedelta64(1, "s"), dtype=np.float64)
    if unit and parse(unit).dimension != TIME:
        raise UnitError("AC151", f"times in {unit}", help="units of time are s, ms, min, h and d")
    return np.asarray(given, dtype=np.float64) * (in_si(1.0, unit) if unit else 1.0)
