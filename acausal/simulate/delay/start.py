"""The start of a model with delays: every delayed signal has always been what it is there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acausal.arrays import Vector
from acausal.errors import InitializationError
from acausal.simulate.delay.memory import Memory
from acausal.simulate.driver.driver import Dynamics
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import Moment
from acausal.simulate.events.regime import Regime
from acausal.simulate.start.initialize import Start

_CLOSE = 1e-12


def opened(memory: Memory, problem: Problem, t: float, begun: Callable[[Vector], Start], m: Vector) -> Start:
    """Start values under which every delayed signal is what it is at the start; `m` is filled in.

    Raises InitializationError: AC305 when there are none.
    """
    own = memory.own

    def tried(past: Vector) -> tuple[Start, Vector]:
        memory.assume(past)
        m[own] = memory.numbers
        start = begun(m)
        return start, memory.sources(t, Moment(start.x, start.z, m, Regime(problem)))

    x, z = (np.array(v, dtype=float).ravel() for v in memory.compiled.guess(memory.p))
    past = memory.sources(t, Moment(x, z, m, Regime(problem)))
    past[~np.isfinite(past)] = 0.0
    start, found = tried(past)
    for attempt in range(20):
        if (np.abs(found - past) <= _CLOSE * (1.0 + np.abs(found))).all():
            return start
        past = found if attempt < 2 else _newton(past, found, lambda v: tried(v)[1])
        start, found = tried(past)
    raise InitializationError(
        "AC305",
        f"{memory.compiled.name}: delayed signals do not agree with the start",
        where=tuple(d.where for d in memory.items[:1] if d.where is not None),
        evidence=[f"{d.name} = {v:g} gives {f:g}" for d, v, f in zip(memory.items, past, found, strict=False)],
        cause="before the run every delayed signal is what it is at its start",
        help="give start values: fixed(...) for what is delayed",
    )


def _newton(past: Vector, found: Vector, tried: Callable[[Vector], Vector]) -> Vector:
    """One step of Newton's method on `found - past`, with differences for its slope."""
    slope = -np.eye(len(past))
    for k in range(len(past)):
        step = 1e-6 * max(1.0, abs(past[k]))
        moved = past.copy()
        moved[k] += step
        slope[:, k] += (tried(moved) - found) / step
    return np.asarray(past - np.linalg.lstsq(slope, found - past, rcond=None)[0], dtype=np.float64)


def begin(memory: Memory, dynamics: Dynamics, t: float, start: Start, m: Vector, flag: str | None) -> None:
    """The event at the start of the run, repeated until delayed signals are what it makes of them."""
    own = memory.own
    past = np.zeros(memory.n)
    for _ in range(10):
        dynamics.begin(t, start, m, flag)
        past = memory.sources(t, dynamics.reached)
        assumed = dynamics.reached.m[own].copy()
        memory.assume(past)
        if (np.abs(memory.numbers - assumed) <= _CLOSE * (1.0 + np.abs(assumed))).all():
            break
        m[own] = memory.numbers
    memory.begin(t, past)
