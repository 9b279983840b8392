"""Timing of compiled step functions, step by step: the mean time is the throughput, the worst the real-time limit."""

from __future__ import annotations

import ctypes
import hashlib
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.step.source import StepFunction, identifier
from acausal.simulate.native import cache

_TIMED = """
#include <time.h>
void acausal_timed(long long n, double* x, const double* u, const double* p, double* y, double* seconds) {{
  double next[{nx}];
  struct timespec a, b;
  long long k;
  int i;
  for (k = 0; k < n; ++k) {{
    clock_gettime(CLOCK_MONOTONIC, &a);
    {identifier}_step(x, u, p, next, y);
    clock_gettime(CLOCK_MONOTONIC, &b);
    seconds[k] = (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec);
    for (i = 0; i < {nx}; ++i) x[i] = next[i];
  }}
}}
"""


@dataclass(frozen=True)
class RealTime:
    """Computing times of steps [s], reading the clock included; factors are simulated time over computing time."""

    method: str
    step: float
    steps: int
    mean: float
    median: float
    p999: float
    worst: float
    factor: float
    worst_factor: float
    finite: bool

    def record(self) -> dict[str, Any]:
        """The fields as a dictionary, for JSON."""
        return asdict(self)


def real_time(
    made: StepFunction, steps: int, x: Vector | None = None, u: Vector | None = None
) -> tuple[RealTime, Vector]:
    """Time compiled steps from the start (or from `x`, shape (nx,)) with constant inputs `u`, shape (nu,).

    Returns the times and the final x, shape (nx,).

    Raises ExportError: AC607 without a C compiler.
    """
    source = made.source() + _TIMED.format(nx=max(len(made.x), 1), identifier=identifier(made.name))
    key = cache.key("real time", hashlib.sha256(source.encode()).hexdigest())
    path = cache.find(key) or cache.build(key, source)
    if path is None:
        raise ExportError("AC607", "no C compiler: timing needs compiled steps", help="install cc, gcc or clang")
    call = ctypes.CDLL(str(path)).acausal_timed
    state = np.array(made.x.start if x is None else x, dtype=float)
    held = np.array(made.u.start if u is None else u, dtype=float)
    p, y, seconds = np.array(made.p.start, dtype=float), np.zeros(max(len(made.y), 1)), np.zeros(steps)
    warm = state.copy()
    for values, count in ((warm, min(steps, 100)), (state, steps)):
        call(ctypes.c_longlong(count), *(ctypes.c_void_p(a.ctypes.data) for a in (values, held, p, y, seconds)))
    mean, worst = float(seconds.mean()), float(seconds.max())
    return (
        RealTime(
            method=made.method,
            step=made.step,
            steps=steps,
            mean=mean,
            median=float(np.median(seconds)),
            p999=float(np.quantile(seconds, 0.999)),
            worst=worst,
            factor=made.step / mean,
            worst_factor=made.step / worst,
            finite=bool(np.isfinite(state).all()),
        ),
        state,
    )
