"""Algebraic variables at the outputs, put back onto their equations.

Between its steps a BDF code interpolates, and algebraic variables are outside of its error test: with states that are
straight lines IDAS takes steps of a quarter of the run, and z + z^3 = t came out 5e-3 off between them at a tolerance
of 1e-8 (measured). Newton's method from the interpolated values costs one evaluation an output where they were good.
Where it does not end, at a kink or in a singular position, the solver's own values stay if they are on the equations.
"""

from __future__ import annotations

import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.solvers.segment import Tolerances

_MOST = 8
# A step of Newton's method that is as small leaves an error of the order of its square.
_SMALL = 1e-8
# What a solver's own values may leave: so much of what the variables make of an equation, so many tolerances of it.
_LEFT, _TOLERANCES, _ROUNDING = 1e-8, 100.0, 1e-12


def corrected(
    compiled: CompiledModel,
    times: Vector,
    x: Vector,
    z: Vector,
    u: Vector,
    p: Vector,
    m: Vector,
    tolerances: Tolerances,
) -> Vector:
    """Algebraic variables, shape (nz, n), on their equations; as given where Newton's method does not end.

    Raises RuntimeError where they leave more than a hundred of these tolerances.

    `times`, `x`: The instants, and all states there, shape (nx, n).
    `tolerances`: Of the solver; what its own values may leave of the equations, as a share of what the variables make
    of them.
    """
    newton = functions_of(compiled).newton() if z.size else None
    if newton is None:
        return z
    found, todo, scale = z.T.copy(), np.arange(z.shape[1]), compiled.nominal_z
    states, here, ended = np.ascontiguousarray(x.T), found.copy(), np.zeros(z.shape[1], dtype=bool)
    for _ in range(_MOST):
        change = rows(newton.step, (times[todo, None], states[todo], here, u, p, m))
        here = here - change
        done = (np.abs(change) <= _SMALL * (scale + np.abs(here))).all(axis=1)  # false for nan
        found[todo[done]], ended[todo[done]] = here[done], True
        going = ~done & np.isfinite(here).all(axis=1)
        todo, here = todo[going], here[going]
        if not len(todo):
            break
    for k in np.flatnonzero(~ended).tolist():
        at = (float(times[k]), states[k], found[k], u, p, m)
        reach = abs(newton.slope(*at).sparse()) @ (1.0 + np.abs(found[k]) / scale)
        residual = np.abs(np.array(compiled.rhs(*at)[1]).ravel())
        left = tolerances.scaled(_TOLERANCES, least=_LEFT).relative
        if not (residual <= left * reach + _ROUNDING).all():  # nan is not
            raise RuntimeError("CONV_FAIL: the algebraic equations are not solved")
    return found.T
