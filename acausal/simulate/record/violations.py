"""What the rows of a run show to be violated, because no event does: assertions below `no_event`, and limits.

A run goes on beyond the limits `min` and `max` of a variable, and a note says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.analyse.events.assertions import Assert
from acausal.arrays import Vector
from acausal.diagnose.words import listed
from acausal.language.declarations.declaration import Kind
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner
from acausal.result.result import Result
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.events.errors import violated, warned
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Tolerances

_BEYOND = "beyond limits: "
_TOLERANCES = 10.0
"""Errors of a run [tolerances] beyond a limit that are no violation."""


@dataclass(frozen=True, eq=False)
class _Checked:
    """Assertions, and variables with limits: names, nominal magnitudes, and limits; shape of `limits` (2, variables).

    `values`: function of the truth values of the assertions and of the variables.
    """

    asserts: tuple[Assert, ...]
    names: tuple[str, ...]
    nominal: Vector
    limits: Vector
    values: NarrowFunction


def violations(recorder: Recorder, p: Vector, u: Vector, tolerances: Tolerances) -> tuple[str, ...]:
    """Notes of warnings that rows violate, and of variables beyond their limits.

    Raises EventError: AC503 for the first assertion that is no warning; the rows up to there remain.
    """
    compiled = recorder.compiled
    checked = _checked(compiled.common)
    if checked is None:
        return ()
    times, x, z, m = recorder.rows()
    found, n = checked.values.many(times[:, None], x.T, z.T, u, p, m.T), len(checked.asserts)
    broken, notes = ~(found[:, :n] > 0.5), []
    for k in np.argsort(np.argmax(broken, axis=0), kind="stable").tolist():
        asserted, rows = checked.asserts[k], np.flatnonzero(broken[:, k])
        if len(rows) and asserted.level == "error":
            recorder.cut(int(rows[0]))
            raise violated(compiled.name, float(times[rows[0]]), asserted)
        if len(rows):
            notes.append(warned(float(times[rows[0]]), asserted))
    return (*notes, *_beyond(checked, times, found[:, n:], tolerances))


def _beyond(checked: _Checked, times: Vector, values: Vector, tolerances: Tolerances) -> tuple[str, ...]:
    """The note on variables beyond their limits; `values` has the shape (rows, variables)."""
    if not values.shape[1]:
        return ()
    low, high = checked.limits
    allowed = _TOLERANCES * tolerances.of(np.nanmax(np.abs(values), axis=0, initial=0.0), checked.nominal)
    is_beyond = (values < low - allowed) | (values > high + allowed)
    texts = []
    for k in np.flatnonzero(is_beyond.any(axis=0)).tolist():
        row = int(np.argmax(is_beyond[:, k]))
        limit = f"min = {low[k]:g}" if values[row, k] < low[k] else f"max = {high[k]:g}"
        texts.append(f"{checked.names[k]} ({values[row, k]:.5g} at t = {times[row]:.9g} s, declared with {limit})")
    return (_BEYOND + listed(texts, 4),) if texts else ()


def on_limits(result: Result) -> tuple[str, ...]:
    """The notes of a run on variables beyond their limits."""
    notes = result.stats["notes"]
    assert isinstance(notes, tuple)
    return tuple(note for note in notes if note.startswith(_BEYOND))


@once_per_owner
def _checked(compiled: CompiledModel) -> _Checked | None:
    """What is checked in a model that owns its functions (`common`); None if there is nothing."""
    asserts = tuple(a for a in compiled.state_events.asserts if a.in_rows)
    limited = _limited(compiled)
    if not (asserts or limited):
        return None
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    images = compiled.solution.structure.reduced.image
    nodes = [*(a.condition for a in asserts), *(images[scalar] for scalar, _ in limited)]
    values = NarrowFunction("checked", symbols.inputs, builder.column(builder.replaced(nodes)))
    names = tuple(compiled.flat.scalar_name(scalar) for scalar, _ in limited)
    limits = np.array([[d.min for _, d in limited], [d.max for _, d in limited]])
    return _Checked(asserts, names, np.array([d.nominal for _, d in limited]), limits, values)


def _limited(compiled: CompiledModel) -> list[tuple[int, Any]]:
    """Flat scalars with limits and their declarations; inputs of the model are refused beyond them."""
    reduced, given = compiled.solution.structure.reduced, set(compiled.inputs)
    return [
        (v.first + k, v.declaration)
        for v in compiled.flat.variables
        if v.declaration.kind is not Kind.PARAMETER
        and not (math.isinf(v.declaration.min) and math.isinf(v.declaration.max))
        for k in range(v.size)
        if v.first + k not in reduced.left_out and compiled.flat.scalar_name(v.first + k) not in given
    ]
