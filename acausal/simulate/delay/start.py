"""The start of a model with delays: before the run, every delayed signal had its value at the start."""

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


def opened(memory: Memory, problem: Problem, t: float, initialize: Callable[[Vector], Start], m: Vector) -> Start:
    """Find start values that agree with the past values derived from them; fills in the delays among the modes `m`.

    Raises InitializationError: AC305 if there are none.
    """
    delays = memory.delay_modes

    def started_with(past: Vector) -> tuple[Start, Vector]:
        memory.assume(past)
        m[delays] = memory.numbers
        start = initialize(m)
        return start, memory.sources(t, Moment(start.x, start.z, m, Regime(problem)))

    x, z = (np.array(v, dtype=float).ravel() for v in memory.compiled.guess(memory.p))
    past = memory.sources(t, Moment(x, z, m, Regime(problem)))
    past[~np.isfinite(past)] = 0.0
    start, signals = started_with(past)
    for attempt in range(20):
        if (np.abs(signals - past) <= _CLOSE * (1.0 + np.abs(signals))).all():
            return start
        past = signals if attempt < 2 else _newton(past, signals, lambda v: started_with(v)[1])
        start, signals = started_with(past)
    raise InitializationError(
        "AC305",
        f"{memory.compiled.name}: delayed signals do not agree with the start",
        where=tuple(d.where for d in memory.items[:1] if d.where is not None),
        evidence=[f"{d.name} = {v:g} gives {f:g}" for d, v, f in zip(memory.items, past, signals, strict=False)],
        cause="before the run, every delayed signal has its value at the start",
        help="give start values to the delayed signals: fixed(...)",
    )


def _newton(past: Vector, signals: Vector, signals_for: Callable[[Vector], Vector]) -> Vector:
    """One step of Newton's method on `signals - past`, with a Jacobian of finite differences."""
    jacobian = -np.eye(len(past))
    for k in range(len(past)):
        step = 1e-6 * max(1.0, abs(past[k]))
        moved = past.copy()
        moved[k] += step
        jacobian[:, k] += (signals_for(moved) - signals) / step
    return np.asarray(past - np.linalg.lstsq(jacobian, signals - past, rcond=None)[0], dtype=np.float64)


def begin(memory: Memory, dynamics: Dynamics, t: float, start: Start, m: Vector, flag: str | None) -> None:
    """Process the event at the start of the run, and repeat it until the delayed signals agree with its outcome."""
    delays = memory.delay_modes
    past = np.zeros(memory.n)
    for _ in range(10):
        dynamics.begin(t, start, m, flag)
        past = memory.sources(t, dynamics.reached)
        assumed = dynamics.reached.m[delays].copy()
        memory.assume(past)
        if (np.abs(memory.numbers - assumed) <= _CLOSE * (1.0 + np.abs(assumed))).all():
            break
        m[delays] = memory.numbers
    memory.begin(t, past)
