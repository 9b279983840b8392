"""How well rounding lets Newton's method know algebraic variables.

A current through micro-ohms is known to the rounding of its voltage by these: 3e-9 A beside 150 V. IDA asks for a
hundredth of its tolerance of every variable (`nonlin_conv_coeff`), so that below 1e-9 no iteration ended there, or only
by chance after some twenty starts with ever smaller steps. What rounding leaves of an equation is carried over to the
variables by the inverse of the slope (N. J. Higham, Accuracy and Stability of Numerical Algorithms, section 7.2); where
it is more than IDA asks for, the absolute tolerance of that variable is what can be attained. They are outside of IDA's
error test, which is left as it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.segment import Segment

_ROUNDING = 1.2e-16
# IDA takes a first correction as good when it is so many times smaller than what it asks for (`ss20` in IDANls).
_DISTRUST = 20.0
# Rounding in an estimated error is that of eight stages and their weights.
_TESTED = 100.0
# How near to their equations, beside their size.
_NEAR = 1e-4
# Tolerances are powers of this, so that integrators are few, and at most so large.
_GRADE, _LARGEST = 10.0, 1e-6
# The inverse is dense.
_MOST = 200


def attainable(problem: Problem, segment: Segment, convergence: float) -> dict[str, Any]:
    """The option with absolute tolerances that Newton's method attains, where IDA's own are less than rounding.

    `convergence` is the share of its tolerance that IDA asks Newton's method for.
    """
    noise = _noise(problem, segment)
    if noise is None:
        return {}
    z = segment.z / problem.scale_z
    wanted = _DISTRUST / convergence * noise
    beyond = np.flatnonzero(wanted > segment.tolerances.of(z))  # not where it is nan
    if not len(beyond):
        return {}
    absolute = segment.tolerances.absolute
    allowed = np.full(len(z), absolute)
    graded = _GRADE ** np.ceil(np.log(wanted[beyond]) / np.log(_GRADE))
    allowed[beyond] = np.maximum(np.minimum(graded, _LARGEST), absolute)
    return {"abstolv": [absolute] * problem.n_dynamic + allowed.tolist()}


def units(problem: Problem, segment: Segment) -> Vector | None:
    """Divisors, shape (nz,), of scaled algebraic variables for a method that tests all errors against one tolerance.

    IDA leaves them out of its test, as they follow from the states, which have theirs, and are put onto their equations
    where they are recorded. In a test of all, the acceleration of a drill at rest between forces of kilonewtons has to
    be zero to eight digits: steps of a nanosecond. So they are tested for being near their equations only.
    """
    z = np.abs(segment.z / problem.scale_z)
    noise = _noise(problem, segment)
    if not len(z) or not np.isfinite(z).all():
        return None
    wanted = _NEAR * (1.0 + z)
    if noise is not None:
        wanted = np.fmax(wanted, _TESTED * noise)
    return np.asarray(np.maximum(_GRADE ** np.ceil(np.log(wanted / segment.tolerances.absolute) / np.log(_GRADE)), 1.0))


def _noise(problem: Problem, segment: Segment) -> Vector | None:
    """What rounding leaves of scaled algebraic variables at the start of a segment; None where that is not known."""
    n = len(segment.z)
    if not 0 < n <= _MOST:
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
