"""Algebraic variables at the outputs, put back onto their equations.

Between its steps a BDF code interpolates, and algebraic variables are outside of its error test: with states that are
straight lines IDAS takes steps of a quarter of the run, and z + z^3 = t came out 5e-3 off between them at a tolerance
of 1e-8 (measured). Newton's method from the interpolated values costs one evaluation an output where they were good.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel
from acausal.simulate.direct import rows
from acausal.simulate.kept import kept

Vector = NDArray[np.float64]
_MOST = 8
# A step of Newton's method that is as small leaves an error of the order of its square.
_SMALL = 1e-8


def polished(compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
    """Algebraic variables, shape (nz, n), on their equations; as given where Newton's method does not end.

    Parameters
    ----------
    times, x
        The instants, and all states there, shape (nx, n).
    """
    newton = kept(compiled).newton() if z.size else None
    if newton is None:
        return z
    found, todo, scale = z.T.copy(), np.arange(z.shape[1]), compiled.nominal_z
    states, here = np.ascontiguousarray(x.T), found.copy()
    for _ in range(_MOST):
        change = rows(newton.step, (times[todo, None], states[todo], here, u, p, m))
        here = here - change
        done = (np.abs(change) <= _SMALL * (scale + np.abs(here))).all(axis=1)  # false for nan
        found[todo[done]] = here[done]
        going = ~done & np.isfinite(here).all(axis=1)
        todo, here = todo[going], here[going]
        if not len(todo):
            break
    return found.T
