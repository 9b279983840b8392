"""Integers that became fractions in a run.

Literals and start values are checked before (AC147, AC046). What a `reset` or an equation gives to an integer may be
any expression, whose value only the run knows.
"""

from __future__ import annotations

import numpy as np

from acausal.diagnose.words import component_of, made_at
from acausal.errors import EventError
from acausal.flatten.flat import suffixes
from acausal.simulate.record.record import Recorder

# An integer that passes through a solver comes back with its rounding.
_WHOLE = 1e-6


def refuse_fractions(recorder: Recorder) -> None:
    """Refuse what a run has recorded if an integer has a value that is not whole.

    Raises EventError: AC147 with the first such value.
    """
    compiled = recorder.compiled
    integers = {
        v.path + suffix
        for v in compiled.flat.variables
        if v.declaration.integer
        for suffix in suffixes(v.declaration.shape)
    }
    places = [k for k, name in enumerate(compiled.states) if name in integers] if integers else []
    if not places:
        return
    times, x, _, _ = recorder.rows()
    values = x[places]
    fractions = np.abs(values - np.round(values)) > _WHOLE * np.maximum(1.0, np.abs(values))
    if not fractions.any():
        return
    row = int(np.argmax(fractions.any(axis=0)))
    k = int(np.argmax(fractions[:, row]))
    name = compiled.states[places[k]]
    raise EventError(
        "AC147",
        f"{compiled.name}: {name} is an integer and became {values[k, row]:.9g} at t = {times[row]:.9g} s",
        where=made_at(compiled.flat, component_of(compiled.flat, name)),
        cause="the right side of its equation, or of a reset, is not whole there",
        help="round it, floor(x), or declare the variable by discrete()",
    )
