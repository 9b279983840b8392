"""A model as it is composed: its instances and who is connected with whom, before anything becomes an equation.

What diagrams and descriptions of components are made from; no parameter needs a value for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from acausal.flatten.connections.connections import joints
from acausal.flatten.connections.orientation import is_overconstrained, spanning_tree
from acausal.flatten.instances.around import placed
from acausal.flatten.instances.instances import Instance, numbers
from acausal.flatten.instances.statements import Statement, statements
from acausal.language.component import Component, Connector
from acausal.language.connections.connect import Connection
from acausal.language.origin import Origin


@dataclass(frozen=True, eq=False)
class Composition:
    """Instances, owners before their parts, and connections.

    `number_of` maps `id(component)` to the number of its instance, for all that stands at an end of a connection.
    """

    found: Sequence[Instance]
    number_of: Mapping[int, int]
    _made: Sequence[tuple[int, Connection, Origin]]

    @property
    def connections(self) -> list[tuple[int, Connection]]:
        """All connections with the number of the component that makes them."""
        return [(number, item) for number, item, _ in self._made]

    def stated(self, *methods: str) -> list[tuple[str, Statement]]:
        """What the model itself states by each of `methods`, with the method's name, in the order of its classes.

        Its frames are in a tree whose roots are its own first frames, where nothing else is.
        """
        connected = [(number, item, origin) for number, item, origin in self._made]
        physical, _ = joints(connected, dict(self.number_of))
        own = [(p.number, p.component) for p in self.found[0].parts]
        assumed = [number for number, c in own if isinstance(c, Connector) and is_overconstrained(c)]
        spanning_tree(self.found, physical, dict(self.number_of), assumed)
        component = self.found[0].component
        return [(method, statement) for method in methods for statement in statements(component, method)]


def compose(model: Component) -> Composition:
    """The composition of a model.

    Raises DeclarationError: AC122 to AC131 and AC188, AC189: what is wrong with the composition itself.
    """
    found, _ = placed(model)
    number_of = numbers(found)
    made = [
        (instance.number, item, origin)
        for instance in found
        if not instance.is_leaf
        for item, origin in statements(instance.component)
        if isinstance(item, Connection)
    ]
    joints(made, number_of)  # for what it refuses
    return Composition(found, number_of, made)


def stated_equations(component: Component) -> list[tuple[str, str, str]]:
    """Text of each, what it asserts (or ""), and whether it holds "at the start" only (or "").

    Raises AcausalError: what stating them raises.
    """
    found = [(m, item) for m, (item, _) in compose(component).stated("equations", "initial_equations")]
    return [(str(i), getattr(i, "message", ""), "at the start" if m == "initial_equations" else "") for m, i in found]
