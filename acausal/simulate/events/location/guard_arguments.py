"""What guards make of smooth states: phases of sines and arguments of steep functions, in which guards come and go.

Steps and mesh points resolve states, and what rates depend on. A guard may depend on more: on a sine that no rate
contains, or on the profile of a road, which acts on a wheel only where they touch. Until then no rate shows it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from acausal.analyse.events.state_events import discrete_variables
from acausal.arrays import Truth
from acausal.flatten.pool import LEAVES, Pool, closure
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.events.location.enclosures import Enclosure

_PERIODIC = frozenset(("sin", "cos", "tan"))
# Which operand of a steep function is its argument; of a power it may also be the exponent.
_ARGUMENT = {"exp": 0, "tanh": 0, "atan": 0, "cosh": 0, "sinh": 0, "log": 0, "div": 1, "pow": 0}
_CHOICES, _PRODUCTS = frozenset(("where", "min", "max")), frozenset(("mul", "div"))
# Parabolas show powers below this one, and the least magnitude of which a logarithm is taken.
_LOW_POWER, _LEAST = 8.0, 1e-300
# The degree up to which polynomials show relations, and the most factors of one whose zeros are sampled.
_MOST_DEGREE, _MOST_FACTORS = 3, 16
WINDING, FACTOR = "winding", "factor"
"""Operations of a relation of a high degree, whose argument is the difference of its sides, and of a factor in it."""


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

    @cached_property
    def is_phase(self) -> Truth:
        """Which are phases; shape (n,)."""
        return np.array([op in _PERIODIC for op in self.operations])

    @cached_property
    def is_winding(self) -> Truth:
        """Which are relations of a high degree, or factors of them; shape (n,)."""
        return np.array([op in (WINDING, FACTOR) for op in self.operations])

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
    pool, relations = builder.pool, set(compiled.state_events.relations)
    definitions = _definitions(compiled)
    roots = [*compiled.solution.structure.rates(compiled.state_variables), *compiled.solution.residuals]
    # what rates depend on, whatever holds, is resolved by the error control of the solver
    effective = _behind(pool, definitions, roots, relations)
    resolved = _behind(pool, definitions, roots, relations | _intermittent(pool, definitions, roots))
    guarded = _behind(pool, definitions, relations, set())
    discretes = set(pool.vars(discrete_variables(compiled.solution.structure.reduced)))
    moving = _moving(pool, definitions, guarded, relations | discretes)
    found: dict[tuple[str, tuple[int, ...]], tuple[bool, bool]] = {}
    for key in _winding(pool, definitions, relations, guarded & (moving | relations), effective):
        found[key] = False, False
    for n in sorted(guarded & moving):
        op, *operands = pool.nodes[n]
        if op not in _PERIODIC and op not in _ARGUMENT:
            continue
        for sampled in _sampled(pool, definitions, op, operands, moving):
            is_effective, is_resolved = found.get(sampled, (True, True))
            found[sampled] = is_effective and n in effective, is_resolved and n in resolved
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
    )


def _sampled(
    pool: Pool, definitions: Mapping[int, int], op: str, operands: Sequence[int], moving: set[int]
) -> list[tuple[str, tuple[int, ...]]]:
    """The function and the operands of its arguments; none if it comes and goes no faster than its argument moves."""
    if op == "pow" and operands[1] in moving:
        return [("power", tuple(operands))]
    n = operands[_ARGUMENT.get(op, 0)]
    if n not in moving:
        return []
    if op in _PERIODIC:
        return [(op, (n,))]
    exponent = operands[1:] if op == "pow" else []
    node = pool.nodes[exponent[0]] if exponent else ("", 0.0)
    if node[0] == "const" and 0.0 <= node[1] < _LOW_POWER:
        return []
    return [(op, (k, *exponent)) for k in _beneath_extremes(pool, definitions, n) if k in moving]


def _beneath_extremes(pool: Pool, definitions: Mapping[int, int], argument: int) -> list[int]:
    """An argument, or the operands of `minimum` and `maximum` in it, which hide where it turns.

    The compiler bounds exponents, too (`acausal.analyse.events.underflow`): between mesh points on both sides of a
    pulse, `maximum(-v**2, -300)` is constant.
    """
    found, pending, seen = list[int](), [argument], set[int]()
    while pending:
        here = pending.pop()
        if here in seen:
            continue
        seen.add(here)
        op = pool.nodes[here][0]
        inner = _operands(pool, definitions, here) if op in ("min", "max", "var") else []
        pending += inner
        if not inner:
            found.append(here)
    return found


def _argument(op: str, operands: Sequence[Any]) -> tuple[Any, Any]:
    """The argument of a function, and the exponent of a power that parabolas do not show, or one."""
    if op == WINDING:
        return operands[0] - operands[1], ca.SX(1)
    if op == "power":
        return operands[1] * ca.log(ca.fmax(ca.fabs(operands[0]), _LEAST)), ca.SX(1)
    if op == "pow":  # the exponent may be a parameter
        is_low = ca.logic_and(operands[1] >= 0.0, operands[1] < _LOW_POWER)
        return operands[0], ca.if_else(is_low, 0.0, ca.fabs(operands[1]))
    return operands[0], ca.SX(1)


def _winding(
    pool: Pool, definitions: Mapping[int, int], relations: set[int], nodes: Collection[int], effective: set[int]
) -> list[tuple[str, tuple[int, ...]]]:
    """Relations that may come and go between points at which they look smooth, and the factors that decide where.

    The cubics of compiled loops and the parabolas of a search show polynomials up to the third degree. A kink counts as
    a square. Those of higher degree have all of their zeros where one of their factors is small.
    """
    degrees, factors = dict[int, int](), dict[int, set[int]]()
    found: dict[tuple[str, tuple[int, ...]], None] = {}
    for n in _in_order(pool, definitions, nodes):
        op, *operands = pool.nodes[n]
        inner = _operands(pool, definitions, n)
        of, within = [degrees.get(k, 0) for k in inner], set[int]().union(*(factors.get(k, ()) for k in inner))
        if n in relations:
            if sum(of) and max(of) > _MOST_DEGREE:
                found[WINDING, (operands[0], operands[1])] = None
                found |= {(FACTOR, (k,)): None for k in within if len(within) <= _MOST_FACTORS}
            continue
        if n in effective or not inner or op in _PERIODIC:
            degrees[n] = 1
            continue
        exponent = pool.nodes[operands[1]] if op == "pow" else ("", 1.0)
        power = float(exponent[1]) if exponent[0] in ("", "const") else 1.0
        degrees[n] = {
            "mul": sum(of),
            "div": sum(of) + of[-1],
            "pow": math.ceil(abs(power) * of[0]),
            "fabs": 2 * of[0],
            "min": 2 * max(of),
            "max": 2 * max(of),
        }.get(op, max(of))
        is_product = op == "mul" and all(of)
        own = [k for k in inner if degrees.get(k)] if is_product or op in ("fabs", "pow") else []
        factors[n] = within | set(own)
    return list(found)


def _in_order(pool: Pool, definitions: Mapping[int, int], nodes: Collection[int]) -> list[int]:
    """Nodes, each after those on which it depends, also through definitions."""
    order, done = dict[int, None](), set[int]()
    for n in [*definitions.values(), *sorted(nodes)]:
        fresh = pool.reachable([n], done)
        done.update(fresh)
        order |= dict.fromkeys(k for k in fresh if k in nodes)
    return list(order)


def _definitions(compiled: CompiledModel) -> dict[int, int]:
    """Nodes on which variables depend: definitions, or residuals instead of Newton iterations for them."""
    residuals = {m.variable: m.residual for m in compiled.solution.monotone}
    return dict(compiled.solution.definitions) | residuals


def _behind(pool: Pool, definitions: Mapping[int, int], roots: Iterable[int], barriers: set[int]) -> set[int]:
    """Nodes on which these roots depend, through definitions, but not through `barriers`."""
    pending, seen = list(roots), set[int]()
    while pending:
        fresh = set(pool.reachable(pending, barriers)) - seen
        seen |= fresh
        variables = (pool.nodes[n][1] for n in fresh if pool.nodes[n][0] == "var")
        behind = {definitions[v] for v in variables if v in definitions}
        pending = list(behind - seen - barriers)
    return seen


def _moving(pool: Pool, definitions: Mapping[int, int], nodes: Iterable[int], constants: set[int]) -> set[int]:
    """Those of some nodes that vary between events; `constants` are relations, and discrete variables."""
    start, above = list[int](), dict[int, list[int]]()
    for n in nodes:
        op, *operands = pool.nodes[n]
        if n in constants:
            continue
        if op == "time" or (op == "var" and operands[0] not in definitions):
            start.append(n)
        for k in _operands(pool, definitions, n):
            above.setdefault(k, []).append(n)
    return closure(start, lambda n: above.get(n, ()))


def _intermittent(pool: Pool, definitions: Mapping[int, int], roots: Iterable[int]) -> set[int]:
    """Choices, and products with a choice as a factor: what they depend on may have no effect for a long time.

    A profile acts on a wheel only where they touch. Until then no rate shows it, and no step resolves it.
    """
    found, switching, done = set[int](), set[int](), set[int]()
    for root in [*definitions.values(), *roots]:
        for n in pool.reachable([root], done):
            done.add(n)
            op, switches = pool.nodes[n][0], not switching.isdisjoint(_operands(pool, definitions, n))
            if op in _CHOICES or (op in _PRODUCTS and switches):
                found.add(n)
            if op in _CHOICES or switches:
                switching.add(n)
    return found


def _operands(pool: Pool, definitions: Mapping[int, int], n: int) -> Sequence[int]:
    """The operands of a node, or the node that defines a variable."""
    op, *operands = pool.nodes[n]
    if op not in LEAVES:
        return operands
    return [definitions[operands[0]]] if op == "var" and operands[0] in definitions else []
