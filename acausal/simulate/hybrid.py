"""A segment of a run with events: stretches in which the modes hold, and what happens between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel
from acausal.lower.evaluate import values
from acausal.simulate.events import Guards, Happened
from acausal.simulate.initialize import Start
from acausal.simulate.problem import Problem
from acausal.simulate.record import Recorder
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.base import Piece, Segment
from acausal.simulate.stopping import Stop, integrate_to_event

Vector = NDArray[np.float64]
Integrate = Callable[[Segment, Vector], Piece]
_PARTS = 16
_MOST_LOOKS = 2000
# Events accumulate when each of so many followed sooner than the one before, at last within this share of the run.
_CROWDED = 1e-5
_MOST_SHORTER = 20


def clocks(compiled: CompiledModel, p: Vector) -> list[tuple[float, float]]:
    """Start and interval of each sample [s]."""
    pool = compiled.solution.structure.reduced.pool
    leaves = {"par": p.__getitem__, "time": lambda _: 0.0}
    found = []
    for number in compiled.state_events.samples:
        _, a, b = pool.nodes[number]
        known = values(pool, [a, b], leaves)
        found.append((float(known[a]), float(known[b])))
    return found


def sample_times(compiled: CompiledModel, p: Vector, start: float, stop: float) -> Vector:
    """All instants of samples between two times."""
    found = [np.zeros(0)]
    for first, interval in clocks(compiled, p):
        k = np.arange(
            max(0.0, np.ceil((start - first) / interval - 1e-9)), np.floor((stop - first) / interval + 1e-9) + 1
        )
        found.append(first + interval * k)
    return np.concatenate(found)


def due(compiled: CompiledModel, p: Vector, t: float) -> Vector:
    """Which samples are true at an instant."""
    found = []
    for first, interval in clocks(compiled, p):
        turns = (t - first) / interval
        found.append(float(abs(turns - round(turns)) <= 1e-9 and round(turns) >= 0))
    return np.array(found)


@dataclass
class Hybrid:
    """The events of one run; `modes` are those in force when the last segment ended."""

    problem: Problem
    solver: Solver
    recorder: Recorder
    integrate: Integrate
    modes: Vector | None = None

    def segment(self, start: Start, m: Vector, template: Segment, outputs: Vector) -> Start:
        """Integrate from `template.start` over `outputs`; `m` are the modes, those of time up to date."""
        guards = Guards(self.problem, template.tolerance, template.absolute)
        a = template.start
        before = self.before(m, a, start)
        m[guards.first :] = before[guards.first :]
        happened = guards.settle(a, start, m, before, due(self.problem.compiled, self.problem.p, a))
        here, times, crowd, last = a, outputs, 0, np.inf
        while True:
            start, m = happened.start, happened.modes
            self.recorder.begin(here, start.x, start.z, m, happened.texts, happened.changed)
            if not len(times):
                break
            stop = self.stretch(
                guards, here == a, replace(template, start=here, times=times, x=start.x, z=start.z, p=m)
            )
            if stop is None or stop.time is None:
                _, x, z, _ = self.recorder.point(-1)
                start = Start(x, z, start.notes)
                break
            gap, span = stop.time - here, float(outputs[-1]) - a
            crowd, last = (crowd + 1 if gap < last else 0), gap
            if crowd > _MOST_SHORTER and gap <= _CROWDED * span:
                raise guards.accumulated(stop.time, crowd)
            here = stop.time
            left = guards.consistent(here, Start(stop.x, stop.z, start.notes), m)
            self.recorder.add(np.array([here]), Piece(left.x[:, None], left.z[:, None], {}), m)
            times = times[times > here + 1e-13 * max(1.0, abs(here))]
            happened = self.event(guards, here, left, m)
        self.modes = m
        return start

    def event(self, guards: Guards, t: float, left: Start, m: Vector) -> Happened:
        """Flip what has reached its guard, and iterate."""
        fired = guards.fired(t, left.x, left.z, m)
        changed = m.copy()
        changed[guards.first :] = np.where(fired, 1 - m[guards.first :], m[guards.first :])
        samples = np.zeros(len(self.problem.compiled.state_events.samples))
        happened = guards.settle(t, left, changed, m, samples, fired)
        return replace(happened, texts=(*(guards.texts[k] for k in np.flatnonzero(fired)), *happened.texts))

    def before(self, m: Vector, t: float, start: Start) -> Vector:
        """Modes just before a segment; at the start of the run, those that the start has decided."""
        if self.modes is not None:
            return self.modes
        decided = m.copy()
        compiled = self.problem.compiled
        true = np.array(compiled.indicators(t, start.x, start.z, self.problem.u, self.problem.p, m)[1]).ravel()
        decided[len(m) - len(true) :] = true
        return decided

    def stretch(self, guards: Guards, quiet: bool, segment: Segment) -> Stop | None:
        """Integrate and record up to the next event; None when the segment ended without one.

        On an ODE one-step methods stop at the event by themselves. The others are looked at after each chunk of
        outputs; the interval in which the modes cease to hold is then crossed by itself. Chunks are short after an
        event, for the next is often near, and what lies beyond it is computed in vain.
        """
        m = segment.p
        if self.solver.name in ("rosenbrock", "erk") and not self.problem.compiled.algebraic:
            stop = integrate_to_event(self.problem, segment, explicit=self.solver.name == "erk")
            self.recorder.add(stop.times, stop.piece, m)
            return stop
        size = len(segment.times) if quiet else 16
        while len(segment.times):
            part = replace(segment, times=segment.times[:size])
            piece = self.integrate(part, m)
            wrong = guards.violated(part.times, piece.x, piece.z, m)
            good = len(part.times) if wrong is None else wrong
            if good:
                self.recorder.add(part.times[:good], Piece(piece.x[:, :good], piece.z[:, :good], piece.counters), m)
                segment = _after(segment, good, piece.x[:, good - 1], piece.z[:, good - 1])
            if wrong is not None:
                stop = self.locate(guards, replace(segment, times=segment.times[:1]))
                self.recorder.add(stop.times, stop.piece, m)
                if stop.time is not None:
                    return stop
                segment = _after(segment, 1, stop.x, stop.z)
            size *= 2
        return None

    def locate(self, guards: Guards, segment: Segment) -> Stop:
        """Cross the output interval in which the modes cease to hold.

        An ODE is crossed by a one-step method that stops at the event. A DAE is integrated again by its own solver,
        ever closer: one-step methods take a hundred times the steps where an algebraic variable is steep (a drill in
        the air, measured).
        """
        if not self.problem.compiled.algebraic:
            return integrate_to_event(self.problem, segment)
        none = Piece(np.zeros((len(segment.x), 0)), np.zeros((len(segment.z), 0)), {})
        m, end = segment.p, float(segment.times[0])
        whole = span = end - segment.start
        for _ in range(
            _MOST_LOOKS
        ):  # of several crossings the first: where one is seen, the next look is at the sixteenth before it
            stop = min(segment.start + span, end)
            times = np.append(segment.start + (stop - segment.start) * np.arange(1, _PARTS) / _PARTS, stop)
            piece = self.integrate(replace(segment, times=times), m)
            k = guards.violated(times, piece.x, piece.z, m)
            if k is None and stop >= end:
                last = Piece(piece.x[:, -1:], piece.z[:, -1:], piece.counters)
                return Stop(last, times[-1:], None, piece.x[:, -1], piece.z[:, -1])
            if k is None:  # what a longer step had seen is not there
                segment = replace(segment, start=stop, x=piece.x[:, -1], z=piece.z[:, -1])
                span = min(span * _PARTS, whole)
                continue
            if span / _PARTS <= 1e-12 * max(1.0, abs(segment.start)):
                return Stop(none, segment.times[:0], float(times[k]), piece.x[:, k], piece.z[:, k])
            span /= _PARTS
            if k:
                segment = replace(segment, start=float(times[k - 1]), x=piece.x[:, k - 1], z=piece.z[:, k - 1])
        raise guards.accumulated(segment.start, _MOST_LOOKS)


def _after(segment: Segment, count: int, x: Vector, z: Vector) -> Segment:
    """What is left of a segment after its first `count` output times."""
    return replace(segment, start=float(segment.times[count - 1]), times=segment.times[count:], x=x, z=z)
