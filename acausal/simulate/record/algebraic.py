"""Correction of algebraic variables at the outputs by their equations.

A BDF code interpolates between its steps, and algebraic variables are outside its error test: with states that are
straight lines in time, IDAS takes steps of a quarter of the run, and z in z + z^3 = t was 5e-3 off between them at a
tolerance of 1e-8 (measured). Newton's method from the interpolated values costs one evaluation per output if they were
good. Where it does not converge, at a kink or in a singular position, the solver's values are kept if they nearly
satisfy the equations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.equations.function_cache import functions_of

if TYPE_CHECKING:
    from acausal.simulate.solvers.segment import Tolerances

_MOST_ITERATIONS = 8
# After a Newton step of this size, the error is of the order of its square.
_CONVERGED = 1e-8
# Allowed residual of the solver's values: at least `_ALLOWED`, or so many tolerances, relative to the terms of the
# variables in an equation.
_ALLOWED, _TOLERANCES, _ROUNDING = 1e-8, 100.0, 1e-12


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
    """Correct algebraic variables, shape (nz, n); they are returned as given where Newton's method does not converge.

    `x` are all states at the instants `times`, shape (nx, n), and `tolerances` those of the solver. Raises RuntimeError
    if the values of the solver have a residual of more than a hundred tolerances, relative to the terms in it.
    """
    newton = functions_of(compiled).newton() if z.size else None
    if newton is None:
        return z
    corrected_z, remaining, scale = z.T.copy(), np.arange(z.shape[1]), compiled.nominal_z
    states, iterates, has_converged = np.ascontiguousarray(x.T), corrected_z.copy(), np.zeros(z.shape[1], dtype=bool)
    for _ in range(_MOST_ITERATIONS):
        change = rows(newton.step, (times[remaining, None], states[remaining], iterates, u, p, m))
        iterates = iterates - change
        is_finite = np.isfinite(iterates).all(axis=1)
        done = is_finite & (np.abs(change) <= _CONVERGED * (scale + np.abs(iterates))).all(axis=1)
        corrected_z[remaining[done]], has_converged[remaining[done]] = iterates[done], True
        continues = is_finite & ~done
        remaining, iterates = remaining[continues], iterates[continues]
        if not len(remaining):
            break
    for k in np.flatnonzero(~has_converged).tolist():
        at = (float(times[k]), states[k], corrected_z[k], u, p, m)
        terms = abs(newton.slope(*at).sparse()) @ (1.0 + np.abs(corrected_z[k]) / scale)
        residual = np.abs(np.array(compiled.rhs(*at)[1]).ravel())
        allowed = tolerances.scaled(_TOLERANCES, least=_ALLOWED).relative
        if not (np.isfinite(residual) & (residual <= allowed * terms + _ROUNDING)).all():
            raise RuntimeError("CONV_FAIL: the algebraic equations are not solved")
    return corrected_z.T
