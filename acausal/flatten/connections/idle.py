"""Components through which nothing flows because one of their connectors is open: a damper attached at one end only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import prod

from acausal.flatten.connections.connections import FlowSet
from acausal.flatten.flat import FlatEquation
from acausal.flatten.instances.instances import Instance
from acausal.flatten.pool import Pool
from acausal.language.component import Connector
from acausal.language.declarations.declaration import Kind


def idle_components(
    pool: Pool, all_instances: Sequence[Instance], sets: Sequence[FlowSet], equations: Iterable[FlatEquation]
) -> tuple[str, ...]:
    """Notes on components whose flows all vanish by their own equations because one of several connectors is open.

    An open connector is no error: nothing pulls at the free end of a shaft. But such a component has no effect on the
    model, which suggests that a connection was forgotten. Sensors are exempt, because their equations set the flows to
    zero anyway.
    """
    unconnected = {s.members[0][0] for s in sets if len(s.members) == 1}
    candidates = {}
    for instance in {all_instances[k].owner.number: all_instances[k].owner for k in unconnected}.values():  # type: ignore[union-attr]
        connectors = [p for p in instance.parts if isinstance(p.component, Connector)] if instance is not None else []
        if instance is not None and instance.is_leaf and any(p.number not in unconnected for p in connectors):
            candidates[instance.path] = connectors
    equations_of: dict[str, list[FlatEquation]] = {path: [] for path in candidates}
    for e in equations if candidates else ():
        if e.component in equations_of and not isinstance(e.source, str):  # texts belong to junctions
            equations_of[e.component].append(e)
    notes = []
    for path, connectors in candidates.items():
        flows = {v for p in connectors for v in _flows(p)}
        if flows - _zeros(pool, equations_of[path], set()):
            ends = [p for p in connectors if p.number in unconnected]
            if flows <= _zeros(pool, equations_of[path], {v for p in ends for v in _flows(p)}):
                named = " and ".join(p.path for p in ends) + (" is" if len(ends) == 1 else " are")
                notes.append(f"{named} connected to nothing: nothing flows through {path}, as if it were not there")
    return tuple(notes)


def _flows(connector: Instance) -> Iterator[int]:
    for name, d in connector.component._declarations.items():
        if d.kind is Kind.FLOW:
            yield from range(connector.first[name], connector.first[name] + prod(d.shape))


def _zeros(pool: Pool, equations: Sequence[FlatEquation], zeros: set[int]) -> set[int]:
    """Variables that are zero if `zeros` are, according to equations in which all terms but one vanish."""
    zero = set(zeros)
    while True:
        before = len(zero)
        for e in equations:
            remaining = [t for t in (*_terms(pool, e.left), *_terms(pool, e.right)) if not _vanishes(pool, t, zero)]
            variable = _single_variable(pool, remaining[0]) if len(remaining) == 1 else None
            if variable is not None:
                zero.add(variable)
        if len(zero) == before:
            return zero


def _terms(pool: Pool, node: int) -> Iterator[int]:
    """Terms of a sum, without their signs."""
    stack = [node]
    while stack:
        here = stack.pop()
        op, *operands = pool.nodes[here]
        if op in ("add", "sub", "neg"):
            stack.extend(operands)
        else:
            yield here


def _vanishes(pool: Pool, node: int, zeros: set[int]) -> bool:
    """Whether a term is zero because one of its factors is."""
    op, *operands = pool.nodes[node]
    if op == "var":
        return operands[0] in zeros
    if op in ("mul", "div"):
        return any(_vanishes(pool, f, zeros) for f in (operands if op == "mul" else operands[:1]))
    if op in ("add", "sub", "neg"):
        return all(_vanishes(pool, t, zeros) for t in operands)
    return pool.value(node) == 0.0


def _single_variable(pool: Pool, term: int) -> int | None:
    """The variable of a term that is just this variable times constants; None for other terms."""
    op, *operands = pool.nodes[term]
    if op == "var":
        return int(operands[0])
    if op in ("mul", "div"):
        varying = [f for f in operands if pool.variables_in(f)]
        if len(varying) == 1 and (op == "mul" or varying[0] == operands[0]):
            return _single_variable(pool, varying[0])
    return None
