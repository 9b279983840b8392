"""States after a `reset` in a model with stabilised constraints: they satisfy the constraints, or the run is refused.

A reset changes some states and keeps the others. If a constraint binds both, as a loop of joints binds their speeds,
the others have to follow, by an impulse of the constraint. If the constraints determine them from the reset states, no
mass matters: a crank that is given a speed turns all links of its loop. Otherwise Newton's law determines them, if the
equations of motion show on what the impact acts (`balance.py`); if they do not, the run is refused.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.diagnose.words import line, listed
from acausal.errors import EventError
from acausal.flatten.flat import span_of
from acausal.lower.compiled import CompiledModel
from acausal.simulate.events.resets.balance import directions
from acausal.simulate.record.project import constraints

_MOST_ITERATIONS = 20  # iterations of Newton's method
_HOLDS, _SOLVED = 1e-7, 1e-10  # largest relative error of a constraint at an event, and when it is solved
_DRIFT = 3.0  # largest error as a multiple of that before the event
_STEPS = 64  # in which states follow a reset of a position
_RANK = 1e-6  # smallest singular value that counts, relative to the largest


def bound(compiled: CompiledModel, states: Collection[int]) -> list[int]:
    """The indices of those states, among `states`, that a stabilised constraint binds."""
    if not compiled.solution.structure.invariants:
        return []
    return sorted(set(states) & set(np.flatnonzero(_binds(compiled).any(axis=0)).tolist()))


def followed(
    compiled: CompiledModel,
    t: float,
    before: Vector,
    after: Vector,
    set_by: Collection[int],
    numbers: tuple[Vector, Vector, Vector, Vector],
) -> Vector:
    """States that keep the values that were reset and satisfy the constraints, shape (nx,).

    Raises EventError (AC508) if the constraints do not determine the others, or cannot be satisfied.

    `before`, `after`: States before and after the `reset`s; shape (nx,).
    `set_by`: Indices of the states that were reset.
    `numbers`: z, u, p and m.
    """
    reset = bound(compiled, set_by)
    if not reset:
        return after
    binds = _binds(compiled)
    errors_before, _ = _errors(compiled, t, before, numbers)
    allowed = max(_HOLDS, _DRIFT * float(errors_before.max()))
    broken = _errors(compiled, t, after, numbers)[0] > allowed
    if not broken.any():
        return after
    held = np.zeros(len(after), dtype=bool)
    held[reset] = True
    for k in np.flatnonzero(~broken):
        # positions are kept if they satisfy their constraint and only that of the speeds is violated
        if any((binds[k] <= binds[j]).all() and (binds[k] < binds[j]).any() for j in np.flatnonzero(broken)):
            held |= binds[k]
    coupled, free = _coupled(binds, broken, held)
    after_impact = _after_impact(compiled, t, before, after, reset, numbers)
    if after_impact is not None and (_errors(compiled, t, after_impact, numbers)[0] <= allowed).all():
        return after_impact
    x, rank = _followed_along(compiled, t, before, after, np.flatnonzero(coupled), np.flatnonzero(free), numbers)
    errors, _ = _errors(compiled, t, x, numbers)
    if rank < free.sum() or not (errors[coupled] <= _SOLVED).all() or not (errors <= allowed).all():
        raise _undetermined(compiled, t, reset, broken, np.flatnonzero(free).tolist() if rank < free.sum() else [])
    return x


def _after_impact(
    compiled: CompiledModel,
    t: float,
    before: Vector,
    after: Vector,
    reset: list[int],
    numbers: tuple[Vector, Vector, Vector, Vector],
) -> Vector | None:
    """States after an impact on these velocities; None if the balance of impulses is not known."""
    slopes = _at(compiled, t, before, numbers)[1]
    jumps = directions(compiled, reset, slopes, (t, before, *numbers))
    if jumps is None:
        return None
    responses = jumps[reset]
    if np.linalg.matrix_rank(responses / np.diag(responses), tol=_RANK) < len(reset):
        return None
    after_impact = after + jumps @ np.linalg.solve(responses, after[reset] - before[reset])
    after_impact[reset] = after[reset]
    return after_impact


def _coupled(binds: Truth, broken: Truth, held: Truth) -> tuple[Truth, Truth]:
    """Constraints that have to be solved together with the broken ones, and the states that may change."""
    coupled = broken
    while True:
        free = binds[coupled].any(axis=0) & ~held
        larger = coupled | binds[:, free].any(axis=1)
        if (larger == coupled).all():
            return coupled, free
        coupled = larger


def _followed_along(
    compiled: CompiledModel,
    t: float,
    before: Vector,
    after: Vector,
    rows: NDArray[np.intp],
    free: NDArray[np.intp],
    numbers: tuple[Vector, Vector, Vector, Vector],
) -> tuple[Vector, int]:
    """`_solved` for the states after the resets, in small steps from those before where constraints are nonlinear.

    A loop has several positions with the same angle of its crank, between which it would have to be taken apart.
    Newton's method from the position before a large jump may find any of them.
    """
    left, right = (_at(compiled, t, x, numbers)[1][rows[:, None], free] for x in (before, after))
    steps = 1 if np.allclose(left, right, rtol=1e-9, atol=0.0) else _STEPS
    x, rank = after, 0
    for k in range(1, steps + 1):
        start = after + (1.0 - k / steps) * (before - after)
        start[free] = x[free]
        x, rank = _solved(compiled, t, start, rows, free, numbers)
        if not (_errors(compiled, t, x, numbers)[0][rows] <= _HOLDS).all():
            break
    return x, rank


def _solved(
    compiled: CompiledModel,
    t: float,
    x: Vector,
    rows: NDArray[np.intp],
    free: NDArray[np.intp],
    numbers: tuple[Vector, Vector, Vector, Vector],
) -> tuple[Vector, int]:
    """States in which the free ones satisfy the constraints `rows`, and the rank of the Jacobian by these."""
    x, rank, scale = x.copy(), 0, compiled.nominal_x[free]
    for _ in range(_MOST_ITERATIONS if free.size else 0):
        g, slope = _at(compiled, t, x, numbers)
        slope = slope[rows[:, None], free] * scale
        size = np.maximum(np.linalg.norm(slope, axis=1), 1e-300)
        if not (np.isfinite(slope).all() and np.isfinite(g).all()):
            break
        step, _, rank, _ = np.linalg.lstsq(slope / size[:, None], -g[rows] / size, rcond=_RANK)
        x[free] += scale * step
        if np.abs(step).max() <= _SOLVED * (1.0 + np.abs(x[free] / scale).max()):
            break
    return x, int(rank)


def _at(
    compiled: CompiledModel, t: float, x: Vector, numbers: tuple[Vector, Vector, Vector, Vector]
) -> tuple[Vector, Vector]:
    z, u, p, m = numbers
    g, slope = constraints(compiled, np.array([t]), x[:, None], z[:, None], u, p, m)
    return g[0], slope[0]


def _errors(
    compiled: CompiledModel, t: float, x: Vector, numbers: tuple[Vector, Vector, Vector, Vector]
) -> tuple[Vector, Vector]:
    """The error of each constraint relative to the sizes of its terms, and the slopes."""
    g, slope = _at(compiled, t, x, numbers)
    could = np.abs(slope) @ (np.abs(x) + compiled.nominal_x)
    return np.nan_to_num(np.abs(g) / np.maximum(could, 1e-300), nan=np.inf), slope


def _binds(compiled: CompiledModel) -> Truth:
    """Which states occur in which constraints, shape (constraints, nx)."""
    found = np.zeros((len(compiled.solution.structure.invariants), len(compiled.states)), dtype=bool)
    rows, columns = compiled.constraints.sparsity_out(1).get_triplet()
    found[rows, columns] = True
    return found


def _undetermined(compiled: CompiledModel, t: float, reset: list[int], broken: Truth, free: list[int]) -> EventError:
    structure = compiled.solution.structure
    equations = list(dict.fromkeys(structure.flat_equation(structure.invariants[k][0]) for k in np.flatnonzero(broken)))
    names = [compiled.states[k] for k in reset]
    clauses = [c for c in compiled.state_events.clauses if {place for place, _ in c.actions} & set(reset)]
    if free:
        others = [compiled.states[k] for k in free]
        fact, help_ = f"leave open what becomes of {listed(others, 4)}", f"reset some of {listed(others, 4)} as well"
    else:
        fact, help_ = "cannot be satisfied then", "reset it to a value that the others can follow"
    return EventError(
        "AC508",
        f"{compiled.name}: {listed(names, 4)} is reset at t = {t:.9g} s, and the constraints {fact}",
        where=(*span_of(compiled.flat.equations[equations[0]]), *(c.where for c in clauses[:2])),
        evidence=[
            *(c.text for c in clauses[:2]),
            "does not hold with the values before and after for all others:",
            *(line(compiled.flat, compiled.flat.equations[e]).strip() for e in equations[:3]),
        ],
        cause="the others follow by impulses of the constraints, and no single equation of motion says what the impact "
        "acts on",
        help=f"{help_}, or name the force of the impact: reset(velocity, value, by=force)",
    )
