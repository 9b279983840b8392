"""Time in another unit, for integrators that count what is nearer than a nanosecond as reached.

CasADi's interfaces to IDAS and CVODES return what they have already when the next output is less than 1e-9 away from
the last one (`ttol` in `casadi/interfaces/sundials/{idas,cvodes}_interface.cpp`, 3.8.2): a circuit simulated over 5 ns
never left its start, and stretches between close events were passed without integrating.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
_REACHED = 1e-9
# In the other unit the shortest distance is this long: far from what counts as reached, and still short.
_SHORTEST = 1e-6
# Distances of so few roundings of the time are none.
_ROUNDINGS = 8


def unit_of_time(start: float, times: Vector) -> float:
    """The unit [s] in which all outputs are far enough from each other: 1, if they are so already."""
    gaps = np.diff(times, prepend=start)
    real = gaps[gaps > _ROUNDINGS * np.spacing(max(abs(start), abs(float(times[-1]))))]
    if not len(real) or real.min() > 2.0 * _REACHED:
        return 1.0
    # powers of ten, so that the equations in a unit are made once
    return float(10.0 ** np.floor(np.log10(real.min() / _SHORTEST)))


def in_unit(unit: float, settings: dict[str, Any]) -> dict[str, Any]:
    """An integrator's settings with time in another unit [s]."""
    changed = dict(settings)
    if "init_xdot" in settings:
        changed["init_xdot"] = [unit * rate for rate in settings["init_xdot"]]
    for name in ("max_step_size", "step0"):
        if name in settings:
            changed[name] = settings[name] / unit
    return changed
