"""A run of a model with delays: its start, and its way from stretch to stretch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from acausal.errors import InitializationError
from acausal.simulate.course import Course
from acausal.simulate.delay.memory import BeyondWindow, Memory
from acausal.simulate.guards import Cause, Moment
from acausal.simulate.hybrid import Hybrid
from acausal.simulate.initialize import Start
from acausal.simulate.problem import Problem
from acausal.simulate.regime import Regime
from acausal.simulate.solvers.base import Segment

Vector = NDArray[np.float64]
_CLOSE = 1e-12


def opened(memory: Memory, problem: Problem, t: float, begun: Callable[[Vector], Start], m: Vector) -> Start:
    """Start values under which every delayed signal is what it is at the start; `m` is filled in.

    Raises
    ------
    InitializationError
        AC305 when there are none.
    """
    own = _own(memory)

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


def begin(memory: Memory, hybrid: Hybrid, t: float, start: Start, m: Vector, flag: str | None) -> None:
    """The event at the start of the run, repeated until delayed signals are what it makes of them."""
    own = _own(memory)
    past = np.zeros(memory.n)
    for _ in range(10):
        hybrid.begin(t, start, m, flag=flag)
        past = memory.sources(t, hybrid.reached)
        assumed = hybrid.reached.m[own].copy()
        memory.assume(past)
        if (np.abs(memory.numbers - assumed) <= _CLOSE * (1.0 + np.abs(assumed))).all():
            break
        m[own] = memory.numbers
    memory.begin(t, past)


def cross(memory: Memory, hybrid: Hybrid, course: Course, template: Segment, report: Callable[[float], None]) -> None:
    """Go from the first instant of the course to the last, stretch by stretch."""
    recorder, own = hybrid.recorder, _own(memory)
    for k in range(course.segments):
        here, end = (float(t) for t in course.instants[k : k + 2])
        outputs = course.outputs(k)
        entered = False
        while here < end and hybrid.terminated is None:
            to, causes = memory.advance(here, end, hybrid.reached)
            margin = 1e-12 * hybrid.span
            near = outputs[np.abs(outputs - to) <= margin]
            to = float(near[0]) if len(near) else to
            times = np.append(outputs[(outputs > here + margin) & (outputs < to - margin)], to)
            row, boundary = recorder.count, len(recorder.boundaries)
            before = hybrid.reached
            samples = np.zeros_like(course.samples[:1])
            stretch = Course(
                np.array([here, to]),
                np.append(course.modes[k][: own.start], memory.numbers)[None, :],
                np.vstack([samples if entered else course.samples[k : k + 1], samples]),
                times,
                np.array([len(times)]),
            )
            try:
                hybrid.run(stretch, replace(template, start=here, times=times), report)
            except BeyondWindow as beyond:
                x, z = recorder.point(recorder.count - 1)[1:3]
                hybrid.moment = replace(hybrid.reached, x=x, z=z)
                memory.shorten(recorder.time, beyond.time)
                passed = False
            else:
                passed = True
            if entered:
                causes = (*causes, *_flipped(hybrid, before, row))
                _, *happened = recorder.boundaries[boundary]
                if causes or any(happened):
                    recorder.explain(boundary, causes)
                else:
                    recorder.hide(row, boundary)
                    if not (np.abs(outputs - here) <= margin).any():
                        recorder.hide(row - 1)
            events = [t for t, _, _ in recorder.boundaries[boundary:]]
            if passed:
                memory.reached(recorder.time)
            for t in events:
                memory.broke(t)
            here, entered = recorder.time, True
        if hybrid.terminated is not None:
            break


def _flipped(hybrid: Hybrid, before: Moment, row: int) -> tuple[Cause, ...]:
    """Relations that change where a stretch begins."""
    first = hybrid.guards.first
    after = hybrid.recorder.point(row)[3][first:]
    flipped = after != before.m[first:]
    held = [h.relation for h in before.regime.holds]  # their modes are recorded as the multipliers that hold them
    flipped[held] &= (after[held] <= 0.0) | (after[held] >= 1.0)
    return tuple(hybrid.guards.causes[k] for k in np.flatnonzero(flipped))


def _own(memory: Memory) -> slice:
    """The places of the delays among the modes."""
    first = len(memory.compiled.time_events.relations)
    return slice(first, first + len(memory.numbers))
