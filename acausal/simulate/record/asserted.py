"""Assertions that no event shows to be violated, because of a `no_event`: the rows of a run do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.analyse.events.assertions import Assert
from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.events.errors import violated, warned
from acausal.simulate.record.record import Recorder


@dataclass(frozen=True, eq=False)
class _Unlocated:
    """Assertions and the function of their truth values."""

    asserts: tuple[Assert, ...]
    truth: NarrowFunction


def check_rows(recorder: Recorder, p: Vector, u: Vector) -> tuple[str, ...]:
    """Notes of the warnings among such assertions that are violated in a row.

    Raises EventError: AC503 for the first other one; the rows up to there remain.
    """
    compiled = recorder.compiled
    found = _unlocated(compiled.common)
    if found is None:
        return ()
    times, x, z, m = recorder.rows()
    broken = ~(found.truth.many(times[:, None], x.T, z.T, u, p, m.T) > 0.5)
    notes = []
    for k in np.argsort(np.argmax(broken, axis=0), kind="stable").tolist():
        asserted, rows = found.asserts[k], np.flatnonzero(broken[:, k])
        if len(rows) and asserted.level == "error":
            recorder.cut(int(rows[0]))
            raise violated(compiled.name, float(times[rows[0]]), asserted)
        if len(rows):
            notes.append(warned(float(times[rows[0]]), asserted))
    return tuple(notes)


@once_per_owner
def _unlocated(compiled: CompiledModel) -> _Unlocated | None:
    """Those of a model that owns its functions (`common`); None if there are none."""
    asserts = [a for a in compiled.state_events.asserts if a.in_rows]
    if not asserts:
        return None
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    values = builder.column(builder.replaced([a.condition for a in asserts]))
    return _Unlocated(tuple(asserts), NarrowFunction("asserted", symbols.inputs, values))
