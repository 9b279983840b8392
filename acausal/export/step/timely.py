"""Relations of time and clocks within one exported step.

A step begins with the relations as they hold just after its start, and keeps them to its end: an instant between the
two, at which one changes or a clock ticks, is taken at the end. Such steps are known exactly, and reported by a flag.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel

# A clock counts as ticking at an instant to this share of its interval, and of the step.
TICK = 1e-9
# An instant so near to the end of a step, by the step, is at its end; and so is one that rounding has moved off it.
_AT_END, _ROUNDING = 1e-6, 4.0 * float(np.finfo(float).eps)


def at_end(t: Any, h: float) -> Any:
    """How near [s] to a multiple `t` of a step `h` an instant is at it."""
    return _AT_END * h + _ROUNDING * ca.fabs(t)


def timely(compiled: CompiledModel, t: Any, h: float, p: Any) -> Any:
    """Relations of time just after an instant `t` on a grid of steps `h` [s]."""
    found = compiled.modes(t + at_end(t, h), p)
    return ca.vertsplit(found, [0, compiled.n_timely, found.numel()])[0]


def ticks(compiled: CompiledModel, h: float) -> Any:
    """Function `(t, p) -> (due, late)`: samples that tick in the step that ends at t, and those before its end."""
    pool, s = compiled.solution.structure.reduced.pool, Symbols(compiled)
    builder = s.builder(compiled)
    due, late = [], []
    for number in compiled.state_events.samples:
        _, a, b = pool.nodes[number]
        first, interval = builder.lower([a, b])
        near = at_end(s.t, h)
        before, now = (ca.floor((at + near - first) / interval) for at in (s.t - h, s.t))
        due.append(ca.logic_and(now > before, now >= 0))
        again = ca.logic_and(now > before + 1, now >= 1)
        late.append(ca.logic_and(due[-1], ca.logic_or(again, first + now * interval < s.t - near)))
    return ca.Function("ticks", [s.t, s.p], [ca.densify(ca.vertcat(ca.SX(0, 1), *v)) for v in (due, late)])


def inside(compiled: CompiledModel, t: Any, h: float, p: Any) -> Any:
    """Whether a relation of time changes inside the step of length `h` [s] from `t` [s]."""
    found: Any = 0
    if compiled.n_timely:
        for instant in ca.vertsplit(compiled.instants(p)):
            found = ca.logic_or(found, ca.logic_and(instant > t + at_end(t, h), instant < t + h - at_end(t, h)))
    return found


def note(compiled: CompiledModel, h: float) -> tuple[str, ...]:
    """Note on the limit of steps of this size."""
    if not compiled.n_timely and not compiled.state_events.samples:
        return ()
    return (
        f"time events and clock ticks inside a step of {h:g} s act at its end, and step.unlocated in y is 1: make them "
        "multiples of the step",
    )
