"""The defect of a solution between its rows: whether its slope there is the rate that the equations give.

Methods with defect control choose their steps by it (W. H. Enright, W. B. Hayes, Robust and Reliable Defect Control for
Runge-Kutta Methods, ACM Transactions on Mathematical Software 33, 2007). Here it only tells whether a step was missed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.location.between import steady
from acausal.simulate.solvers.base import on_equations
from acausal.simulate.solvers.segment import Segment

LARGEST_DEFECT = 1.0
"""A solution with a larger defect does not satisfy its equations [tolerances]."""
# Slope and rate differ by more than this fraction of the larger one if the solver has missed the rate altogether.
_MISSED = 0.5
_NODES = 8


def defects(
    problem: Problem, segment: Segment, rows: tuple[Vector, Vector, Vector], instants: Vector
) -> tuple[Vector, Truth]:
    """The defect of a solution at m instants, and whether the solver has missed the rate there; shapes (m,).

    The defect is the largest difference of slope and rate, times the distance of the rows, in tolerances; inf where the
    algebraic equations cannot be solved.

    `rows`: Instants, states and algebraic variables; shapes (n,), (nx, n) and (nz, n).
    """
    (times, states, algebraic), n = rows, problem.n_dynamic
    k = np.clip(np.searchsorted(times, instants), 1, len(times) - 1)
    width = times[k] - times[k - 1]
    values = np.vstack([states, algebraic]).T
    near = 0.01 * width
    count = min(_NODES, len(times))
    at, before, after = (steady(times, values, instants + d, count) for d in (0.0 * near, -near, near))
    slope = (after - before)[:, :n] / (2.0 * near[:, None])
    x, z = at[:, : len(states)].T, at[:, len(states) :].T
    if len(z):
        try:
            z = on_equations(problem, replace(segment, times=instants), x, z)
        except RuntimeError:
            return np.full(len(instants), np.inf), np.zeros(len(instants), dtype=bool)
    rhs = functions_of(problem.compiled).rhs
    rates = rhs.many(instants[:, None], x.T, z.T, problem.u, problem.p, segment.p)[:, :n]
    difference = np.abs(rates - slope)
    allowed = segment.tolerances.of(x[:n].T, problem.scale_x)
    defect = np.nan_to_num(difference * width[:, None] / allowed, nan=np.inf)
    is_missed = (defect > LARGEST_DEFECT) & ~(difference <= _MISSED * np.maximum(np.abs(rates), np.abs(slope)))
    return defect.max(axis=1, initial=0.0), np.asarray(is_missed.any(axis=1))
