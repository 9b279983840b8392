"""Connected elements of vector signals: `connect(self.gain.y, self.mux.u[2])`.

Signals connected as a whole share their scalars. An element cannot, because the scalars of a vector are contiguous: its
connection becomes an equation, or an assignment for a discrete signal.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from acausal.errors import DeclarationError
from acausal.flatten.connections.connections import SignalJoint, number_of_end
from acausal.flatten.flat import FlatAssignment, FlatEquation, suffix
from acausal.flatten.instances.instances import Instance
from acausal.flatten.pool import Pool
from acausal.language.connections.connect import Connection, is_element, signal_of
from acausal.language.declarations.declaration import Kind
from acausal.language.expressions.expression import Expr, Symbol
from acausal.language.statement import Origin

Entry = tuple[int, str, int]
"""A scalar of a signal: instance, name, row-major index."""


@dataclass(frozen=True)
class ElementJoint:
    """A source and the entry it drives, connected by component `by`."""

    source: Entry
    sink: Entry
    by: int
    origin: Origin


def element_joints(
    found: Sequence[Instance],
    connections: Iterable[tuple[int, Connection, Origin]],
    signals: Sequence[SignalJoint],
    number_of: dict[int, int],
) -> list[ElementJoint]:
    """Connections with an element at one of their ends.

    Raises DeclarationError: AC132 when a connection has no source or several, or when a scalar is driven twice.
    """
    whole = {(*end, j.by): j.origin for j in signals for end in (j.a, j.b)}
    made: list[ElementJoint] = []
    driven: dict[Entry, Origin] = {}
    for by, connection, origin in connections:
        if not any(is_element(end) for end in connection.ends):
            continue
        ends = [_entry(end, number_of, origin) for end in connection.ends if isinstance(end, Expr)]
        sources = [e for e in ends if _is_source(found, e, by)]
        if len(sources) != 1:
            names = ", ".join(_name(found, e) for e in sources or ends)
            raise DeclarationError(
                "AC132",
                f"two sources drive one signal: {names}" if sources else f"no source among the ends: {names}",
                where=(origin.span(),),
                help="connect each input to one output",
            )
        for sink in ends:
            if sink == sources[0]:
                continue
            before = driven.get(sink) or whole.get((sink[0], sink[1], by))
            if before is not None:
                raise DeclarationError(
                    "AC132",
                    f"two sources drive one signal: {_name(found, sink)}",
                    where=(before.span(), origin.span()),
                    help="connect each input to one output",
                )
            driven[sink] = origin
            made.append(ElementJoint(sources[0], sink, by, origin))
    return made


def element_equations(
    pool: Pool, found: Sequence[Instance], joints: Sequence[ElementJoint]
) -> tuple[list[FlatEquation], list[FlatAssignment]]:
    """Equations and assignments of the connections of elements."""
    equations: list[FlatEquation] = []
    assignments: list[FlatAssignment] = []
    for joint in joints:
        source, sink = (found[number].first[name] + k for number, name, k in (joint.source, joint.sink))
        text = f"{_name(found, joint.sink)} == {_name(found, joint.source)}"
        path = found[joint.by].path
        if found[joint.sink[0]].component._declarations[joint.sink[1]].discrete:
            assignments.append(FlatAssignment(sink, pool.var(source), joint.origin, path, text))
        else:
            equations.append(FlatEquation(pool.var(sink), pool.var(source), joint.origin, path, text))
    return equations, assignments


def _entry(end: Expr, number_of: dict[int, int], origin: Origin) -> Entry:
    symbol: Symbol = signal_of(end)
    place = 0
    for index, size in zip(end.payload if is_element(end) else (), symbol.shape, strict=False):
        place = place * size + index
    return number_of_end(symbol.owner, number_of, origin), symbol.name, place


def _is_source(found: Sequence[Instance], entry: Entry, by: int) -> bool:
    number, name, _ = entry
    kind = found[number].component._declarations[name].kind
    return kind is (Kind.INPUT if number == by else Kind.OUTPUT)


def _name(found: Sequence[Instance], entry: Entry) -> str:
    number, name, place = entry
    shape = found[number].component._declarations[name].shape
    return found[number].prefix + name + suffix(shape, place)
