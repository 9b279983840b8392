"""Checks of the recorded rows of a run: prescribed motions that jump, and integers that became fractions.

A prescribed motion is differentiated: a flange that follows a step would take an impulse. As the branches of `where`
are differentiated separately, the impulse at the switch is lost. A signal of time that jumps changes the position or
the speed of a motion that follows it instantly, which is refused. Corners of a ramp whose rate is differentiated in
turn are only noted: the motion is right, but the forces lack the impulses there.

A constraint that changes at an event, such as a gear shift, makes variables that follow from the states jump in the
same way. By Newton's law the states would jump too, through the Jacobian of the constraint; this is refused when it
happens.

Literals and start values of integers are checked before the run (AC147, AC046). A `reset` or an equation may give an
integer the value of any expression, which is only known in the run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.state_events import switched_dependents
from acausal.arrays import Vector
from acausal.diagnose.words import component_of, listed, made_at
from acausal.diagnose.words import places as stated_places
from acausal.errors import EventError, UsageError
from acausal.flatten.flat import FlatAssignment, FlatWhen, suffixes
from acausal.flatten.reduced import nominal
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Tolerances

# A motion counts as continuous if both sides of a switch agree to this fraction of their size. Variables, which switch
# where a guard was located, must agree to so many tolerances, or to `_LEAST_JUMP` if that is larger.
_CONTINUOUS, _MOST_TOLERANCES, _LEAST_JUMP = 1e-9, 100.0, 1e-6
_NO_IMPULSE = "a motion that follows it would need an impulse, which is not computed"
_PRESCRIBE = "prescribe it through a filter (FirstOrder, SecondOrder) or a ramp, or drive it by a force"
# Integers pass through solvers, which add rounding errors.
WHOLE = 1e-6


def refuse_jumps(
    compiled: CompiledModel, instants: Sequence[float], modes: Callable[[float, float], Vector], p: Vector
) -> None:
    """Refuse prescribed motions that jump.

    Raises UsageError: AC039 with the first jump.

    `instants` are the start, the time events and the stop of a run [s]; `modes(a, b)` are the modes between two of
    them, shape (nm,).
    """
    switched = functions_of(compiled).switched
    if not switched or len(instants) < 3:
        return
    values = functions_of(compiled).switches
    for a, t, b in zip(instants, instants[1:], instants[2:], strict=False):
        before, after = (values(t, p, modes(*side))[0] for side in ((a, t), (t, b)))
        for j in np.flatnonzero(np.abs(after - before) > _CONTINUOUS * (1.0 + np.abs(before) + np.abs(after))).tolist():
            text = compiled.solution.structure.reduced.text(switched[j])
            raise UsageError(
                "AC039",
                f"{compiled.name}: a prescribed motion jumps at t = {t:.9g} s, from {before[j]:.6g} to {after[j]:.6g}",
                evidence=[f"the derivative is needed of {text}"],
                cause=_NO_IMPULSE,
                help=_PRESCRIBE,
            )


def refuse_leaps(recorder: Recorder, tolerances: Tolerances) -> None:
    """Refuse a run in which a variable that follows from states and is differentiated jumps at an event.

    Events at which a `when` resets a state are exempt, as other variables may jump with the state.

    Raises EventError: AC507 with the first such event.
    """
    compiled = recorder.compiled
    dependents = _dependents(compiled)
    if not dependents:
        return
    times, x, _, _ = recorder.rows()
    after = np.flatnonzero(np.diff(times) == 0.0) + 1
    n = compiled.n_dynamic
    after = after[(x[:n, after] == x[:n, after - 1]).all(axis=0)]
    if not after.size:
        return
    sides = _sides(recorder, dependents, after)
    largest_jump = tolerances.scaled(_MOST_TOLERANCES, _LEAST_JUMP).relative
    size = np.array([abs(size) for _, _, size in dependents]) + np.maximum(*(np.abs(side) for side in sides))
    has_jumped = np.abs(sides[1] - sides[0]) > largest_jump * size
    if not has_jumped.any():
        return
    k = int(np.argmax(has_jumped.any(axis=1)))
    jumping = np.flatnonzero(has_jumped[k]).tolist()
    names = [dependents[j][1] for j in jumping]
    raise EventError(
        "AC507",
        f"{compiled.name}: {listed(names, 3)} would have to jump at t = {times[after[k]]:.9g} s",
        where=made_at(compiled.flat, component_of(compiled.flat, names[0])),
        evidence=[
            f"{dependents[j][1]} = {sides[0][k, j]:.6g} before, {sides[1][k, j]:.6g} after, with the same states"
            for j in jumping[:4]
        ],
        cause="a constraint changes at this event, and the model names no force with a corresponding impulse",
        help="let it change continuously, connect it through a spring and damper or a clutch, "
        "or state the jump explicitly: when(..., reset(velocity, value, by=force))",
    )


def corners(recorder: Recorder) -> tuple[str, ...]:
    """The note on rates of prescribed motions that jump and are differentiated: forces lack the impulses there.

    Raises UsageError: AC039 for a motion that jumps itself, at an instant that was only found in the run.
    """
    dependents = _dependents(recorder.compiled, prescribed=True)
    times = recorder.rows()[0] if dependents else np.zeros(0)
    after = np.flatnonzero(np.diff(times) == 0.0) + 1
    if not after.size:
        return ()
    before, following = _sides(recorder, dependents, after)
    size = np.array([abs(size) for _, _, size in dependents]) + np.maximum(np.abs(before), np.abs(following))
    has_jumped = np.abs(following - before) > _LEAST_JUMP * size
    rows = np.flatnonzero(has_jumped.any(axis=1))
    if not rows.size:
        return ()
    j = int(np.argmax(has_jumped[rows[0]]))
    sides = before[rows[0], j], following[rows[0], j]
    _refuse_jump(recorder.compiled, dependents[j][1], float(times[after[rows[0]]]), *sides)
    count = len(np.unique(times[after[rows]]))
    more = f" and at {count - 1} more" if count > 1 else ""
    return (
        f"{dependents[j][1]} is prescribed and jumps from {sides[0]:.6g} to {sides[1]:.6g} at "
        f"t = {times[after[rows[0]]]:.9g} s{more}: bodies that move with it take an impulse there, which no force "
        "shows; a filter (SecondOrder) rounds such corners off",
    )


def _refuse_jump(compiled: CompiledModel, name: str, t: float, before: float, following: float) -> None:
    """Raise AC039 for a prescribed variable that jumped, unless it is a rate: then the motion only has a corner."""
    reduced = compiled.solution.structure.reduced
    if any(reduced.name(v) == name for v in reduced.pool.integral_of):
        return
    raise UsageError(
        "AC039",
        f"{compiled.name}: a prescribed motion jumps at t = {t:.9g} s, from {before:.6g} to {following:.6g}",
        evidence=[f"the derivative is needed of {name}"],
        cause=_NO_IMPULSE,
        help=_PRESCRIBE,
    )


def _sides(
    recorder: Recorder, dependents: list[tuple[int, str, float]], after: NDArray[np.int64]
) -> tuple[Vector, Vector]:
    """Values of these variables before and after events, shape (events, variables); `after` are their second rows."""
    times, x, z, m = recorder.rows()
    columns = [column for column, _, _ in dependents]
    before, following = (recorder.observe(times[k], x[:, k], z[:, k], m[:, k], columns) for k in (after - 1, after))
    return before, following


@once_per_owner  # it takes a second if there are hundreds of relations
def _dependents(compiled: CompiledModel, prescribed: bool = False) -> list[tuple[int, str, float]]:
    """Differentiated variables that depend on modes: column of the trajectories, name, nominal magnitude."""
    reduced = compiled.solution.structure.reduced
    switched = switched_dependents(compiled.solution, prescribed)
    columns = {node: k for k, node in enumerate(compiled.columns)} if switched else {}
    nodes = ((v, reduced.pool.var(v)) for v in switched)
    return [(columns[n], reduced.name(v), nominal(reduced, v)) for v, n in nodes if n in columns]


@once_per_owner
def integers(compiled: CompiledModel) -> list[int]:
    """Indices of the integers among the states."""
    whole = [v for v in compiled.flat.variables if v.declaration.integer]
    names = {v.path + suffix for v in whole for suffix in suffixes(v.declaration.shape)}
    return [k for k, name in enumerate(compiled.states) if name in names] if names else []


def refuse_fractions(recorder: Recorder) -> None:
    """Refuse a run in which an integer has a value that is not whole.

    Raises EventError: AC147 with the first such value.
    """
    compiled = recorder.compiled
    indices = integers(compiled)
    if not indices:
        return
    times, x, _, _ = recorder.rows()
    values = x[indices]
    fractions = np.abs(values - np.round(values)) > WHOLE * np.maximum(1.0, np.abs(values))
    if not fractions.any():
        return
    row = int(np.argmax(fractions.any(axis=0)))
    k = int(np.argmax(fractions[:, row]))
    name = compiled.states[indices[k]]
    flat = compiled.flat
    statements: list[FlatAssignment | FlatWhen] = [
        *(a for a in flat.assignments if flat.scalar_name(a.scalar) == name),
        *(w for w in flat.whens if any(flat.scalar_name(scalar) == name for scalar, _ in w.actions)),
    ]
    raise EventError(
        "AC147",
        f"{compiled.name}: {name} is an integer and became {values[k, row]:.9g} at t = {times[row]:.9g} s",
        where=stated_places(flat, statements) or made_at(flat, component_of(flat, name)),
        cause="the right side of its equation, or of a reset, is not a whole number there",
        help="round it, floor(x), or declare the variable by discrete()",
    )
