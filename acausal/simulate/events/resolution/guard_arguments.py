"""What guards make of smooth states: phases of sines and arguments of steep functions, in which guards come and go.

Steps and mesh points resolve states, and what rates depend on. A guard may depend on more: on a sine that no rate
contains, or on the profile of a road, which acts on a wheel only where they touch. Until then no rate shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from acausal.arrays import Truth
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.events.resolution.enclosures import Enclosure
from acausal.simulate.events.resolution.guard_graph import GuardGraph
from acausal.simulate.events.resolution.windings import (
    FACTOR,
    WINDING,
    sampled_operations,
    unsampled,
    windings,
)

_PERIODIC = frozenset(("sin", "cos", "tan"))
# Which operand of a steep function is its argument; of a power it may also be the exponent.
_ARGUMENT = {"exp": 0, "tanh": 0, "atan": 0, "cosh": 0, "sinh": 0, "log": 0, "div": 1, "pow": 0}
# Parabolas show powers below this one, and the least magnitude of which a logarithm is taken.
_LOW_POWER, _LEAST = 8.0, 1e-300


@dataclass(frozen=True, eq=False)
class Arguments:
    """Arguments in the guards of a model: phases, those of steep functions, and relations of a high degree.

    `function`, `column`: (t, x, z, u, p, m) -> arguments, shape (n,).
    `exponents`: (t, x, z, u, p, m) -> exponents of powers that parabolas do not show, one for other functions; (n,).
    `operations`: For each its function: that of a phase [rad], or the name of a steep function.
    `effective`, `resolved`: For each whether rates depend on it as some, or any, relations hold.
    """

    function: NarrowFunction
    column: Any
    exponents: NarrowFunction
    operations: tuple[str, ...]
    effective: tuple[bool, ...]
    resolved: tuple[bool, ...]
    windings: Enclosure | None
    """Of the arguments of `WINDING`; None if there are none."""
    wound: tuple[int, ...]
    """The number of the relation of each of these."""
    unsampled: tuple[int, ...]
    """The numbers of those relations with more factors than are sampled."""

    @cached_property
    def is_phase(self) -> Truth:
        """Which are phases; shape (n,)."""
        return np.array([op in _PERIODIC for op in self.operations])

    @cached_property
    def is_winding(self) -> Truth:
        """Which are relations of a high degree, or factors of them; shape (n,)."""
        return np.array([op in (WINDING, FACTOR) for op in self.operations])

    @cached_property
    def is_wound(self) -> Truth:
        """Which are relations of a high degree; shape (n,)."""
        return np.array([op == WINDING for op in self.operations])

    @cached_property
    def is_steep(self) -> Truth:
        """Which are arguments of steep functions; shape (n,)."""
        return np.asarray(~self.is_phase & ~self.is_winding)

    @cached_property
    def is_unresolved(self) -> Truth:
        """Which of these need not be resolved, because rates do not depend on them as some relations hold; (n,)."""
        return np.asarray(self.is_steep & ~np.array(self.resolved))


_MADE: WeakKeyDictionary[CompiledModel, Arguments | None] = WeakKeyDictionary()


def guard_arguments(compiled: CompiledModel) -> Arguments | None:
    """The phases and steep arguments of the guards of a model; None if there are none that vary."""
    if compiled not in _MADE:
        _MADE[compiled] = _made(compiled)
    return _MADE[compiled]


def _made(compiled: CompiledModel) -> Arguments | None:
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    graph = GuardGraph(compiled, builder.pool)
    wound = windings(graph)
    found: dict[tuple[str, tuple[int, ...]], tuple[bool, bool]]
    found = {key: (False, False) for key in sampled_operations(graph, wound)}
    for n in sorted(graph.guarded & graph.moving):
        for sampled in _sampled(graph, n):
            is_effective, is_resolved = found.get(sampled, (True, True))
            found[sampled] = is_effective and n in graph.effective, is_resolved and n in graph.resolved
    if not found:
        return None
    nodes = sorted({n for _, operands in found for n in operands})
    values = dict(zip(nodes, ca.vertsplit(ca.densify(builder.column(builder.replaced(nodes)))), strict=True))
    columns = zip(*(_argument(op, [values[n] for n in operands]) for op, operands in found), strict=True)
    column, exponents = (ca.vertcat(*c) for c in columns)
    operations = tuple("exp" if op == "power" else op for op, _ in found)
    winding = [k for k, op in enumerate(operations) if op == WINDING]
    effective_ones, resolved_ones = zip(*found.values(), strict=True)
    return Arguments(
        NarrowFunction("phases", symbols.inputs, column),
        ca.Function("phases", symbols.inputs, [column]),
        NarrowFunction("exponents", symbols.inputs, exponents),
        operations,
        effective_ones,
        resolved_ones,
        Enclosure(ca.Function("windings", symbols.inputs, [column[winding]])) if winding else None,
        tuple(map(compiled.state_events.relations.index, wound)),
        tuple(map(compiled.state_events.relations.index, sorted(unsampled(wound)))),
    )


def _sampled(graph: GuardGraph, n: int) -> list[tuple[str, tuple[int, ...]]]:
    """The function of a node and operands of its arguments; none if it changes no faster than its argument moves."""
    op, *operands = graph.pool.nodes[n]
    if op not in _ARGUMENT and op not in _PERIODIC:
        return []
    if op == "pow" and operands[1] in graph.moving:
        return [("power", tuple(operands))]
    argument = operands[_ARGUMENT.get(op, 0)]
    if argument not in graph.moving:
        return []
    if op in _PERIODIC:
        return [(op, (argument,))]
    exponent = operands[1:] if op == "pow" else []
    node = graph.pool.nodes[exponent[0]] if exponent else ("", 0.0)
    if node[0] == "const" and 0.0 <= node[1] < _LOW_POWER:
        return []
    return [(op, (k, *exponent)) for k in _beneath_extremes(graph, argument) if k in graph.moving]


def _beneath_extremes(graph: GuardGraph, argument: int) -> list[int]:
    """An argument, or the operands of `minimum` and `maximum` in it, which hide where it turns.

    The compiler bounds exponents, too (`acausal.analyse.events.state_events`): between mesh points on both sides of a
    pulse, `maximum(-v**2, -300)` is constant.
    """
    found, pending, seen = list[int](), [argument], set[int]()
    while pending:
        here = pending.pop()
        if here in seen:
            continue
        seen.add(here)
        inner = graph.operands(here) if graph.pool.nodes[here][0] in ("min", "max", "var") else []
        pending += inner
        if not inner:
            found.append(here)
    return found


def _argument(op: str, operands: Sequence[Any]) -> tuple[Any, Any]:
    """The argument of a function, and the exponent of a power that parabolas do not show, or one."""
    if op == WINDING:
        return operands[1] - operands[2], ca.SX(1)
    if op == "power":
        return operands[1] * ca.log(ca.fmax(ca.fabs(operands[0]), _LEAST)), ca.SX(1)
    if op == "pow":  # the exponent may be a parameter
        is_low = ca.logic_and(operands[1] >= 0.0, operands[1] < _LOW_POWER)
        return operands[0], ca.if_else(is_low, 0.0, ca.fabs(operands[1]))
    return operands[0], ca.SX(1)
