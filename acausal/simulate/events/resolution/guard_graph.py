"""The expressions behind the relations of a model, and which of them the rates of states depend on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from acausal.analyse.events.state_events import discrete_variables
from acausal.flatten.pool import LEAVES, Pool, closure
from acausal.lower.compiled import CompiledModel

_CHOICES, _PRODUCTS = frozenset(("where", "min", "max")), frozenset(("mul", "div"))


@dataclass(frozen=True, eq=False)
class GuardGraph:
    """Nodes of a pool behind `relations`, through definitions of variables."""

    compiled: CompiledModel
    pool: Pool

    @cached_property
    def relations(self) -> set[int]:
        """Nodes of the located relations."""
        return set(self.compiled.state_events.relations)

    @cached_property
    def definitions(self) -> dict[int, int]:
        """Nodes on which variables depend: definitions, or residuals instead of Newton iterations for them."""
        residuals = {m.variable: m.residual for m in self.compiled.solution.monotone}
        return dict(self.compiled.solution.definitions) | residuals

    @cached_property
    def guarded(self) -> set[int]:
        """Nodes on which relations depend."""
        return self._behind(self.relations, set())

    @cached_property
    def effective(self) -> set[int]:
        """Nodes on which rates depend as some relations hold."""
        return self._behind(self._rates, self.relations)

    @cached_property
    def resolved(self) -> set[int]:
        """Nodes on which rates depend whatever holds, so that the error control of a solver resolves them."""
        return self._behind(self._rates, self.relations | self._intermittent())

    @cached_property
    def moving(self) -> set[int]:
        """Nodes behind relations that vary between events."""
        discretes = self.pool.vars(discrete_variables(self.compiled.solution.structure.reduced))
        constants = self.relations.union(discretes)
        start, above = list[int](), dict[int, list[int]]()
        for n in self.guarded - constants:
            op, *operands = self.pool.nodes[n]
            if op == "time" or (op == "var" and operands[0] not in self.definitions):
                start.append(n)
            for k in self.operands(n):
                above.setdefault(k, []).append(n)
        return closure(start, lambda n: above.get(n, ()))

    def operands(self, n: int) -> Sequence[int]:
        """The operands of a node, or the node that defines a variable."""
        op, *operands = self.pool.nodes[n]
        if op not in LEAVES:
            return operands
        return [self.definitions[operands[0]]] if op == "var" and operands[0] in self.definitions else []

    def in_order(self, roots: Iterable[int]) -> list[int]:
        """All nodes behind definitions and roots, each after those on which it depends."""
        order, done = list[int](), set[int]()
        for n in [*self.definitions.values(), *roots]:
            fresh = self.pool.reachable([n], done)
            done.update(fresh)
            order += fresh
        return order

    @property
    def _rates(self) -> list[int]:
        structure = self.compiled.solution.structure
        return [*structure.rates(self.compiled.state_variables), *self.compiled.solution.residuals]

    def _behind(self, roots: Iterable[int], barriers: set[int]) -> set[int]:
        """Nodes on which these roots depend, through definitions, but not through `barriers`."""
        pending, seen = list(roots), set[int]()
        while pending:
            fresh = set(self.pool.reachable(pending, barriers)) - seen
            seen |= fresh
            variables = (self.pool.nodes[n][1] for n in fresh if self.pool.nodes[n][0] == "var")
            behind = {self.definitions[v] for v in variables if v in self.definitions}
            pending = list(behind - seen - barriers)
        return seen

    def _intermittent(self) -> set[int]:
        """Choices, and products with a choice as a factor: what they depend on may have no effect for a long time.

        A profile acts on a wheel only where they touch. Until then no rate shows it, and no step resolves it.
        """
        found, switching = set[int](), set[int]()
        for n in self.in_order(self._rates):
            op, switches = self.pool.nodes[n][0], not switching.isdisjoint(self.operands(n))
            if op in _CHOICES or (op in _PRODUCTS and switches):
                found.add(n)
            if op in _CHOICES or switches:
                switching.add(n)
        return found
