"""Checks of what a run has recorded: prescribed motions that jump, and integers that became fractions.

A prescribed motion is differentiated: a flange that follows a step would take an impulse. Branches of `where` are
differentiated one by one, so that what happens at the switch is lost. A signal of time that jumps moves what follows it
over a distance, or to another speed, in no time: refused. Corners of a ramp whose rate is differentiated in turn are
noted: the motion is right, only forces lack the impulses there.

A constraint that changes at an event, as a gear that is shifted does, makes what follows from the states jump in the
same way. By Newton's law the states would jump too, through the Jacobian of the constraint: refused when it happens.

Integers: literals and start values are checked before (AC147, AC046). What a `reset` or an equation gives to an integer
may be any expression, whose value only the run knows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from weakref import WeakKeyDictionary

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
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Tolerances

# Two branches meet to this share of their size; those of variables, which meet where a guard was located, to so many
# tolerances, or to this.
_MEETING, _MANY, _LEAST = 1e-9, 100.0, 1e-6
_NO_IMPULSE = "what follows it would need an impulse, which is not computed"
_PRESCRIBE = "prescribe it through a filter (FirstOrder, SecondOrder) or a ramp, or drive it by a force"
# An integer that passes through a solver comes back with its rounding.
WHOLE = 1e-6


def refuse_jumps(
    compiled: CompiledModel, instants: Sequence[float], modes: Callable[[float, float], Vector], p: Vector
) -> None:
    """Refuse prescribed motions that jump.

    Raises UsageError: AC039 with the first jump.

    `instants`, `modes`: Start, time events and stop of a run; the modes between two of them, shape (nm,).
    """
    switched = functions_of(compiled).switched
    if not switched or len(instants) < 3:
        return
    values = functions_of(compiled).switches
    for a, t, b in zip(instants, instants[1:], instants[2:], strict=False):
        before, after = (values(t, p, modes(*side))[0] for side in ((a, t), (t, b)))
        for j in np.flatnonzero(np.abs(after - before) > _MEETING * (1.0 + np.abs(before) + np.abs(after))).tolist():
            text = compiled.solution.structure.reduced.text(switched[j])
            raise UsageError(
                "AC039",
                f"{compiled.name}: a prescribed motion jumps at t = {t:.9g} s, from {before[j]:.6g} to {after[j]:.6g}",
                evidence=[f"the derivative is needed of {text}"],
                cause=_NO_IMPULSE,
                help=_PRESCRIBE,
            )


def refuse_leaps(recorder: Recorder, tolerances: Tolerances) -> None:
    """Refuse what a run has recorded if a variable leaps at an event that is differentiated and follows from states.

    A `when` that resets a state may make others jump with it.

    Raises EventError: AC507 with the first event.
    """
    compiled = recorder.compiled
    led = _led(compiled)
    if not led:
        return
    times, x, _, _ = recorder.rows()
    after = np.flatnonzero(np.diff(times) == 0.0) + 1
    n = compiled.n_dynamic
    after = after[(x[:n, after] == x[:n, after - 1]).all(axis=0)]
    if not after.size:
        return
    sides = _sides(recorder, led, after)
    most = tolerances.scaled(_MANY, _LEAST).relative
    size = np.array([abs(size) for _, _, size in led]) + np.maximum(*(np.abs(side) for side in sides))
    far = np.abs(sides[1] - sides[0]) > most * size
    if not far.any():
        return
    k = int(np.argmax(far.any(axis=1)))
    leaping = np.flatnonzero(far[k]).tolist()
    names = [led[j][1] for j in leaping]
    raise EventError(
        "AC507",
        f"{compiled.name}: {listed(names, 3)} would have to jump at t = {times[after[k]]:.9g} s",
        where=made_at(compiled.flat, component_of(compiled.flat, names[0])),
        evidence=[
            f"{led[j][1]} = {sides[0][k, j]:.6g} before, {sides[1][k, j]:.6g} after, with the same states"
            for j in leaping[:4]
        ],
        cause="a constraint changes at this event, and no force is named whose impulse comes with it",
        help="let it change continuously, connect it through a spring and damper or a clutch, "
        "or state the jump yourself: when(..., reset(velocity, value, by=force))",
    )


def corners(recorder: Recorder) -> tuple[str, ...]:
    """The note on rates of prescribed motions that jump in a run and are differentiated: impulses that no row shows.

    Raises UsageError: AC039 for what jumps and is no rate itself, at an instant that only the run has found.
    """
    led = _led(recorder.compiled, prescribed=True)
    times = recorder.rows()[0] if led else np.zeros(0)
    after = np.flatnonzero(np.diff(times) == 0.0) + 1
    if not after.size:
        return ()
    before, behind = _sides(recorder, led, after)
    size = np.array([abs(size) for _, _, size in led]) + np.maximum(np.abs(before), np.abs(behind))
    far = np.abs(behind - before) > _LEAST * size
    rows = np.flatnonzero(far.any(axis=1))
    if not rows.size:
        return ()
    j = int(np.argmax(far[rows[0]]))
    _refuse_jump(recorder.compiled, led[j][1], float(times[after[rows[0]]]), before[rows[0], j], behind[rows[0], j])
    count = len(np.unique(times[after[rows]]))
    more = f" and at {count - 1} more" if count > 1 else ""
    return (
        f"{led[j][1]} is prescribed and jumps from {before[rows[0], j]:.6g} to {behind[rows[0], j]:.6g} at "
        f"t = {times[after[rows[0]]]:.9g} s{more}: what moves with it takes an impulse there that no force shows; "
        "a filter (SecondOrder) rounds such corners off",
    )


def _refuse_jump(compiled: CompiledModel, name: str, t: float, before: float, behind: float) -> None:
    """AC039 for a prescribed variable that has jumped, unless it is the rate of another: that motion has a corner."""
    reduced = compiled.solution.structure.reduced
    if any(reduced.name(v) == name for v in reduced.pool.integral_of):
        return
    raise UsageError(
        "AC039",
        f"{compiled.name}: a prescribed motion jumps at t = {t:.9g} s, from {before:.6g} to {behind:.6g}",
        evidence=[f"the derivative is needed of {name}"],
        cause=_NO_IMPULSE,
        help=_PRESCRIBE,
    )


def _sides(recorder: Recorder, led: list[tuple[int, str, float]], after: NDArray[np.int64]) -> tuple[Vector, Vector]:
    """Values of such variables before and after events whose second rows are given; shape (events, variables)."""
    times, x, z, m = recorder.rows()
    columns = [column for column, _, _ in led]
    before, behind = (recorder.observe(times[k], x[:, k], z[:, k], m[:, k], columns) for k in (after - 1, after))
    return before, behind


# The same for all runs of a model, and a second of work where there are hundreds of relations.
_LED: WeakKeyDictionary[CompiledModel, dict[bool, list[tuple[int, str, float]]]] = WeakKeyDictionary()


def _led(compiled: CompiledModel, prescribed: bool = False) -> list[tuple[int, str, float]]:
    """Such variables: column of the trajectories, name, nominal magnitude."""
    known = _LED.setdefault(compiled, {})
    if prescribed not in known:
        reduced = compiled.solution.structure.reduced
        found = switched_dependents(compiled.solution, prescribed)
        columns = {node: k for k, node in enumerate(compiled.columns)} if found else {}
        nodes = ((v, reduced.pool.var(v)) for v in found)
        known[prescribed] = [(columns[n], reduced.name(v), nominal(reduced, v)) for v, n in nodes if n in columns]
    return known[prescribed]


_INTEGERS: WeakKeyDictionary[CompiledModel, list[int]] = WeakKeyDictionary()


def integers(compiled: CompiledModel) -> list[int]:
    """Indices of the integers among the states."""
    if compiled not in _INTEGERS:
        names = {
            v.path + suffix
            for v in compiled.flat.variables
            if v.declaration.integer
            for suffix in suffixes(v.declaration.shape)
        }
        _INTEGERS[compiled] = [k for k, name in enumerate(compiled.states) if name in names] if names else []
    return _INTEGERS[compiled]


def refuse_fractions(recorder: Recorder) -> None:
    """Refuse what a run has recorded if an integer has a value that is not whole.

    Raises EventError: AC147 with the first such value.
    """
    compiled = recorder.compiled
    places = integers(compiled)
    if not places:
        return
    times, x, _, _ = recorder.rows()
    values = x[places]
    fractions = np.abs(values - np.round(values)) > WHOLE * np.maximum(1.0, np.abs(values))
    if not fractions.any():
        return
    row = int(np.argmax(fractions.any(axis=0)))
    k = int(np.argmax(fractions[:, row]))
    name = compiled.states[places[k]]
    flat = compiled.flat
    stated: list[FlatAssignment | FlatWhen] = [
        *(a for a in flat.assignments if flat.scalar_name(a.scalar) == name),
        *(w for w in flat.whens if any(flat.scalar_name(scalar) == name for scalar, _ in w.actions)),
    ]
    raise EventError(
        "AC147",
        f"{compiled.name}: {name} is an integer and became {values[k, row]:.9g} at t = {times[row]:.9g} s",
        where=stated_places(flat, stated) or made_at(flat, component_of(flat, name)),
        cause="the right side of its equation, or of a reset, is not whole there",
        help="round it, floor(x), or declare the variable by discrete()",
    )
