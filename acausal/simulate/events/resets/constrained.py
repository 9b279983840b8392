"""States behind a `reset` in a model whose constraints are stabilised: they satisfy the constraints, or the run ends.

A reset changes some states and keeps the others. Where a constraint binds both, as a loop of joints binds their speeds,
the others have to follow, by an impulse of the constraint. If the reset states determine them through the constraints,
no mass is asked for: a crank that is given a speed turns all links of its loop. If they do not, Newton's law decides,
where the equations of motion tell on what the impact acts (`balance.py`); else the run is refused.
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

_MOST = 20  # steps of Newton's method
_HOLDS, _SOLVED = 1e-7, 1e-10  # what a constraint may be off by what moves it: at an event, and when it is solved
_DRIFT = 3.0  # the same by how far the run was off before
_RANK = 1e-6  # smallest singular value that counts, by the largest


def bound(compiled: CompiledModel, places: Collection[int]) -> list[int]:
    """Those of these states that a stabilised constraint binds."""
    if not compiled.solution.structure.invariants:
        return []
    return sorted(set(places) & set(np.flatnonzero(_binds(compiled).any(axis=0)).tolist()))


def followed(
    compiled: CompiledModel,
    t: float,
    before: Vector,
    after: Vector,
    set_by: Collection[int],
    numbers: tuple[Vector, Vector, Vector, Vector],
) -> Vector:
    """States that keep what was reset and satisfy the constraints; `numbers` are z, u, p and m.

    Raises EventError: AC508 where the constraints do not determine the others, or cannot be satisfied.

    `before`, `after`: States, shape (nx,), before and after the `reset`s at the places `set_by`.
    """
    reset = bound(compiled, set_by)
    if not reset:
        return after
    binds = _binds(compiled)
    was, _ = _off(compiled, t, before, numbers)
    allowed = max(_HOLDS, _DRIFT * float(was.max()))
    broken = _off(compiled, t, after, numbers)[0] > allowed
    if not broken.any():
        return after
    held = np.zeros(len(after), dtype=bool)
    held[reset] = True
    for k in np.flatnonzero(~broken):
        # positions that hold where speeds do not
        if any((binds[k] <= binds[j]).all() and (binds[k] < binds[j]).any() for j in np.flatnonzero(broken)):
            held |= binds[k]
    joined, free = _joined(binds, broken, held)
    struck = _struck(compiled, t, before, after, reset, numbers)
    if struck is not None and (_off(compiled, t, struck, numbers)[0] <= allowed).all():
        return struck
    x, rank = _solved(compiled, t, after, np.flatnonzero(joined), np.flatnonzero(free), numbers)
    off, _ = _off(compiled, t, x, numbers)
    if rank < free.sum() or not (off[joined] <= _SOLVED).all() or not (off <= allowed).all():
        raise _open(compiled, t, reset, broken, np.flatnonzero(free).tolist() if rank < free.sum() else [])
    return x


def _struck(
    compiled: CompiledModel,
    t: float,
    before: Vector,
    after: Vector,
    reset: list[int],
    numbers: tuple[Vector, Vector, Vector, Vector],
) -> Vector | None:
    """States behind an impact on these velocities; None where the balance of impulses is not known."""
    slopes = _at(compiled, t, before, numbers)[1]
    found = directions(compiled, reset, slopes, (t, before, *numbers))
    if found is None:
        return None
    own = found[reset]
    if np.linalg.matrix_rank(own / np.diag(own), tol=_RANK) < len(reset):
        return None
    struck = after + found @ np.linalg.solve(own, after[reset] - before[reset])
    struck[reset] = after[reset]
    return struck


def _joined(binds: Truth, broken: Truth, held: Truth) -> tuple[Truth, Truth]:
    """Constraints that have to be solved together with the broken ones, and the states that may move for it."""
    joined = broken
    while True:
        free = binds[joined].any(axis=0) & ~held
        more = joined | binds[:, free].any(axis=1)
        if (more == joined).all():
            return joined, free
        joined = more


def _solved(
    compiled: CompiledModel,
    t: float,
    x: Vector,
    rows: NDArray[np.intp],
    free: NDArray[np.intp],
    numbers: tuple[Vector, Vector, Vector, Vector],
) -> tuple[Vector, int]:
    """States that satisfy these constraints by moving those that are free, and the rank of their slope by these."""
    x, rank, scale = x.copy(), 0, compiled.nominal_x[free]
    for _ in range(_MOST if free.size else 0):
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


def _off(
    compiled: CompiledModel, t: float, x: Vector, numbers: tuple[Vector, Vector, Vector, Vector]
) -> tuple[Vector, Vector]:
    """How far each constraint is off, by what moves it; and their slopes."""
    g, slope = _at(compiled, t, x, numbers)
    could = np.abs(slope) @ (np.abs(x) + compiled.nominal_x)
    return np.nan_to_num(np.abs(g) / np.maximum(could, 1e-300), nan=np.inf), slope


def _binds(compiled: CompiledModel) -> Truth:
    """Which states stand in which constraints, shape (constraints, nx)."""
    found = np.zeros((len(compiled.solution.structure.invariants), len(compiled.states)), dtype=bool)
    rows, columns = compiled.constraints.sparsity_out(1).get_triplet()
    found[rows, columns] = True
    return found


def _open(compiled: CompiledModel, t: float, reset: list[int], broken: Truth, free: list[int]) -> EventError:
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
