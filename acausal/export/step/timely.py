"""What time does within one exported step: relations of time, and clocks.

A step begins with the relations as they hold just after its start, and keeps them to its end: an instant between the
two, at which one changes or a clock ticks, is taken at the end. When that is so is known exactly, and said by a flag.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols

# A clock counts as ticking at an instant to this share of its interval, and of the step.
TICK = 1e-9
# An instant so near to the end of a step, by the step, is at its end.
_AT_END = 1e-6


def timely(compiled: CompiledModel, t: Any, h: float, p: Any) -> Any:
    """Relations of time just after an instant of a grid of steps `h`."""
    found = compiled.modes(t + TICK * h, p)
    return ca.vertsplit(found, [0, compiled.n_timely, found.numel()])[0]


def ticks(compiled: CompiledModel, h: float) -> Any:
    """`(t, p) -> (due, late)` for each sample: whether its clock ticked in the step that ends at t, and not there."""
    pool, s = compiled.solution.structure.reduced.pool, Symbols(compiled)
    builder = s.builder(compiled)
    due, late = [], []
    for number in compiled.state_events.samples:
        _, a, b = pool.nodes[number]
        first, interval = builder.lower([a, b])
        before, now = (ca.floor((at - first) / interval + TICK) for at in (s.t - h, s.t))
        due.append(ca.logic_and(now > before, now >= 0))
        late.append(ca.logic_and(due[-1], first + now * interval < s.t - _AT_END * h))
    return ca.Function("ticks", [s.t, s.p], [ca.densify(ca.vertcat(ca.SX(0, 1), *v)) for v in (due, late)])


def inside(compiled: CompiledModel, t: Any, h: float, p: Any) -> Any:
    """Whether an instant at which a relation of time changes lies within a step from t."""
    found: Any = 0
    if compiled.n_timely:
        for instant in ca.vertsplit(compiled.instants(p)):
            found = ca.logic_or(found, ca.logic_and(instant > t + TICK * h, instant < t + (1 - _AT_END) * h))
    return found


def note(compiled: CompiledModel, h: float) -> tuple[str, ...]:
    """The limit of steps of this size."""
    if not compiled.n_timely and not compiled.state_events.samples:
        return ()
    return (
        f"instants of relations of time and of clocks within a step of {h:g} s are taken at its end; step.unlocated in "
        "y is 1 then: let them be multiples of the step",
    )
