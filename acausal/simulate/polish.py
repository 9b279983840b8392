"""Algebraic variables at the outputs, put back onto their equations.

Between its steps a BDF code interpolates, and algebraic variables are outside of its error test: with states that are
straight lines IDAS takes steps of a quarter of the run, and z + z^3 = t came out 5e-3 off between them at a tolerance
of 1e-8 (measured). Newton's method from the interpolated values costs one evaluation an output where they were good.
"""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel, Symbols
from acausal.simulate.direct import rows

Vector = NDArray[np.float64]
_MOST = 8
# A step of Newton's method that is as small leaves an error of the order of its square.
_SMALL = 1e-8
_made: WeakKeyDictionary[CompiledModel, Any] = WeakKeyDictionary()


def polished(compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
    """Algebraic variables, shape (nz, n), on their equations; as given where Newton's method does not end.

    Parameters
    ----------
    times, x
        The instants, and all states there, shape (nx, n).
    """
    if compiled not in _made:
        _made[compiled] = _newton_step(compiled)
    step = _made[compiled]
    if step is None or not z.size:
        return z
    found, todo, scale = z.T.copy(), np.arange(z.shape[1]), compiled.nominal_z
    states, here = np.ascontiguousarray(x.T), found.copy()
    for _ in range(_MOST):
        change = rows(step, (times[todo, None], states[todo], here, u, p, m))
        here = here - change
        done = (np.abs(change) <= _SMALL * (scale + np.abs(here))).all(axis=1)  # false for nan
        found[todo[done]] = here[done]
        going = ~done & np.isfinite(here).all(axis=1)
        todo, here = todo[going], here[going]
        if not len(todo):
            break
    return found.T


def _newton_step(compiled: CompiledModel) -> Any | None:
    """`(t, x, z, u, p, m) -> z - root`, to first order; None where the equations cannot be solved for z."""
    s = Symbols(compiled)
    alg = compiled.rhs(*s.inputs)[1]
    parts = ca.Function("parts", s.inputs, [ca.densify(alg), ca.jacobian(alg, s.z)])
    arguments = [ca.MX.sym(f"a{k}", symbol.numel()) for k, symbol in enumerate(s.inputs)]
    value, slope = parts(*arguments)
    try:
        return ca.Function("newton_step", arguments, [ca.densify(ca.solve(slope, value, "qr"))])
    except RuntimeError:  # structurally singular
        return None
