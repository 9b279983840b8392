"""Kinks without events that are located all the same, because a solver could step over a change of a rate there.

`minimum`, `maximum`, `fabs` and relations below `no_event` make no events: error control notices such a kink when a
step ends beyond it. In `y' = k * maximum(x - 1, 0)`, however, the rate is constant on one side. Nothing then bounds the
step there, and a solver may pass the whole other side without a single evaluation on it. A stretch of the run therefore
ends where such a kink is reached, and the next one begins there, without an event.

Where both sides vary, or the active side is multiplied by something that varies, the solver chooses its step from the
side that it sees, and still overlooks an excursion beyond the kink that is shorter than a step: `speed * maximum(force,
-limit)`, or `fabs((t - 1) * (t - 1.1))`, whose dip a method of third order does not notice. All kinks are therefore
located, except

- those of external functions that may jump (`External.jumps`), if both sides vary or they do not enter a rate linearly;
- drag, `v' = force - c * v * fabs(v)`, if no other rate depends on it. The rate and its slope are the same on both
  sides, and a velocity that turns twice within a step is off by the fifth power of the time between. Its error stays
  below the tolerance, because what overlooks it must also be small in the velocity that the error control sees. The
  integral of `v * fabs(v)` is another matter: there, drag may be zero, and `v` a polynomial that is integrated exactly.

Each located kink costs a guard, and a stretch whenever it is passed. Bodies in contact have hundreds of kinks, for all
the ways in which their faces may overlap: choices below `no_event` that move a point of contact while the force acts.
If a system has many, those that do not enter the rate of a state linearly are not located but returned, for a message
and a bound on the steps. Locating them too (weights of contact points, `minimum` and `maximum` in products) would take
eight times as long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.domains.partial_relations import Existence
from acausal.analyse.events.steep import STEPS, steep
from acausal.flatten.pool import LEAVES, RELATIONS, Pool
from acausal.flatten.reduced import ReducedSystem
from acausal.language.expressions.external import Call
from acausal.numeric.evaluate import Samples
from acausal.numeric.samples import SamplePoints

MOST = 120
"""If a system has more kinks than this and choices are among them, only those in rates are located."""
MOST_PLAIN = 1000
"""Largest number of located kinks of one system."""

_LINEAR = frozenset(("add", "sub", "neg", "mul", "div"))
_PIECEWISE = frozenset(("min", "max", "where", "noevent"))
# Two distances are multiples of each other if their normalised samples agree to this many digits.
_DIGITS = 9
# A difference counts as zero if it is smaller than this fraction of its largest sample.
_ZERO = 1e-12


@dataclass(frozen=True)
class LocatedKinks:
    """Relations that decide the active side of kinks: `watched` nodes, which no equation contains."""

    watched: tuple[int, ...] = ()
    unlocated: tuple[int, ...] = ()
    """Relations of kinks that are not located, because there are too many."""
    bursts: bool = False
    """Whether there are bursts, whose values near underflow are replaced (`state_events.without_underflow`)."""
    branches: bool = False
    """Whether the kinks themselves become branches on these relations, for one-sided derivatives."""
    numbers: tuple[int, ...] = ()
    """Nodes of the stretch numbers of long tables (`acausal.analyse.events.time_events`)."""


def located_kinks(
    solution: Solution,
    located: Iterable[int],
    discrete: frozenset[int],
    system: Callable[[int], int],
    *,
    slopes: bool = False,
) -> LocatedKinks:
    """Kinks to locate, except those that coincide with a `located` relation, and those whose operand rests at the kink.

    `system` maps a relation to the number of its system; the limits `MOST` and `MOST_PLAIN` hold for each system.
    `slopes`: Locate drag too, because the slope of the rates, which has a kink there, is integrated as well.
    """
    located_nodes = set(located)
    graph = _Graph(solution, discrete)
    reduced, pool, points = solution.structure.reduced, graph.pool, graph.points
    known_directions = {_direction_key(points.everywhere(pool.sub(*pool.nodes[n][1:]))) for n in located_nodes}
    relations: list[int] = []
    choices, rates = set[int](), set[int]()
    images = dict[int, int]()
    for number, *sides in _kinks(graph, located_nodes):
        a, b = _images(reduced, sides, images)
        if not (graph.moves(a) or graph.moves(b)) or _depends_on_reduced(reduced, a, b):
            continue
        distance = points.everywhere(pool.sub(a, b))
        if not np.isfinite(distance).all() or np.count_nonzero(np.abs(distance) <= _ZERO * np.abs(distance).max()) > 1:
            continue  # its operand rests at the kink until another kink moves it: maximum(f(maximum(u, 0)), 0)
        direction = _direction_key(distance)
        if direction in known_directions or (not slopes and _is_drag(graph, number, images)):
            continue
        op, *operands = pool.nodes[number]
        both_vary = all(graph.moves(n) for n in (operands[1:] if op == "where" else (a, b)))
        if graph.jumps(a, b) and (both_vary or not graph.is_rate(number)):
            continue
        known_directions.add(direction)
        # `noevent` around operands distinguishes it from a relation of the equations
        relations.append(pool.make("gt", pool.make("noevent", a), pool.make("noevent", b)))
        if graph.is_rate(number):
            rates.add(relations[-1])
        elif op == "where":
            choices.add(relations[-1])
    steep_functions = steep(pool, points, graph.reachable, graph.moves)
    bursts = any(steep_functions.kinds[argument] not in STEPS for _, argument in steep_functions.middles)
    bursts |= any(
        isinstance(kind, float) and kind > 1.0 for kind in steep_functions.kinds
    )  # a high power is a burst by itself
    systems: dict[int, list[int]] = {}
    for n in relations:
        systems.setdefault(system(n), []).append(n)
    watched = set[int]()
    for group in systems.values():
        kept = [n for n in group if n in rates] if len(group) > MOST and not choices.isdisjoint(group) else group
        watched.update(kept[:MOST_PLAIN])
    unlocated = set(relations) - watched
    watched_relations, others = (tuple(n for n in relations if n in selected) for selected in (watched, unlocated))
    return LocatedKinks(watched_relations, others, bursts)


def _images(reduced: ReducedSystem, nodes: Sequence[int], done: dict[int, int]) -> list[int]:
    """Nodes with variables that a reduction folded replaced by their values; the original equations contain both."""

    def image(v: int) -> int:
        # Derivatives that the compiler has named or added have no image.
        scalar = reduced.scalar[v] if v < len(reduced.scalar) else len(reduced.image)
        return reduced.image[scalar] if scalar < len(reduced.image) else reduced.pool.var(v)

    reduced.pool.rewrite(nodes, image, done)
    return [done[n] for n in nodes]


def _is_drag(graph: _Graph, number: int, images: dict[int, int]) -> bool:
    """Whether a node is the magnitude of a state that only enters its own rate, and only multiplied by this state."""
    op, operand, *_ = graph.pool.nodes[number]
    if op != "fabs" or graph.reduced.delays:  # whatever is delayed may enter other rates later
        return False
    (image,) = _images(graph.reduced, [operand], images)
    kind, *state = graph.pool.nodes[image]
    if kind != "var" or state[0] not in graph.states:
        return False

    def contains_state(node: int) -> bool:
        op, *operands = graph.pool.nodes[node]
        if op in ("mul", "neg", "div"):
            return any(contains_state(n) for n in (operands if op == "mul" else operands[:1]))
        return _images(graph.reduced, [node], images) == [image]

    stack = [number]
    while stack:
        here = stack.pop()
        if here in graph.unknowns:
            return False
        for n in graph.above.get(here, ()):
            op, *operands = graph.pool.nodes[n]
            if op not in _LINEAR or (op == "div" and operands[1] == here):
                return False
            if op != "mul" or not any(contains_state(c) for c in operands if c != here):
                stack.append(n)
    return graph.rates_above(number) <= {graph.structure.derivative(state[0])}


def _depends_on_reduced(reduced: ReducedSystem, *nodes: int) -> bool:
    """Whether nodes depend on variables that a reduction left out; no remaining equation depends on these."""
    for v in reduced.pool.variables_in(*nodes) if reduced.left_out else ():
        while v >= len(reduced.scalar):
            v = reduced.pool.integral_of[v]
        if reduced.scalar[v] in reduced.left_out:
            return True
    return False


def _kinks(graph: _Graph, located: set[int]) -> Iterator[tuple[int, int, int]]:
    """Kinks: (node, both sides of the comparison that decides it)."""
    nodes, moving = graph.pool.nodes, graph.moving
    # A guard that contains `fabs` needs no kink: the location of events finds a crossing there and back by itself.
    outside = set(graph.pool.reachable(graph.unknowns, located))
    for number in graph.reachable:
        op, *operands = nodes[number]
        if op in ("min", "max") and any(moving[n] for n in operands):
            yield number, operands[0], operands[1]
        elif op == "fabs" and moving[operands[0]] and number in outside:
            yield number, operands[0], graph.pool.zero
        elif op == "where":
            for relation in graph.pool.reachable([operands[0]]):
                if nodes[relation][0] in RELATIONS and relation not in located and moving[relation]:
                    # one without a value somewhere is looked at in its parts where only it decides the rate: guards of
                    # roots are dear, and where a side varies, error control chooses the step by it
                    decides = not any(graph.moves(n) for n in operands[1:])
                    for part in graph.existence.relations(relation) if decides else [relation]:
                        # Order the sides as those of a > b; a < b is exactly b > a.
                        kind, *compared = nodes[part]
                        yield number, *(compared if kind in ("gt", "le") else reversed(compared))


class _Graph:
    """Graph of those original equations that rates depend on, with the parents of each node."""

    def __init__(self, solution: Solution, discrete: frozenset[int]) -> None:
        self.structure = structure = solution.structure
        self.reduced, self.states = structure.reduced, frozenset(structure.states)
        self.pool: Pool = structure.reduced.pool
        self.points: SamplePoints = structure.points
        self.discrete = discrete
        self.rates = {structure.derivative(x) for x in structure.states}
        rate_variables = {*solution.needed, *solution.algebraic, *self.rates}
        blocks = [b for b in structure.blocks if not rate_variables.isdisjoint(b.columns)]
        self.unknowns = {structure.residuals[e]: b.columns for b in blocks for e in b.rows}
        self.reachable = self.pool.reachable(self.unknowns)
        self.existence = Existence(solution, self.moves, exempt=True)
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
        """Whether a node varies between events; the node may be newer than the graph."""
        for n in () if number in self.moving else self.pool.reachable([number], self.moving):
            op, *rest = self.pool.nodes[n]
            moving = (op == "var" and rest[0] not in self.discrete) or op == "time"
            self.moving[n] = moving or (op not in LEAVES and any(self.moving[c] for c in rest))
        return self.moving[number]

    def jumps(self, *numbers: int) -> bool:
        """Whether nodes contain an external function that may jump."""
        operations = (self.pool.nodes[n][0] for n in self.pool.reachable(numbers))
        return any(isinstance(op, Call) and op.external.jumps for op in operations)

    def is_rate(self, number: int) -> bool:
        """Whether a node enters the rate of a state linearly, except for kinks."""
        seen, stack = set[int](), [number]
        while stack:
            for here in self._ancestors(stack.pop(), _LINEAR | _PIECEWISE):
                for v in self.unknowns.get(here, ()):
                    if v in self.rates:
                        return True
                    if v not in seen:
                        seen.add(v)
                        stack.append(self.pool.var(v))
        return False

    def rates_above(self, number: int) -> set[int]:
        """Rates of states that may depend on a node."""
        seen, stack, found = {number}, [number], set[int]()
        while stack:
            here = stack.pop()
            found.update(self.rates.intersection(self.unknowns.get(here, ())))
            above = (*self.above.get(here, ()), *(self.pool.var(v) for v in self.unknowns.get(here, ())))
            stack += (new := set(above) - seen)
            seen |= new
        return found

    def _ancestors(self, number: int, through: frozenset[str]) -> Iterator[int]:
        """A node and its ancestors through these operations, including products and quotients with constants only."""
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


def _direction_key(distance: Samples) -> bytes:
    """Key that is equal for distances, shape (K,), that are multiples of each other up to rounding errors."""
    finite = np.where(np.isfinite(distance), distance, 0.0)
    largest = finite[int(np.argmax(np.abs(finite)))]
    return np.round(finite / largest if largest else finite, _DIGITS).tobytes()
