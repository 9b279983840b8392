"""Rates that sleep and wake: kinks in which what is not on bounds no step, such as `y' = k * maximum(x - 1, 0)`.

`minimum`, `maximum`, `fabs` and what is below `no_event` make no events; the error control sees such a kink where a
step ends behind it. While one side is on, nothing of the other bounds the step, and a solver may pass it without a
single evaluation there. These kinks are watched: a stretch ends where one is reached, and the next one begins there,
in front of what may wake, without an event.

While both sides move, or the side that is on is a factor of something that moves, a step follows what it sees, and what
lies beyond the kink for less than a step is passed over all the same: `speed * maximum(force, -limit)`, or
`fabs((t - 1) * (t - 1.1))`, of whose dip a method of third order notices nothing. So all kinks are watched, but those
of functions from outside that jump (`External.jumps`), on both sides or for no rate.

Each that is watched costs a guard, and a stretch whenever it is passed. Bodies that touch have hundreds, of all the
ways in which their faces may overlap: choices below `no_event` that move a point of contact while the force is on.
Where there are many, all that do not enter the rate of a state linearly are left out and handed back, for a message
and a bound on the steps: the weights of those points, `minimum` and `maximum` in products, would take eight times the
work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.events.steep import STEPS, steep
from acausal.flatten.pool import LEAVES, RELATIONS, Pool
from acausal.language.expressions.external import Call
from acausal.numeric.evaluate import Samples
from acausal.numeric.samples import SamplePoints

MOST = 120
"""Kinks of one system that are watched of whatever kind; with more, and choices among them, only rates."""
MOST_PLAIN = 1000
"""Kinks that are watched at all."""

_LINEAR = frozenset(("add", "sub", "neg", "mul", "div"))
_PIECEWISE = frozenset(("min", "max", "where", "noevent"))
# Two distances are one when they are multiples of each other in so many digits at all points.
_DIGITS = 9
_SAME = 1e-9
# A sum is zero when it is this small beside its terms.
_ZERO = 1e-12


@dataclass(frozen=True)
class Sleeping:
    """Relations that tell which side of a sleeping kink is on.

    Nodes of their own, which stand in no equation: what they tell is looked at, and replaces nothing.
    """

    watched: tuple[int, ...] = ()
    left: tuple[int, ...] = ()
    """Those that are too many to be watched."""
    bursts: bool = False
    """Whether there are bursts, whose traces are cut off (`acausal.analyse.events.traces`)."""
    branches: bool = False
    """Whether the kinks themselves become branches on these relations, for who differentiates on one side of them."""
    numbers: tuple[int, ...] = ()
    """Numbers of the stretches of long tables, whose relations are watched (`acausal.analyse.events.table_stops`)."""


def sleeping(
    solution: Solution, located: Iterable[int], discrete: frozenset[int], system: Callable[[int], int]
) -> Sleeping:
    """The kinks that sleep, but those at the place of a `located` relation, and of operands that rest at the kink.

    They are as many as can be watched in each `system`, whose number is told of a relation.
    """
    known = set(located)
    graph = _Graph(solution, discrete)
    pool, points = graph.pool, graph.points
    taken = {_shape(points.everywhere(pool.sub(*pool.nodes[n][1:]))) for n in known}
    found: list[int] = []
    choices, rates = set[int](), set[int]()
    for number, a, b in _kinks(graph, known):
        distance = points.everywhere(pool.sub(a, b))
        if not np.isfinite(distance).all() or np.count_nonzero(np.abs(distance) <= _ZERO * np.abs(distance).max()) > 1:
            continue  # it rests at its kink, and what wakes it is elsewhere: maximum(f(maximum(u, 0)), 0)
        shape = _shape(distance)
        if shape in taken:
            continue
        op, *operands = pool.nodes[number]
        both = all(graph.moves(n) for n in (operands[1:] if op == "where" else (a, b)))
        if graph.jumps(a, b) and (both or not graph.is_rate(number)):
            continue
        taken.add(shape)
        # operands below `no_event` make it another node than a relation of the equations
        found.append(pool.make("gt", pool.make("noevent", a), pool.make("noevent", b)))
        if graph.is_rate(number):
            rates.add(found[-1])
        elif op == "where":
            choices.add(found[-1])
    narrow = steep(pool, points, graph.reachable, graph.moves)
    bursts = any(narrow.kinds[place] not in STEPS for _, place in narrow.middles)
    bursts |= any(not isinstance(kind, str) and kind > 1.0 for kind in narrow.kinds)  # a high power is one by itself
    systems: dict[int, list[int]] = {}
    for n in found:
        systems.setdefault(system(n), []).append(n)
    watched = set[int]()
    for own in systems.values():
        plain = [n for n in own if n in rates] if len(own) > MOST and not choices.isdisjoint(own) else own
        watched.update(plain[:MOST_PLAIN])
    left = set(found) - watched
    kept, passed_over = (tuple(n for n in found if n in some) for some in (watched, left))
    return Sleeping(kept, passed_over, bursts)


def _kinks(graph: _Graph, located: set[int]) -> Iterator[tuple[int, int, int]]:
    """Kinks: a node, and both sides of what decides it."""
    nodes, moving = graph.pool.nodes, graph.moving
    # a guard whose both sides are equally steep is found by the looks of its location, there and back
    outside = set(graph.pool.reachable(graph.unknowns, located))
    for number in graph.reachable:
        op, *operands = nodes[number]
        if op in ("min", "max") and any(moving[n] for n in operands):
            yield number, operands[0], operands[1]
        elif op == "fabs" and moving[operands[0]] and number in outside:
            yield number, operands[0], graph.pool.zero
        elif op == "where":
            for relation in graph.pool.reachable([operands[0]]):
                kind, *both = nodes[relation]
                if kind in RELATIONS and relation not in located and moving[relation]:
                    # as what is told of a > b is: a < b is b > a, to the last digit
                    yield number, *(both if kind in ("gt", "le") else reversed(both))


class _Graph:
    """The equations that rates depend on, as they were written, and what stands above each of their nodes."""

    def __init__(self, solution: Solution, discrete: frozenset[int]) -> None:
        structure = solution.structure
        self.pool: Pool = structure.reduced.pool
        self.points: SamplePoints = structure.points
        self.discrete = discrete
        self.rates = {structure.derivative(x) for x in structure.states}
        wanted = {*solution.needed, *solution.algebraic, *self.rates}
        blocks = [b for b in structure.blocks if not wanted.isdisjoint(b.columns)]
        self.unknowns = {structure.residuals[e]: b.columns for b in blocks for e in b.rows}
        self.reachable = self.pool.reachable(self.unknowns)
        self.above: dict[int, list[int]] = {}
        self.moving: dict[int, bool] = {}
        for number in self.reachable:
            op, *rest = self.pool.nodes[number]
            self.moving[number] = (op == "var" and rest[0] not in discrete) or op == "time"
            if op not in LEAVES:
                self.moving[number] = any(self.moving[c] for c in rest)
                for child in rest:
                    self.above.setdefault(child, []).append(number)

    def moves(self, number: int) -> bool:
        """Whether a node changes between events, also one that was made of these."""
        for n in self.pool.reachable([number], self.moving):
            op, *rest = self.pool.nodes[n]
            moving = (op == "var" and rest[0] not in self.discrete) or op == "time"
            self.moving[n] = moving or (op not in LEAVES and any(self.moving[c] for c in rest))
        return self.moving[number]

    def jumps(self, *numbers: int) -> bool:
        """Whether a function from outside computes them that may jump."""
        operations = (self.pool.nodes[n][0] for n in self.pool.reachable(numbers))
        return any(isinstance(op, Call) and op.external.jumps for op in operations)

    def is_rate(self, number: int) -> bool:
        """Whether a node enters the rate of a state linearly, between kinks."""
        seen, stack = set[int](), [number]
        while stack:
            for here in self._climbed(stack.pop(), _LINEAR | _PIECEWISE):
                for v in self.unknowns.get(here, ()):
                    if v in self.rates:
                        return True
                    if v not in seen:
                        seen.add(v)
                        stack.append(self.pool.var(v))
        return False

    def _climbed(self, number: int, through: frozenset[str]) -> Iterator[int]:
        """A node and all that hold it, through these operations; a product or quotient by what is constant only."""
        seen, stack = {number}, [number]
        while stack:
            here = stack.pop()
            yield here
            for n in self.above.get(here, ()):
                op, *operands = self.pool.nodes[n]
                if n in seen or op not in through:
                    continue
                others = operands[1:] if op == "div" else [c for c in operands if c != here]
                if op in ("mul", "div") and (not others or any(self.moving[c] for c in others)):
                    continue
                seen.add(n)
                stack.append(n)


def _shape(distance: Samples) -> bytes:
    """The same for distances that are multiples of each other, but for rounding."""
    finite = np.where(np.isfinite(distance), distance, 0.0)
    largest = finite[int(np.argmax(np.abs(finite)))]
    return np.round(finite / largest if largest else finite, _DIGITS).tobytes()
