"""A plain interpreter of hybrid models: Modelica 3.6, chapter 8 and appendix B; states are polynomials of time.

One round of an event: every discrete equation and every `when` is solved in the order of its dependence with one `pre`
for all (appendix B: the equations of f_m and f_z are one system with pre(m) known); then states are reinitialised
(section 8.3.6), `pre` becomes what was found (section 8.6), and the round repeats until nothing changes. A `when` acts
in a round if one of its conditions is true in it and was not in the round before (section 8.3.5.1); of a chain the
first branch that does (8.3.5.2). Nothing here knows how the compiler does it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tests.random.hybrid_models import Branch, Hybrid, Tree, children

Array = NDArray[np.float64]
Poly = tuple[float, float, float, float]
# Nearer than this two different events are not told apart, and a model is no test.
_APART = 2e-4
# Not a multiple of what samples are made of.
ROWS = 37
_ON_GUARD = 1e-9


class Discard(Exception):
    """The model is no test: events too near, tangent, infinite, or a state that slides."""


class Contradiction(Exception):
    """Two `when`s set one variable to different values at one instant: refused (AC504)."""


@dataclass
class Run:
    """What the reference found: times of all events, and rows at asked times."""

    events: list[float] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    states: list[list[float]] = field(default_factory=list)
    discretes: list[list[float]] = field(default_factory=list)
    fired: int = 0
    most_rounds: int = 0


def trees(model: Hybrid) -> list[Tree]:
    """Every tree of a model, subtrees included, each once."""
    roots = [s.rate for s in model.states] + [d.equation for d in model.discretes if d.equation is not None]
    for chain in model.chains:
        for b in chain:
            roots += [*b.conditions, *(v for _, v in b.actions)]
    seen: dict[Tree, None] = {}
    while roots:
        e = roots.pop()
        if e not in seen:
            seen[e] = None
            roots += children(e)
    return list(seen)


class Reference:
    """One run of one model."""

    def __init__(self, model: Hybrid) -> None:
        self.model = model
        every = trees(model)
        self.located = [e for e in every if e[0] in ("gt", "lt") and self.moves(e)]
        self.remembered = [e[1] for e in every if e[0] in ("pre", "edge", "change")]
        self.samples = [e for e in every if e[0] == "sample"]
        self.x = [s.start for s in model.states]
        self.d = [d.start for d in model.discretes]
        self.truth: dict[Tree, bool] = {}
        self.ticks: set[Tree] = set()
        self.t = 0.0
        self.was: dict[Tree, float] = {}
        self.run = Run()

    def moves(self, e: Tree) -> bool:
        return e[0] == "x" or any(self.moves(c) for c in children(e))

    # -- values ---------------------------------------------------------------------------------------------------

    def value(self, e: Tree) -> float:
        """A tree at this instant: states as they are, discrete variables as found so far in this round."""
        op, *rest = e
        if op == "num":
            return float(rest[0])
        if op == "x":
            return self.x[rest[0]]
        if op == "d":
            return self.d[rest[0]]
        if op == "pre":
            return self.was[rest[0]]
        if op == "edge":
            return float(self.value(rest[0]) > 0.5 and self.was[rest[0]] < 0.5)
        if op == "change":
            return float(self.value(rest[0]) != self.was[rest[0]])
        if op == "sample":
            return float(e in self.ticks)
        if op in ("gt", "lt"):
            if e in self.truth:
                return float(self.truth[e])
            a, b = self.value(rest[0]), self.value(rest[1])
            return float(a > b if op == "gt" else a < b)
        if op == "mul":
            return float(rest[0]) * self.value(rest[1])
        a = self.value(rest[0])
        if op == "not":
            return 1.0 - a
        if op == "if":
            return self.value(rest[1]) if a > 0.5 else self.value(rest[2])
        b = self.value(rest[1])
        return a + b if op == "add" else float(a > 0.5 and b > 0.5) if op == "and" else float(a > 0.5 or b > 0.5)

    def decide(self, forced: set[Tree]) -> None:
        """Truth of the located relations; one that is on its guard keeps what it has."""
        for e in self.located:
            g = self.value(e[1]) - self.value(e[2])
            g = g if e[0] == "gt" else -g
            if e in forced and abs(g) < _ON_GUARD:
                continue
            if abs(g) < _APART:
                raise Discard("a relation is at its guard")
            self.truth[e] = g > 0

    # -- one event ------------------------------------------------------------------------------------------------

    def remember(self) -> None:
        """`pre` becomes what was found, of all at once: `pre(d)` in a condition still reads the round before."""
        conditions = [c for chain in self.model.chains for b in chain for c in b.conditions]
        self.was |= {e: self.value(e) for e in (*self.remembered, *conditions)}

    def becomes(self, b: Branch) -> bool:
        return any(self.value(c) > 0.5 and self.was[c] < 0.5 for c in b.conditions)

    def solve_round(self, starting: bool) -> dict[int, float]:
        """Discrete variables of one round, in the order of their numbers; what states are reinitialised to."""
        for j, d in enumerate(self.model.discretes):
            if d.equation is not None:
                self.d[j] = self.value(d.equation)
                continue
            found: list[float] = []
            if not starting:
                for chain in self.model.chains:
                    first = next((b for b in chain if self.settled_before(b, j) and self.becomes(b)), None)
                    if first is not None:
                        found += [self.value(v) for target, v in first.actions if target == ("d", j)]
            if len(set(found)) > 1:
                raise Contradiction(f"d{j}: {found}")
            if found:
                self.d[j] = found[0]
        new: dict[int, list[float]] = {}
        for chain in [] if starting else self.model.chains:
            first = next((b for b in chain if self.becomes(b)), None)
            if first is not None:
                self.run.fired += 1
                for target, v in first.actions:
                    if target[0] == "x":
                        new.setdefault(target[1], []).append(self.value(v))
        for i, values in new.items():
            if len(set(values)) > 1:
                raise Contradiction(f"x{i}: {values}")
        return {i: values[0] for i, values in new.items()}

    def settled_before(self, b: Branch, j: int) -> bool:
        """Whether all a branch reads comes before variable j; a chain in which one does not is no test."""
        stack = list(b.conditions)
        while stack:
            e = stack.pop()
            if e[0] == "d" and e[1] >= j:
                raise Discard("a chain needs what it sets")
            if e[0] != "pre":
                stack += children(e)
        return True

    def settle(self, triggered: set[Tree]) -> None:
        for e in triggered:
            self.truth[e] = not self.truth[e]
        on_guard = set(triggered)
        for rounds in range(1, 60):
            before = (list(self.d), dict(self.truth), dict(self.was), list(self.x))
            self.decide(on_guard)
            new = self.solve_round(starting=False)
            for i, v in new.items():
                if abs(v - self.x[i]) > 0:
                    self.x[i] = v
            self.remember()
            if new:
                self.decide(on_guard)
            after = (self.d, self.truth, self.was, self.x)
            self.run.most_rounds = max(self.run.most_rounds, rounds)
            if all(a == b for a, b in zip(before, after, strict=True)):
                return
        raise Discard("does not settle")

    # -- time -----------------------------------------------------------------------------------------------------

    def polynomials(self) -> list[Poly]:
        """States as polynomials of the time since now."""
        found: list[Poly] = []
        for i, s in enumerate(self.model.states):
            if s.rate[0] == "x":
                a = found[s.rate[1]]
                found.append((self.x[i], a[0], a[1] / 2, a[2] / 3))
            else:
                found.append((self.x[i], self.value(s.rate), 0.0, 0.0))
        return found

    def guard(self, e: Tree, polys: list[Poly]) -> Array:
        def poly(e: Tree) -> Array:
            if e[0] == "x":
                return np.array(polys[e[1]])
            if e[0] == "add":
                return poly(e[1]) + poly(e[2])
            if e[0] == "mul":
                return float(e[1]) * poly(e[2])
            return np.array([self.value(e), 0.0, 0.0, 0.0])

        g: Array = poly(e[1]) - poly(e[2])
        return g if e[0] == "gt" else -g

    def next_flip(self, e: Tree, polys: list[Poly], until: float) -> float:
        """Time from now at which a relation changes; inf if it does not before `until`."""
        g = self.guard(e, polys)
        g = g if self.truth[e] else -g  # positive now, or zero and leaving
        if abs(g[0]) < _ON_GUARD:
            k = next((k for k in range(1, 4) if abs(g[k]) > 1e-9), None)
            if k is None or g[k] < 0:
                raise Discard("slides, or stays on its guard")
            g = np.array([0.0, *g[1:]])
        trimmed = np.trim_zeros(g, "b")
        if len(trimmed) < 2:
            return np.inf
        roots = np.roots(trimmed[::-1])
        near = sorted(r.real for r in roots if abs(r.imag) < 1e-3 and r.real > (1e-9 if g[0] == 0 else -1e-9))
        close = [r for r in near if r < until + 0.05]
        if any(b - a < 5e-3 for a, b in pairwise(close)):
            raise Discard("touches its guard")
        near = [r for r in near if r > 1e-9]
        if near and near[0] < _APART:
            raise Discard("comes back at once")
        return near[0] if near else np.inf

    def next_tick(self) -> tuple[float, set[Tree]]:
        best, which = np.inf, set()
        for e in self.samples:
            start, interval = e[1], e[2]
            k = max(0, int(np.floor((self.t - start) / interval + 1e-6)) + 1) if self.t >= start - 1e-9 else 0
            at = start + k * interval
            if at < best - 1e-9:
                best, which = at, {e}
            elif at < best + 1e-9:
                which.add(e)
        return best, which

    def begin(self) -> None:
        """Initialisation, in which no `when` acts and `pre` of a variable is its start; then rounds as always."""
        starts, found = list(self.d), []
        self.decide(set())
        # what a relation was before the start is not defined: models in which that counts are no test
        for before in (1.0, 0.0):
            self.d = list(starts)
            self.was = {e: self.value(e) if e[0] == "d" else before for e in self.remembered}
            self.solve_round(starting=True)
            self.remember()
            found.append((list(self.d), dict(self.was)))
        if found[0] != found[1]:
            raise Discard("depends on what was before the start")
        self.settle(set())

    def result(self, grid: list[float]) -> Run:
        self.begin()
        left = list(grid)
        while True:
            polys = self.polynomials()
            stop = self.model.stop - self.t
            flips = {e: self.next_flip(e, polys, stop) for e in self.located}
            tick, ticks = self.next_tick()
            at = min([*flips.values(), tick - self.t])
            others = [v for v in (*flips.values(), tick - self.t) if at + 1e-10 < v < at + _APART]
            if others or abs(at - stop) < _APART:
                raise Discard("two events nearly at once")
            if (tick - self.t) < at + 1e-9 and any(v < at + 1e-9 for v in flips.values()):
                raise Discard("a sample and a crossing at once")
            end = min(at, stop)
            while left and left[0] <= self.t + end:
                s = left.pop(0) - self.t
                self.run.times.append(s + self.t)
                self.run.states.append([float(np.polyval(p[::-1], s)) for p in polys])
                self.run.discretes.append(list(self.d))
            if at > stop:
                return self.run
            triggered = {e for e, v in flips.items() if v < at + 1e-10}
            self.x = [float(np.polyval(p[::-1], at)) for p in polys]
            self.t = tick if tick - self.t < at + 1e-9 else self.t + at
            self.snap(triggered)
            self.ticks = ticks if self.t == tick else set()
            self.settle(triggered)
            self.run.events.append(self.t)
            if self.ticks:
                self.ticks = set()
                held = list(self.d)
                self.solve_round(starting=True)
                if self.d != held:
                    raise Discard("what remembers a sample")
                self.remember()
            if len(self.run.events) > 40 or max(abs(v) for v in [*self.x, *self.d]) > 1e4:
                raise Discard("too many events, or too large")

    def snap(self, triggered: set[Tree]) -> None:
        """Roots are known to 1e-15 relative: a state that is on its guard is there exactly."""
        for e in triggered:
            if e[1][0] == "x" and e[2][0] == "num":
                self.x[e[1][1]] = e[2][1]


def reference(model: Hybrid, rows: int = ROWS) -> Run:
    """The run on a grid; Discard when the model is no test."""
    grid = [model.stop * k / rows for k in range(1, rows + 1)]
    run = Reference(model).result(grid)
    if not run.events:
        raise Discard("nothing happens")
    return run
