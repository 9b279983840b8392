"""Numbers for scalars: connected potentials are one variable, everything else has its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

from acausal.flatten.connections.connections import Joint, SignalJoint, UnionFind
from acausal.flatten.flat import FlatVariable
from acausal.flatten.instances.instances import Instance
from acausal.flatten.pool import Pool
from acausal.language.component import Component, Connector
from acausal.language.declarations.declaration import Declaration, Kind

_UNKNOWNS = (Kind.VARIABLE, Kind.FLOW, Kind.INPUT, Kind.OUTPUT)


Layout = tuple[tuple[str, Declaration, int], ...]
"""Declared unknowns with their number of scalars, in order."""


def _layout(owner: Any) -> Layout:
    return tuple((n, d, math.prod(d.shape)) for n, d in owner._declarations.items() if d.kind in _UNKNOWNS)


_layout_of: Callable[..., Layout] = cache(_layout)


def layout(component: Component) -> Layout:
    """Of a class, or of a component whose shapes follow from its structural values."""
    return _layout(component) if "_declarations" in component.__dict__ else _layout_of(type(component))


def allocate(
    pool: Pool,
    all_instances: Sequence[Instance],
    physical: Sequence[Joint],
    signals: Sequence[SignalJoint],
    cut: frozenset[int],
) -> list[FlatVariable]:
    """Give every declared unknown its scalars; fills `Instance.first`."""
    plain = UnionFind(len(all_instances))
    oriented = UnionFind(len(all_instances))
    for k, joint in enumerate(physical):
        plain.union(joint.a, joint.b)
        if k not in cut:
            oriented.union(joint.a, joint.b)
    shared_signals = _signal_representatives(signals)
    variables: list[FlatVariable] = []
    flat_variable = partial(tuple.__new__, FlatVariable)  # a third of the time of its constructor
    for instance in all_instances:
        own = layout(instance.component)
        if not own:
            continue
        first = instance.first
        number = instance.number
        prefix = instance.prefix
        is_connector = isinstance(instance.component, Connector)
        for name, declaration, size in own:
            if is_connector and declaration.kind is Kind.VARIABLE:
                sets = oriented if declaration.overconstrained else plain
                source = all_instances[sets.find(number)]
                start = source.first[name] if source is not instance else pool.new_variables(size)
            elif (number, name) in shared_signals:
                other, other_name = shared_signals[number, name]
                same = all_instances[other].first
                start = same[other_name] if other_name in same else pool.new_variables(size)
                same.setdefault(other_name, start)
            else:
                start = pool.new_variables(size)
            first[name] = start
            variables.append(flat_variable((prefix + name, declaration, start, size)))
    return variables


def _signal_representatives(signals: Sequence[SignalJoint]) -> dict[tuple[int, str], tuple[int, str]]:
    index: dict[tuple[int, str], int] = {}
    for joint in signals:
        index.setdefault(joint.a, len(index))
        index.setdefault(joint.b, len(index))
    ends = list(index)
    sets = UnionFind(len(ends))
    for joint in signals:
        sets.union(index[joint.a], index[joint.b])
    return {end: ends[sets.find(k)] for end, k in index.items()}
