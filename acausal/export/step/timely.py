"""Relations of time and clocks within one exported step.

A step takes relations of time as they are just after its start, and keeps them constant to its end. If a relation
changes or a clock ticks within the step, this acts at its end. Such steps are known exactly and reported by a flag.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel

# Relative tolerance of intervals of clocks, and of positions within a step.
TICK = 1e-9
# An instant closer to the end of a step than this fraction of the step, plus rounding errors, counts as at the end.
_AT_END, _ROUNDING = 1e-6, 4.0 * float(np.finfo(float).eps)


def at_end(t: Any, h: float) -> Any:
    """Distance [s] from `t`, a multiple of the step `h`, within which an instant counts as being at `t`."""
    return _AT_END * h + _ROUNDING * ca.fabs(t)


def timely(compiled: CompiledModel, t: Any, h: float, p: Any) -> Any:
    """Relations of time just after an instant `t` on a grid of steps `h` [s]."""
    found = compiled.modes(t + at_end(t, h), p)
    return ca.vertsplit(found, [0, compiled.n_timely, found.numel()])[0]


def ticks(compiled: CompiledModel, h: float) -> Any:
    """Function `(t, p) -> (due, late)`: samples that tick in the step that ends at t, and those that tick before t."""
    pool, s = compiled.solution.structure.reduced.pool, Symbols(compiled)
    builder = s.builder(compiled)
    due, late = [], []
    for number in compiled.state_events.samples:
        _, a, b = pool.nodes[number]
        first, interval = builder.lower([a, b])
        tolerance = at_end(s.t, h)
        before, now = (ca.floor((at + tolerance - first) / interval) for at in (s.t - h, s.t))
        due.append(ca.logic_and(now > before, now >= 0))
        is_repeated = ca.logic_and(now > before + 1, now >= 1)
        late.append(ca.logic_and(due[-1], ca.logic_or(is_repeated, first + now * interval < s.t - tolerance)))
    return ca.Function("ticks", [s.t, s.p], [ca.densify(ca.vertcat(ca.SX(0, 1), *v)) for v in (due, late)])


def inside(compiled: CompiledModel, t: Any, h: float, p: Any) -> Any:
    """Whether a relation of time changes within the step of length `h` [s] from `t` [s], ends excluded."""
    found: Any = 0
    if compiled.n_timely:
        for instant in ca.vertsplit(compiled.instants(p)):
            found = ca.logic_or(found, ca.logic_and(instant > t + at_end(t, h), instant < t + h - at_end(t, h)))
    return found


def note(compiled: CompiledModel, h: float) -> tuple[str, ...]:
    """Note on time events within steps of this length; none if the model has no time events."""
    if not compiled.n_timely and not compiled.state_events.samples:
        return ()
    return (
        f"time events and clock ticks within a step of {h:g} s act at its end, and step.unlocated in y is 1: let them "
        "be at multiples of the step",
    )
