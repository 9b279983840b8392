"""Whether mesh points are so close that guards may be judged by them, as far as the arguments of their functions go.

`sin(w*t) > 0.9` turns any number of times, and `exp(-((x - 1)/w)**2) > 0.5` comes and goes, while all states rest or
grow evenly. Polynomials through mesh points far apart look smooth. The arguments themselves are as smooth as the
states: their change from one mesh point to the next, and that of the function within the bounds of its argument, tell
where mesh points are too far apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import STILL, Guards, Moment
from acausal.simulate.events.location.between import lower_bounds
from acausal.simulate.events.location.mesh import resolution
from acausal.simulate.events.resolution.changes import changes
from acausal.simulate.events.resolution.guard_arguments import Arguments, guard_arguments
from acausal.simulate.events.resolution.patience import Patience
from acausal.simulate.solvers.segment import Piece, Segment

# The largest change of a phase between two mesh points [rad]. With 32 points in each period, the parabolas through them
# show a peak that exceeds its threshold by 2e-5 of its height; with eight, 4 of 50 were lost that exceed it by 1e-3.
_LARGEST_ADVANCE = np.pi / 16
# The same where rates depend on the phase: the error control resolves it, unless its part of the rates is small. The
# first mesh points are chosen before any step: of 31 periods in 64 of them the first two peaks were lost.
# Where they depend on it only as some relations hold, an eighth of a period, by which compiled loops bound their steps.
_RESOLVED_ADVANCE, _EFFECTIVE_ADVANCE = np.pi / 2, np.pi / 4
# The fraction of the change of a steep function that counts where rates depend on it, so that steps are short there.
_RESOLVED_FRACTION = 0.5
# The fraction of the largest distance of mesh points that is aimed at, and the shortest interval that is divided, in
# distances of instants that coincide.
_WITHIN, _FEW = 0.7, 16.0


def must_be_searched(compiled: CompiledModel) -> bool:
    """Whether guards have arguments on which no rate depends, which steps of a compiled loop do not resolve."""
    known = guard_arguments(compiled)
    return known is not None and not all(known.effective)


def may_pulse(compiled: CompiledModel) -> bool:
    """Whether guards have steep functions that steps may pass over: solutions of a compiled loop have to be tested."""
    known = guard_arguments(compiled)
    return known is not None and bool(known.is_unresolved.any())


def shows_pulses(problem: Problem, segment: Segment, piece: Piece) -> bool:
    """Whether the rows of a solution are so close that no steep function of a guard comes and goes between two."""
    found = guard_arguments(problem.compiled)
    if found is None or not found.is_unresolved.any():
        return True
    times, x = np.append(segment.start, segment.times), np.column_stack([segment.x, piece.x])
    values = found.function.many(times[:, None], x.T, np.zeros((len(times), 0)), problem.u, problem.p, segment.p)
    exponents = found.exponents.many(times[:1], segment.x, segment.z, problem.u, problem.p, segment.p)[0]
    change = changes(times, values, found.operations, exponents, found.is_unresolved)
    return not (change[np.diff(times) > 0.0] > 1.0).any()


def turning_rate(compiled: CompiledModel, t: Any, x: Any, others: Sequence[Any]) -> Any:
    """The largest rate of the phases of guards [rad/s] along the solution of an ODE, at (t, x, *others) in SX."""
    known = guard_arguments(compiled)
    if known is None:
        return ca.SX(0)
    column, n = known.column(t, x, *others), compiled.n_dynamic
    column = column[np.flatnonzero(known.is_phase).tolist()]
    rates = ca.densify(compiled.rhs(t, x, *others)[0])[:n]
    along = ca.jtimes(column, ca.vertcat(t, x[:n]), ca.vertcat(1, rates))
    return ca.mmax(ca.fabs(along)) if along.numel() else ca.SX(0)


def first_swing(
    guards: Guards,
    patience: Patience,
    moment: Moment,
    segment: Segment,
    times: Vector,
    piece: Piece,
    rows: NDArray[np.int64],
    until: int,
) -> tuple[int | None, float]:
    """The first of some intervals in which a phase advances too far, or a steep function changes too much, or None.

    And a better distance of mesh points if a phase does [s], inf else: what is steep is so for a moment.

    `times`: The start of the segment and n mesh points, shape (n + 1,), which are the `rows` of a piece, shape (n,).
    `until`: The first so many intervals count, unless they are nearly as short as instants that coincide.
    """
    problem = moment.regime.problem
    found = guard_arguments(problem.compiled)
    if found is None or not until:
        return None, np.inf
    times = times[: until + 1]
    x, z = (np.column_stack([v, w[:, rows[:until]]]) for v, w in ((segment.x, piece.x), (segment.z, piece.z)))
    values = found.function.many(times[:, None], x.T, z.T, problem.u, problem.p, moment.m)
    advance = np.abs(np.diff(values[:, found.is_phase], axis=0)) / _advances(found)
    advance = advance.max(axis=1, initial=0.0)
    exponents = found.exponents.many(times[:1], segment.x, segment.z, problem.u, problem.p, moment.m)[0]
    exponents *= np.where(found.resolved, _RESOLVED_FRACTION, 1.0)
    steep, winding = (
        changes(times, values, found.operations, exponents, chosen) for chosen in (found.is_steep, found.is_winding)
    )
    is_long = np.diff(times) > _FEW * resolution(float(times[0]), guards.span)
    swung = (advance > 1.0) | (steep > 1.0)
    may_wind = np.flatnonzero(is_long & ~swung & (winding > 1.0))
    if len(may_wind):
        swung[may_wind] = _winds(found, guards, patience, moment, (times, x, z), values, may_wind)
    k = int(np.argmax(swung & is_long))
    if not (swung[k] and is_long[k]):
        return None, np.inf
    return k, _WITHIN * float(times[k + 1] - times[k]) / float(advance[k]) if advance[k] > 1.0 else np.inf


def _winds(
    found: Arguments,
    guards: Guards,
    patience: Patience,
    moment: Moment,
    points: tuple[Vector, Vector, Vector],
    values: Vector,
    rows: NDArray[np.int64],
) -> Truth:
    """Whether relations of a high degree may be passed after some rows, by the bounds of states; up to the first.

    `points`: Times, states and algebraic variables at all rows; shapes (n,), (nx, n) and (nz, n).
    `values`: The arguments there; shape (n, k).
    """
    winds = np.zeros(len(rows), dtype=bool)
    if found.windings is None:
        return winds
    (times, x, z), problem = points, moment.regime.problem
    owners = enumerate(moment.regime.active_set.owners)
    free = {int(r): k for k, (r, side) in owners if side < 0 and r not in patience.lost}
    known = [[(v, v) for v in numbers.tolist()] for numbers in (problem.u, problem.p, moment.m)]
    boxes = _boxes(times, x.T), _boxes(times, z.T)
    for j, k in enumerate(rows.tolist()):
        states = [list(map(tuple, box[k].tolist())) for box in boxes]
        bounds = found.windings.bounds([[(float(times[k]), float(times[k + 1]))], *states, *known])
        passed = [
            (n, free[r])
            for n, (r, (low, high)) in enumerate(zip(found.wound, bounds, strict=True))
            if r in free and low <= 0.0 <= high
        ]
        if not passed:
            continue
        numbers, columns = map(list, zip(*passed, strict=True))
        noise = STILL * guards.rates(float(times[k]), replace(moment, x=x[:, k], z=z[:, k]))[1][columns]
        # one that rests on zero is not passed
        if (np.abs(values[k : k + 2, found.is_wound][:, numbers]) > noise).any():
            patience.look(float(times[k]), [found.wound[n] for n in numbers])
            winds[j] = True
            break
    return winds


def _boxes(times: Vector, values: Vector) -> Vector:
    """Bounds of some values in each of n intervals, from those at their ends, shape (n + 1, k); shape (n, k, 2)."""
    low = np.fmin(lower_bounds(times, values), np.fmin(values[1:], values[:-1]))
    high = np.fmax(-lower_bounds(times, -values), np.fmax(values[1:], values[:-1]))
    return np.stack([low, high], axis=-1)


def _advances(found: Arguments) -> Vector:
    """The largest changes of the phases between two mesh points [rad]."""
    resolved, effective = (np.array(flags)[found.is_phase] for flags in (found.resolved, found.effective))
    return np.where(resolved, _RESOLVED_ADVANCE, np.where(effective, _EFFECTIVE_ADVANCE, _LARGEST_ADVANCE))
