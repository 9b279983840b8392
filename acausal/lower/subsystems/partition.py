"""Partition of a model into groups of states that do not interact through equations, clauses or assertions.

Two variables belong together if an integrated equation, a relation, a clause or an assertion contains both. Expressions
of time, parameters and inputs alone connect nothing: a source that drives two systems is a part of each. Observed
variables, such as the energy of all bodies, connect nothing either; they are computed from the whole model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from acausal.flatten.connections.connections import UnionFind
from acausal.flatten.pool import IMPULSE
from acausal.lower.lowered import Lowered


@dataclass(frozen=True)
class Group:
    """Indices of a group in the whole model: states, relations, clauses, assignments, assertions and `pre`."""

    states: tuple[int, ...]
    relations: tuple[int, ...]
    clauses: tuple[int, ...]
    assignments: tuple[int, ...]
    asserts: tuple[int, ...]
    memories: tuple[int, ...]

    @property
    def has_no_events(self) -> bool:
        """Whether no events can occur in the group."""
        return not (self.relations or self.memories or self.clauses or self.assignments or self.asserts)


def may_be_split(compiled: Lowered) -> bool:
    """Whether a model has only features that can be split: an ODE with events of its variables and of time."""
    nodes = compiled.solution.structure.reduced.pool.nodes
    actions = (node for c in compiled.state_events.clauses for _, node in c.actions)
    return (
        not compiled.solution.algebraic
        and compiled.solution.structure.rate is None
        and not (compiled.quadratures or compiled.delays or compiled.driven or compiled.varied)
        and not any(nodes[node][0] == IMPULSE for node in actions)
    )


def groups(compiled: Lowered) -> list[Group]:
    """The groups in the order of their first states, with all groups without events merged into one at the end.

    Empty if an event belongs to no state.
    """
    return _Partition(compiled).groups()


def system_of(compiled: Lowered) -> Callable[[int], int]:
    """Function from a node to the number of the system that it belongs to; always 0 if the model is not split."""
    if not may_be_split(compiled):
        return lambda node: 0
    return _Partition(compiled).system


class _Partition:
    def __init__(self, compiled: Lowered) -> None:
        self.compiled = compiled
        solution = compiled.solution
        self.pool, self.events = solution.structure.reduced.pool, compiled.state_events
        self.image = dict(compiled.rewritten)
        self.moving = set(compiled.state_variables)
        self.sets = UnionFind(self.pool.n_variables)
        rates = {x: self.pool.var(solution.structure.derivative(x)) for x in compiled.state_variables}
        statement_nodes = [n for nodes in self._statements() for n in nodes]
        needed = self._behind([*rates.values(), *statement_nodes])
        for variable, node in solution.definitions:
            if variable in needed:
                moving_inside = self._moving(node)
                if moving_inside:
                    self.moving.add(variable)
                    self._join([variable, *moving_inside])
        for x, rate in rates.items():
            self._join([x, *self._moving(rate)])
        for nodes in self._statements():
            self._join([v for n in nodes for v in self._moving(n)])

    def _statements(self) -> Iterator[list[int]]:
        """Nodes of each relation, clause, assignment and assertion, and of the states on which it acts."""
        events, var, states = self.events, self.pool.var, self.compiled.state_variables
        yield from ([n] for n in (*events.relations, *events.memories, *events.samples))
        for c in events.clauses:
            yield [*c.conditions, *c.earlier, *(n for k, v in c.actions for n in (v, var(states[k])))]
        yield from ([a.node, var(states[a.position])] for a in events.assignments)
        yield from ([a.condition] for a in events.asserts)

    def _behind(self, roots: Iterable[int]) -> set[int]:
        """Variables on which nodes depend, through definitions."""
        needed = {v for n in roots for v in self._variables(n)}
        for variable, node in reversed(self.compiled.solution.definitions):
            if variable in needed:
                needed |= self._variables(node)
        return needed

    def _variables(self, node: int) -> frozenset[int]:
        """Variables in a node, and in the branches that replace its kinks and jumps."""
        if not self.image:
            return self.pool.variables_in(node)
        self.pool.rewrite([node], self.pool.var, self.image)
        return self.pool.variables_in(node) | self.pool.variables_in(self.image[node])

    def _moving(self, node: int) -> list[int]:
        return [v for v in self._variables(node) if v in self.moving]

    def _join(self, variables: list[int]) -> None:
        for v in variables[1:]:
            self.sets.union(variables[0], v)

    def groups(self) -> list[Group]:
        """See `groups`."""
        states, events = self.compiled.state_variables, self.events
        indices = {"states": self._owners([self.pool.var(x)] for x in states)}
        indices["relations"] = self._owners([[n] for n in events.relations])
        indices["clauses"] = self._owners(
            [*c.conditions, *c.earlier, *(self.pool.var(states[k]) for k, _ in c.actions)] for c in events.clauses
        )
        indices["assignments"] = self._owners([self.pool.var(states[a.position])] for a in events.assignments)
        indices["asserts"] = self._owners([a.condition] for a in events.asserts)
        indices["memories"] = self._owners([[n] for n in events.memories])
        if any(-1 in owners for owners in indices.values()):
            return []  # an event of time alone would belong to all groups
        members: dict[int, dict[str, list[int]]] = {root: {name: [] for name in indices} for root in indices["states"]}
        for name, owners in indices.items():
            for k, root in enumerate(owners):
                members[root][name].append(k)
        all_groups = [Group(**{name: tuple(at) for name, at in part.items()}) for part in members.values()]
        with_events = [g for g in all_groups if not g.has_no_events]
        without_events = [g for g in all_groups if g.has_no_events]
        merged = {name: tuple(sorted(k for g in without_events for k in getattr(g, name))) for name in indices}
        return [*with_events, Group(**merged)] if without_events else with_events

    def system(self, node: int) -> int:
        """Number of the system that a node belongs to; -1 if it contains no moving variable."""
        first = next(iter(self._moving(node)), -1)
        return self.sets.find(first) if first >= 0 else -1

    def _owners(self, statements: Iterable[Iterable[int]]) -> list[int]:
        """The set that each statement belongs to; -1 if it contains no moving variable."""
        first = (next((v for n in nodes for v in self._moving(n)), -1) for nodes in statements)
        return [self.sets.find(v) if v >= 0 else -1 for v in first]
