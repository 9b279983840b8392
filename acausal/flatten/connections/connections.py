"""Connection sets: connectors that share potentials, and connectors whose flows sum to zero."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from acausal.errors import DeclarationError, StructureError
from acausal.flatten.instances.instances import Instance
from acausal.language.component import Component, Connector
from acausal.language.connections.connect import Connection, is_element
from acausal.language.declarations.declaration import Kind
from acausal.language.expressions.expression import Expr, Symbol
from acausal.language.statement import Origin


class UnionFind:
    """Disjoint sets over 0 ... n-1; the smallest member represents its set."""

    def __init__(self, n: int) -> None:
        self.parent = list(range(n))

    def find(self, i: int) -> int:
        parent = self.parent
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    def union(self, i: int, j: int) -> bool:
        """Merge two sets; False if they were already the same."""
        a, b = self.find(i), self.find(j)
        if a == b:
            return False
        self.parent[max(a, b)] = min(a, b)
        return True


class Joint(NamedTuple):
    """One connection between two connector instances, made by component `by`."""

    a: int
    b: int
    by: int
    origin: Origin


class SignalJoint(NamedTuple):
    """One connection between two signals `(instance, name)`."""

    a: tuple[int, str]
    b: tuple[int, str]
    by: int
    origin: Origin


def joints(
    connections: Iterable[tuple[int, Connection, Origin]], number_of: dict[int, int]
) -> tuple[list[Joint], list[SignalJoint]]:
    """Connections as pairs of instance numbers; `number_of` maps `id(component)` to its number."""
    physical: list[Joint] = []
    signals: list[SignalJoint] = []
    for by, connection, origin in connections:
        first = connection.ends[0]
        if isinstance(first, Expr) and any(is_element(end) for end in connection.ends):
            continue  # connections of elements are treated in `acausal.flatten.connections.signals`
        for other in connection.ends[1:]:
            if isinstance(first, Connector) and isinstance(other, Connector):
                a_number = number_of_end(first, number_of, origin)
                physical.append(Joint(a_number, number_of_end(other, number_of, origin), by, origin))
            elif isinstance(first, Symbol) and isinstance(other, Symbol):
                a = (number_of_end(first.owner, number_of, origin), first.name)
                signals.append(SignalJoint(a, (number_of_end(other.owner, number_of, origin), other.name), by, origin))
    return physical, signals


def number_of_end(component: Component, number_of: dict[int, int], origin: Origin) -> int:
    """Number of the component at an end; raises DeclarationError AC131 if it is no part of the model."""
    number = number_of.get(id(component))
    if number is None:
        owner = component.__dict__["_owner"]
        top = component if owner is None else owner[0]
        path = component._path_to("").rstrip(".") or type(component).__name__
        raise DeclarationError(
            "AC131",
            f"{path} of a {type(top).__name__} is connected, but that {type(top).__name__} is no part of the model",
            where=(origin.span(),),
            help="declare it with part(), set it in `build`, and write self.<part>",
        )
    return number


class FlowSet(NamedTuple):
    """Connector faces whose flows sum to zero, as pairs (instance, sign).

    A connector of a component has one face for connections from outside, and one, with sign -1, for connections to the
    parts of the component.
    """

    members: tuple[tuple[int, int], ...]
    origin: Origin | None


def flow_sets(all_instances: Sequence[Instance], physical: Sequence[Joint]) -> list[FlowSet]:
    """One set per junction; a connector without an outside connection is a set by itself, and its flow is zero."""
    faces = UnionFind(2 * len(all_instances))
    used_outside: set[int] = set()
    origins: dict[int, Origin] = {}
    for joint in physical:
        ends = []
        for number in (joint.a, joint.b):
            owner = all_instances[number].owner
            is_outer = owner is not None and owner.number == joint.by
            if is_outer:
                used_outside.add(number)
            ends.append(2 * number + is_outer)
        faces.union(*ends)
        for end in ends:
            origins.setdefault(end, joint.origin)
    members: dict[int, list[tuple[int, int]]] = {}
    origin: dict[int, Origin] = {}
    for instance in all_instances:
        if not isinstance(instance.component, Connector):
            continue
        i = instance.number
        for face, sign in ((2 * i, 1), (2 * i + 1, -1)):
            if sign == 1 or i in used_outside:
                root = faces.find(face)
                members.setdefault(root, []).append((i, sign))
                if face in origins:
                    origin.setdefault(root, origins[face])
    return [FlowSet(tuple(m), origin.get(r)) for r, m in members.items()]


def refuse_open(all_instances: Sequence[Instance], sets: Sequence[FlowSet]) -> None:
    """Refuse open connectors that their component requires to be connected (StructureError AC212)."""
    for flow_set in sets:
        first = all_instances[flow_set.members[0][0]]
        owner = first.owner
        name = first.path.rpartition(".")[2]
        if len(flow_set.members) > 1 or owner is None or name not in type(owner.component)._to_be_connected:
            continue
        hints = [d.hint for d in first.component._declarations.values() if d.hint and d.kind is Kind.VARIABLE]
        raise StructureError(
            "AC212",
            f"{type(all_instances[0].component).__name__}: {first.path} is not connected",
            where=(owner.origin.span(),),
            cause=hints[0] if hints else "an open connector carries no flow, but the component prescribes its flow",
            help=f"connect {first.path}",
        )


def check_signals(all_instances: Sequence[Instance], signals: Sequence[SignalJoint]) -> None:
    """Refuse a signal driven by two sources (AC132).

    A signal of a component has two faces: an outer one for connections by its owner, and an inner one for connections
    by the component itself. At the inner face an input is a source and an output is not.
    """
    faces = [tuple((*end, all_instances[end[0]].number == joint.by) for end in (joint.a, joint.b)) for joint in signals]
    index = {face: k for k, face in enumerate(dict.fromkeys(face for pair in faces for face in pair))}
    sets = UnionFind(len(index))
    for a, b in faces:
        sets.union(index[a], index[b])
    by_root: dict[int, tuple[str, Origin]] = {}
    for joint, pair in zip(signals, faces, strict=True):
        for face in pair:
            number, signal, is_inner = face
            instance = all_instances[number]
            kind = instance.component._declarations[signal].kind
            is_source = (kind is Kind.OUTPUT and not is_inner) or (kind is Kind.INPUT and is_inner)
            name = instance.prefix + signal
            if not is_source:
                continue
            root = sets.find(index[face])
            previous = by_root.setdefault(root, (name, joint.origin))
            if previous[0] != name:
                raise DeclarationError(
                    "AC132",
                    f"two sources drive one signal: {previous[0]} and {name}",
                    where=(previous[1].span(), joint.origin.span()),
                    help=f"connect each input to one output; to invert a model state `{previous[0]} == {name}`",
                )
