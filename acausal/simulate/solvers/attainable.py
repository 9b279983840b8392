"""The accuracy to which Newton's method can determine algebraic variables in spite of rounding errors.

The current through a few micro-ohms is only as accurate as the rounding error of its voltage divided by them: 3e-9 A at
150 V. IDA iterates to a hundredth of its tolerance in every variable (`nonlin_conv_coeff`). Below a tolerance of 1e-9
that iteration never converged, or only by chance after some twenty restarts with ever smaller steps.

The inverse Jacobian maps rounding errors of the equations to the variables (N. J. Higham, Accuracy and Stability of
Numerical Algorithms, section 7.2). Where the result exceeds what IDA requires, that variable gets the attainable
absolute tolerance. Algebraic variables are outside IDA's error test, which stays as it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.segment import Segment

_ROUNDING = 1.2e-16
# IDA accepts a first correction that is this many times smaller than its convergence threshold (`ss20` in IDANls).
_FIRST_CORRECTION = 20.0
# An estimated error accumulates rounding errors of eight stages and their weights: this many times those of one.
_ERROR_ESTIMATE = 100.0
# Relative accuracy to which algebraic variables have to satisfy their equations in an error test.
_CONSISTENT = 1e-4
# Tolerances are powers of `_GRADE`, so that few integrators are built, and at most `_LARGEST`.
_GRADE, _LARGEST = 10.0, 1e-6
# More variables are not examined, because the inverse is dense.
_MOST_VARIABLES = 200


def attainable(problem: Problem, segment: Segment, convergence: float) -> dict[str, Any]:
    """Return the option with attainable absolute tolerances; empty if rounding errors are below IDA's own.

    `convergence` is the fraction of its tolerance to which IDA iterates Newton's method.
    """
    noise = _rounding_errors(problem, segment)
    if noise is None:
        return {}
    z = segment.z / problem.scale_z
    needed = _FIRST_CORRECTION / convergence * noise
    limited = np.flatnonzero(needed > segment.tolerances.of(z))  # not where it is nan
    if not len(limited):
        return {}
    absolute = segment.tolerances.absolute
    allowed = np.full(len(z), absolute)
    graded = _GRADE ** np.ceil(np.log(needed[limited]) / np.log(_GRADE))
    allowed[limited] = np.maximum(np.minimum(graded, _LARGEST), absolute)
    return {"abstolv": [absolute] * problem.n_dynamic + allowed.tolist()}


def units(problem: Problem, segment: Segment) -> Vector | None:
    """Return divisors, shape (nz,), of scaled algebraic variables for a method that tests all errors alike.

    IDA leaves algebraic variables out of its error test: they follow from the states, which are tested, and are
    corrected by their equations where they are recorded. If they are tested, the acceleration of a drill at rest
    between forces of kilonewtons must be zero to eight digits, which takes steps of a nanosecond. The divisors relax
    the test, so that it only requires them to nearly satisfy their equations. None without finite algebraic variables.
    """
    z = np.abs(segment.z / problem.scale_z)
    noise = _rounding_errors(problem, segment)
    if not len(z) or not np.isfinite(z).all():
        return None
    needed = _CONSISTENT * (1.0 + z)
    if noise is not None:
        needed = np.fmax(needed, _ERROR_ESTIMATE * noise)
    return np.asarray(np.maximum(_GRADE ** np.ceil(np.log(needed / segment.tolerances.absolute) / np.log(_GRADE)), 1.0))


def _rounding_errors(problem: Problem, segment: Segment) -> Vector | None:
    """Rounding errors of the scaled algebraic variables at the start of a segment; None if they cannot be estimated."""
    n = len(segment.z)
    if not 0 < n <= _MOST_VARIABLES:
        return None
    x, z = segment.x[: problem.n_dynamic] / problem.scale_x, segment.z / problem.scale_z
    numbers = problem.vector(segment.p, segment.x, segment.start)
    slope, sizes = problem.scaled.slope(0.0, x, z, numbers)
    if not (np.isfinite(slope).all() and np.isfinite(sizes).all()):
        return None
    try:
        return np.asarray(_ROUNDING * np.abs(np.linalg.inv(slope.reshape(n, n))) @ sizes)
    except np.linalg.LinAlgError:
        return None
