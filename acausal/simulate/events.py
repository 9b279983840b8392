"""What happens at an event: modes iterate to a fixed point, `when` clauses act, and again until nothing changes.

Source of the meaning: Modelica language specification 3.6, section 8.6 (event iteration).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.errors import EventError
from acausal.lower.text import to_text
from acausal.simulate.initialize import Start, consistent
from acausal.simulate.problem import Problem

Vector = NDArray[np.float64]
_MOST_ROUNDS = 100
_MOST_FLIPS = 6


@dataclass(frozen=True, eq=False)
class Happened:
    """The state after an event, its modes, and the sentences that describe it."""

    start: Start
    modes: Vector
    texts: tuple[str, ...]
    changed: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Guards:
    """Relations and clauses of one problem."""

    problem: Problem
    tolerance: float
    absolute: float

    @property
    def first(self) -> int:
        """Position of the first relation of variables among the modes."""
        return self.problem.compiled.n_modes - len(self.problem.compiled.state_events.relations)

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """The relations as the user reads them."""
        compiled = self.problem.compiled
        reduced = compiled.solution.structure.reduced

        def name_of(kind: str, k: int) -> str:
            return reduced.name(k) if kind == "var" else compiled.parameters[k]

        return tuple(to_text(reduced.pool, n, name_of, 80) for n in compiled.state_events.relations)

    def directed(self, t: float, x: Vector, z: Vector, m: Vector) -> Vector:
        """Distances to the guards: positive while the modes hold."""
        values = self.problem.compiled.indicators(t, x, z, self.problem.u, self.problem.p, m)[0]
        return np.asarray((2 * m[self.first :] - 1) * np.array(values).ravel())

    def violated(self, times: Vector, x: Vector, z: Vector, m: Vector) -> int | None:
        """The first of several instants at which the modes no longer hold."""
        n = len(times)
        wide = [np.tile(v[:, None], (1, n)) for v in (self.problem.u, self.problem.p, m)]
        values = np.array(self.problem.compiled.indicators.map(n)(times[None, :], x, z, *wide)[0])
        h = (2 * m[self.first :] - 1)[:, None] * values
        wrong = (h < -self.noise(times[0], x[:, 0], z[:, 0], m)[:, None]).any(axis=0)
        return int(np.argmax(wrong)) if wrong.any() else None

    def rates(self, t: float, x: Vector, z: Vector, m: Vector) -> Vector:
        """Time derivatives of the directed distances along the solution."""
        compiled = self.problem.compiled
        own, by_z, alg, alg_z, _ = (
            np.array(v) for v in compiled.indicator_rates(t, x, z, self.problem.u, self.problem.p, m)
        )
        rate = own.ravel()
        if len(z):
            rate = rate - by_z @ np.linalg.lstsq(alg_z, alg.ravel(), rcond=None)[0]
        return np.asarray((2 * m[self.first :] - 1) * rate)

    def noise(self, t: float, x: Vector, z: Vector, m: Vector) -> Vector:
        """How far the distances can be off because the states are: the hysteresis of each relation."""
        compiled = self.problem.compiled
        slope = np.array(compiled.indicator_rates(t, x, z, self.problem.u, self.problem.p, m)[4])
        error = 10 * (self.tolerance * np.abs(x) + self.absolute * compiled.nominal_x)
        return np.asarray(np.abs(np.nan_to_num(slope)) @ error + 1e-15)

    def fired(self, t: float, x: Vector, z: Vector, m: Vector) -> NDArray[np.bool_]:
        """Which relations change at an event: all that are at their guard and falling; at least the nearest."""
        h, rate = self.directed(t, x, z, m), self.rates(t, x, z, m)
        near = np.abs(h) <= np.maximum(1e-12, 1e-9 * np.abs(rate) * max(1.0, abs(t)))
        found = (h < 0) | (near & (rate < 0))
        if not found.any():
            found[int(np.argmin(np.abs(h) / (np.abs(rate) + 1e-300)))] = True
        return np.asarray(found)

    def decide(self, t: float, start: Start, m: Vector, fired: NDArray[np.bool_] | None = None) -> tuple[Start, Vector]:
        """Flip relations until all hold at this point, or leave their guard in the right direction.

        Those that have `fired` are past their guard by no more than the noise; they stay flipped.
        """
        m = m.copy()
        flips = np.zeros(len(m) - self.first, dtype=int)
        for _ in range(_MOST_ROUNDS):
            start = self.consistent(t, start, m)
            if not len(flips):
                return start, m
            h = self.directed(t, start.x, start.z, m)
            noise = self.noise(t, start.x, start.z, m)
            wrong = h < -2 * noise
            at = np.abs(h) <= noise
            if fired is not None:
                at &= ~fired
            if at.any():
                wrong |= at & (self.rates(t, start.x, start.z, m) < -noise)
            if not wrong.any():
                return start, m
            flips += wrong
            if (flips > _MOST_FLIPS).any():
                raise self.unsettled(t, flips)
            m[self.first :] = np.where(wrong, 1 - m[self.first :], m[self.first :])
        raise self.unsettled(t, flips)

    def consistent(self, t: float, start: Start, m: Vector) -> Start:
        """Algebraic variables for these modes."""
        if not len(start.z):
            return start
        z = self.problem.restarted(t, start.x, start.z, m)
        if z is not None:
            return Start(start.x, z, start.notes)
        return consistent(self.problem.compiled, t, start, self.problem.p, self.problem.u, m)

    def settle(
        self, t: float, start: Start, m: Vector, before: Vector, samples: Vector, fired: NDArray[np.bool_] | None = None
    ) -> Happened:
        """Event iteration from the modes `m` (changed already) and those `before`; `samples` are true now."""
        compiled = self.problem.compiled
        clauses = compiled.state_events.clauses
        texts: list[str] = []
        changed: dict[str, None] = {}
        place = len(compiled.time_events.relations)
        rising = np.zeros(len(clauses), dtype=bool)
        for _ in range(_MOST_ROUNDS):
            start, m = self.decide(t, start, m, fired)
            now = m.copy()
            now[place : place + len(samples)] = samples
            rising = self.conditions(t, start, now) & ~self.conditions(t, start, before)
            if not rising.any():
                return Happened(start, m, tuple(texts), tuple(changed))
            values = np.array(self._clauses(t, start, now)[1]).ravel()
            x, k = start.x.copy(), 0
            for clause, acts in zip(clauses, rising, strict=True):
                if acts:
                    texts.append(clause.text)
                for position, _ in clause.actions:
                    if acts:
                        x[position] = values[k]
                        changed[compiled.states[position]] = None
                    k += 1
            start = Start(x, start.z, start.notes)
            before, fired = now, None
        raise self.unsettled(t, np.zeros(0, dtype=int), [c.text for c, r in zip(clauses, rising, strict=True) if r])

    def conditions(self, t: float, start: Start, m: Vector) -> NDArray[np.bool_]:
        """Truth of the conditions of all clauses under given modes."""
        return np.asarray(np.array(self._clauses(t, start, m)[0]).ravel() > 0.5)

    def _clauses(self, t: float, start: Start, m: Vector):  # type: ignore[no-untyped-def]
        return self.problem.compiled.clauses(t, start.x, start.z, self.problem.u, self.problem.p, m)

    def accumulated(self, t: float, count: int) -> EventError:
        """The error for events without end in next to no time."""
        names = "; ".join(self.texts[:4])
        return EventError(
            "AC502",
            f"{count} events follow one another at t = {t:.9g} s in {self.problem.compiled.name} without time passing",
            evidence=[f"relations of the model: {names}"],
            cause="bounces that get ever shorter (Zeno), or two modes that lead back to each other (sliding)",
            help="let the model come to rest below a threshold, or use a compliant contact or a smooth switch",
        )

    def unsettled(self, t: float, flips: NDArray[np.int_], clauses: list[str] | None = None) -> EventError:
        """The error for an event iteration without end, naming who takes part."""
        names = clauses or [self.texts[k] for k in np.argsort(-flips)[:4] if flips[k] > 1]
        return EventError(
            "AC501",
            f"events do not settle at t = {t:.9g} s in {self.problem.compiled.name}: {'; '.join(names)}",
            evidence=[f"changes again and again: {n}" for n in names],
            cause="each of the two modes leads straight back to the other (chattering)",
            help="give the relation a hysteresis, or declare the switch smooth: where(..., smooth=True), no_event(...)",
        )
