"""Signals: connected elements of vectors, inputs of a model that nothing drives, and signals cut by `acausal.free`.

Signals that are connected as a whole share their scalars. A single element, as in `connect(self.gain.y,
self.mux.u[2])`, cannot share, because the scalars of a vector are contiguous: its connection becomes an equation, or an
assignment if the signal is discrete.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from math import prod

from acausal.errors import DeclarationError, UsageError, meant
from acausal.flatten.connections.connections import SignalJoint, number_of_end
from acausal.flatten.flat import FlatAssignment, FlatEquation, suffix
from acausal.flatten.instances.instances import Instance
from acausal.flatten.pool import Pool
from acausal.language.component import Component
from acausal.language.connections.connect import Connection, is_element, signal_of
from acausal.language.declarations.declaration import Declaration, Fixed, Guess, Kind
from acausal.language.expressions.expression import Expr, Symbol
from acausal.language.statement import Origin

Entry = tuple[int, str, int]
"""A scalar of a signal: instance, name, row-major index."""


@dataclass(frozen=True)
class ElementJoint:
    """A source and the entry that it drives, connected by component `by`."""

    source: Entry
    sink: Entry
    by: int
    origin: Origin


def element_joints(
    all_instances: Sequence[Instance],
    connections: Iterable[tuple[int, Connection, Origin]],
    signals: Sequence[SignalJoint],
    number_of: dict[int, int],
) -> list[ElementJoint]:
    """Connections with an element at one of their ends.

    Raises DeclarationError: AC132 if a connection has no source or several, or if a scalar is driven twice.
    """
    connected_as_whole = {(*end, j.by): j.origin for j in signals for end in (j.a, j.b)}
    element_connections: list[ElementJoint] = []
    driven: dict[Entry, Origin] = {}
    for by, connection, origin in connections:
        if not isinstance(connection.ends[0], Expr) or not any(is_element(end) for end in connection.ends):
            continue
        ends = [_entry(end, number_of, origin) for end in connection.ends if isinstance(end, Expr)]
        sources = [e for e in ends if _is_source(all_instances, e, by)]
        if len(sources) != 1:
            names = ", ".join(_name(all_instances, e) for e in sources or ends)
            raise DeclarationError(
                "AC132",
                f"two sources drive one signal: {names}" if sources else f"no source among the ends: {names}",
                where=(origin.span(),),
                help="connect each input to one output",
            )
        for sink in ends:
            if sink == sources[0]:
                continue
            previous = driven.get(sink) or connected_as_whole.get((sink[0], sink[1], by))
            if previous is not None:
                raise DeclarationError(
                    "AC132",
                    f"two sources drive one signal: {_name(all_instances, sink)}",
                    where=(previous.span(), origin.span()),
                    help="connect each input to one output",
                )
            driven[sink] = origin
            element_connections.append(ElementJoint(sources[0], sink, by, origin))
    return element_connections


def element_equations(
    pool: Pool, all_instances: Sequence[Instance], joints: Sequence[ElementJoint]
) -> tuple[list[FlatEquation], list[FlatAssignment]]:
    """Equations and assignments of the connections of elements."""
    equations: list[FlatEquation] = []
    assignments: list[FlatAssignment] = []
    for joint in joints:
        source, sink = (all_instances[number].first[name] + k for number, name, k in (joint.source, joint.sink))
        text = f"{_name(all_instances, joint.sink)} == {_name(all_instances, joint.source)}"
        path = all_instances[joint.by].path
        if all_instances[joint.sink[0]].component._declarations[joint.sink[1]].discrete:
            assignments.append(FlatAssignment(sink, pool.var(source), joint.origin, path, text))
        else:
            equations.append(FlatEquation(pool.var(sink), pool.var(source), joint.origin, path, text))
    return equations, assignments


def _entry(end: Expr, number_of: dict[int, int], origin: Origin) -> Entry:
    symbol: Symbol = signal_of(end)
    position = 0
    for index, size in zip(end.payload if is_element(end) else (), symbol.shape, strict=False):
        position = position * size + index
    return number_of_end(symbol.owner, number_of, origin), symbol.name, position


def _is_source(all_instances: Sequence[Instance], entry: Entry, by: int) -> bool:
    number, name, _ = entry
    kind = all_instances[number].component._declarations[name].kind
    return kind is (Kind.INPUT if number == by else Kind.OUTPUT)


def _name(all_instances: Sequence[Instance], entry: Entry) -> str:
    number, name, entry_index = entry
    shape = all_instances[number].component._declarations[name].shape
    return all_instances[number].prefix + name + suffix(shape, entry_index)


Signal = tuple[int, str]
"""A signal: instance, name."""
_OPEN = Guess(0.0)


def freed_signals(model: Component, all_instances: Sequence[Instance]) -> frozenset[Signal]:
    """The signals that `acausal.free` has named.

    Raises UsageError: AC047 for a name that is not an input, or an input that changes at events only.
    """
    paths = model.__dict__.get("_freed", ())
    if not paths:
        return frozenset()
    declared = {i.prefix + name: (i, name, d) for i in all_instances for name, d in i.component._declarations.items()}
    inputs = [path for path, (_, _, d) in declared.items() if d.kind is Kind.INPUT and not d.discrete]
    signals = set()
    for path in paths:
        if path not in inputs:
            raise _not_an_input(type(model).__name__, path, declared[path][2] if path in declared else None, inputs)
        instance, name, _ = declared[path]
        signals.add((instance.number, name))
    return frozenset(signals)


def _not_an_input(model: str, path: str, declaration: Declaration | None, inputs: Sequence[str]) -> UsageError:
    if declaration is None:
        fact = f"{model} has no signal '{path}'"
    elif declaration.discrete:
        fact = f"{path} changes at events only: it cannot be a function of time"
    else:
        fact = f"{path} is a {declaration.kind.value}, not an input"
    return UsageError(
        "AC047",
        fact,
        evidence=meant(path, list(inputs)) or [f"inputs: {', '.join(inputs[:6]) or 'none'}"],
        help="free the signal_input that is to be driven, not the source that drives it",
    )


def open_inputs(model: Instance, cut: Collection[Signal]) -> frozenset[Signal]:
    """Signals that are inputs of the model: its own without a binding or with a number as default, and `cut`."""
    values, given = model.component.__dict__["_values"], model.component.__dict__["_given"]
    open_signals = {
        (model.number, name)
        for name, d in model.component._declarations.items()
        if d.kind is Kind.INPUT
        and (isinstance(values.get(name, _OPEN), Fixed | Guess) or (name not in given and _is_number(d)))
    }
    return frozenset(open_signals | set(cut))


def _is_number(declaration: Declaration) -> bool:
    """Whether the declared default is a number and the signal continuous; discrete defaults are bindings."""
    value = declaration.default
    return isinstance(value, int | float) and not isinstance(value, bool) and not declaration.discrete


def cut_joints(signals: Sequence[SignalJoint], cut: Collection[Signal]) -> list[SignalJoint]:
    """Connections without those that drive a cut signal from outside; their other ends stay connected."""
    remaining: list[SignalJoint] = []
    neighbours: dict[Signal, list[tuple[Signal, SignalJoint]]] = {end: [] for end in cut}
    stack = list(signals)
    while stack:
        joint = stack.pop(0)
        cut_end = next((end for end in (joint.a, joint.b) if end in cut and end[0] != joint.by), None)
        if cut_end is None:
            remaining.append(joint)
            continue
        other = joint.b if joint.a == cut_end else joint.a
        for before, via in neighbours[cut_end][:1]:
            if via.by == joint.by:
                stack.append(SignalJoint(before, other, joint.by, joint.origin))
        neighbours[cut_end].append((other, joint))
    return remaining


def cut_equations(
    pool: Pool, all_instances: Sequence[Instance], equations: Sequence[FlatEquation], cut: Collection[Signal]
) -> list[FlatEquation]:
    """Equations without those by which an owner drives a cut signal: `yield self.force.u == ...`."""
    if not cut:
        return list(equations)
    owner_of_driven: dict[int, str] = {}
    for number, name in cut:
        owner = all_instances[number].owner
        if owner is not None:
            first = all_instances[number].first[name]
            count = max(1, prod(all_instances[number].component._declarations[name].shape))
            owner_of_driven |= {pool.var(first + k): owner.path for k in range(count)}
    return [
        e
        for e in equations
        if not any(
            owner_of_driven.get(side) == e.component and pool.nodes[side][0] == "var" for side in (e.left, e.right)
        )
    ]


def input_scalars(all_instances: Sequence[Instance], signals: Collection[Signal]) -> tuple[int, ...]:
    """The scalars of these signals, in the order of declaration."""
    with_inputs = {number for number, _ in signals}
    return tuple(
        instance.first[name] + k
        for instance in all_instances
        if instance.number in with_inputs
        for name, d in instance.component._declarations.items()
        if (instance.number, name) in signals
        for k in range(prod(d.shape))
    )
