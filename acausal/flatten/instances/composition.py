"""Composition of a model: its instances and connections, before equations are generated.

Diagrams and descriptions of components use it; parameters need no values for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from acausal.flatten.connections.connections import joints
from acausal.flatten.connections.orientation import is_overconstrained, spanning_tree
from acausal.flatten.instances.instances import Instance, numbers, placed
from acausal.flatten.instances.statements import Statement, statements
from acausal.language.component import Component, Connector
from acausal.language.connections.connect import Connection
from acausal.language.statement import Origin


@dataclass(frozen=True, eq=False)
class Composition:
    """Instances, owners before their parts, and connections.

    `number_of` maps `id(component)` to the number of its instance, for every end of a connection.
    """

    found: Sequence[Instance]
    number_of: Mapping[int, int]
    _made: Sequence[tuple[int, Connection, Origin]]

    @property
    def connections(self) -> list[tuple[int, Connection]]:
        """All connections with the number of the component that states them."""
        return [(number, item) for number, item, _ in self._made]

    def stated(self, *methods: str) -> list[tuple[str, Statement]]:
        """(Method, statement) for the statements of the `methods` of the model itself, base classes first.

        If there is no root, the frames of the model itself are potential roots of the spanning tree, so that a
        component can be described alone.
        """
        connected = [(number, item, origin) for number, item, origin in self._made]
        physical, _ = joints(connected, dict(self.number_of))
        own_parts = [(p.number, p.component) for p in self.found[0].parts]
        assumed = [number for number, c in own_parts if isinstance(c, Connector) and is_overconstrained(c)]
        spanning_tree(self.found, physical, dict(self.number_of), assumed)
        component = self.found[0].component
        return [(method, statement) for method in methods for statement in statements(component, method)]


def compose(model: Component) -> Composition:
    """The composition of a model.

    Raises DeclarationError: AC122 to AC131 and AC188, AC189, for errors of the composition.
    """
    all_instances, _ = placed(model)
    number_of = numbers(all_instances)
    connections = [
        (instance.number, item, origin)
        for instance in all_instances
        if not instance.is_leaf
        for item, origin in statements(instance.component)
        if isinstance(item, Connection)
    ]
    joints(connections, number_of)  # raises errors of connections
    return Composition(all_instances, number_of, connections)


def stated_equations(component: Component) -> list[tuple[str, str, str]]:
    """(Text, message of an assertion or "", "at the start" or "") of each equation of a component.

    Raises AcausalError: errors of the statements themselves.
    """
    items = [(m, item) for m, (item, _) in compose(component).stated("equations", "initial_equations")]
    return [(str(i), getattr(i, "message", ""), "at the start" if m == "initial_equations" else "") for m, i in items]
