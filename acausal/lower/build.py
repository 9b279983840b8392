"""Lowering of pool expressions to CasADi SX: each shared node once, equal operations of a level in one call.

A call into CasADi costs 10 to 30 us whatever its size, so the nodes of a large model are lowered as columns: all
subtractions whose operands are available at once, and so on from level to level. Ten thousand equal sections of a
ladder then take a few dozen calls. Where few nodes of a level have the same operation they are lowered one by one.

Variables and modes are the `Symbols` of a model's vectors. An input over time is a Chebyshev polynomial whose
coefficients are modes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca

from acausal.analyse.delays import WIDTH
from acausal.flatten.pool import IMPULSE, LEAVES, Pool
from acausal.language.expressions.delay import Delayed
from acausal.language.expressions.external import Call, External
from acausal.language.expressions.functions import UNARY
from acausal.lower.chebyshev import INPUT_WIDTH, polynomial
from acausal.lower.lowered import Lowered
from acausal.numeric.external import call

BUILD: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "pow": lambda a, b: a**b,
    "min": ca.fmin,
    "max": ca.fmax,
    "atan2": ca.atan2,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "gt": lambda a, b: a > b,
    "ge": lambda a, b: a >= b,
    "and": ca.logic_and,
    "or": ca.logic_or,
    "not": ca.logic_not,
    "where": ca.if_else,
    "noevent": lambda a: a,
    "sample": lambda start, interval: ca.SX(0),  # true at isolated instants only; the run sets its mode there
    "pre": lambda a: a,
    IMPULSE: lambda velocity, value: value - velocity,
    "initial": lambda: ca.SX(0),
    "after_reset": lambda: ca.SX(0),
    "infinitesimal": lambda: ca.SX(0),
    "terminal": lambda: ca.SX(0),
    **{n: getattr(ca, n) for n in UNARY},
}

_LOGIC = frozenset(("where", "and", "or", "not"))
_ONE_BY_ONE = frozenset((*_LOGIC, "homotopy", "sample", "initial", "after_reset", "infinitesimal", "terminal"))

# With at least this many equal operations on a level, a column is cheaper than scalars.
_COLUMN_SIZE = 6


class Builder:
    """Lowers nodes of one pool on demand.

    `assign` gives variables their symbols, `definitions` maps variables to the nodes that they equal, and `done` holds
    the SX of nodes lowered so far, at first those of the modes of relations.
    """

    def __init__(self, pool: Pool, time: Any, parameters: Any, modes: Mapping[int, Any]) -> None:
        self.pool = pool
        self.time = time
        self.parameters = parameters
        self.definitions: dict[int, int] = {}
        self.done: dict[int, Any] = dict(modes)
        self.homotopy: Any = None  # weight of the actual expression in homotopy(...), 0 to 1; None means 1
        self.windows: list[Any] = []  # modes of each delay
        # Nodes that are replaced by another function of their operands.
        self.changes: Mapping[int, Callable[[list[Any]], Any]] = {}
        self.blend = False  # whether `where` is a weighted mean, for conditions between 0 and 1 (sliding modes)
        self._values: Any = ca.SX(0, 1)  # grows by doubling: appending would copy it for each column
        self._filled = 0
        self._external_outputs: dict[tuple[External, tuple[int, ...]], list[Any]] = {}
        self._index: dict[int, int] = {}  # of nodes in `_values`; a node may be in `done`, in `_index`, or in both

    def assign(self, variables: Sequence[int], values: Any) -> None:
        """Let variables be the entries of a column."""
        self._append(self.pool.vars(variables), values)

    def lower(self, roots: Iterable[int]) -> list[Any]:
        """SX scalar of each root. Every variable below it must be assigned or defined, else KeyError."""
        nodes = [self.resolved(r) for r in roots]
        self._lower(nodes)
        return [self._scalar(r) for r in nodes]

    def column(self, roots: Iterable[int]) -> Any:
        """SX column of the roots; otherwise like `lower`."""
        nodes = [self.resolved(r) for r in roots]
        self._lower(nodes)
        return self._gather(nodes) if len(nodes) >= _COLUMN_SIZE else ca.vertcat(ca.SX(0, 1), *map(self._scalar, nodes))

    def resolved(self, number: int) -> int:
        """The node itself, or the definition of a defined variable, followed through chains of definitions."""
        nodes = self.pool.nodes
        while number not in self.done and number not in self._index:
            node = nodes[number]
            if node[0] != "var" or node[1] not in self.definitions:
                break
            number = self.definitions[node[1]]
        return number

    def _lower(self, roots: Sequence[int]) -> None:
        levels, operands = self._levels(roots)
        for (_, op), members in sorted(levels.items()):
            for number in [n for n in members if n in self.changes]:
                self.done[number] = self.changes[number]([self._scalar(c) for c in operands[number]])
                members.remove(number)
            if op in LEAVES:
                self._leaves(op, members)
            elif isinstance(op, Delayed):
                for number in members:
                    self.done[number] = polynomial(self.windows[op.number], self._scalar(operands[number][0]))
            elif isinstance(op, Call):
                for number in members:
                    self.done[number] = self._external(op, tuple(operands[number]))
            elif len(members) < _COLUMN_SIZE or op in _ONE_BY_ONE:
                for number in members:
                    values = [self._scalar(c) for c in operands[number]]
                    self.done[number] = self._operation(op, self._threshold_booleans(op, operands[number], values))
            else:
                columns = zip(*(operands[number] for number in members), strict=True)
                self._append(members, BUILD[op](*[self._gather(c) for c in columns]))

    def _levels(self, roots: Sequence[int]) -> tuple[dict[tuple[int, str], list[int]], dict[int, list[int]]]:
        """Nodes not lowered yet, by (level, operation), and their operands; nodes below a mode are not visited."""
        nodes, done, index, resolved = self.pool.nodes, self.done, self._index, self.resolved
        levels: dict[tuple[int, str], list[int]] = {}
        level: dict[int, int] = {}
        operands: dict[int, list[int]] = {}
        stack = [r for r in roots if r not in done and r not in index]
        while stack:
            number = stack[-1]
            if number in level:
                stack.pop()
                continue
            op, *below = nodes[number]
            node_level = 0
            if op not in LEAVES:
                inner = operands.get(number)
                if inner is None:
                    inner = operands[number] = [c if c in level or c in index else resolved(c) for c in below]
                    missing = [c for c in inner if c not in level and c not in index and c not in done]
                    if missing:
                        stack.extend(missing)
                        continue
                node_level = 1 + max([level.get(c, 0) for c in inner], default=0)
            level[number] = node_level
            levels.setdefault((node_level, op), []).append(number)
            stack.pop()
        return levels, operands

    def _leaves(self, op: str, members: Sequence[int]) -> None:
        nodes = self.pool.nodes
        if op == "time":
            self.done[members[0]] = self.time
        elif op == "const":
            self._append(members, ca.SX(ca.DM([nodes[n][1] for n in members])))
        elif op == "par":
            self._append(members, self.parameters[[nodes[n][1] for n in members]])
        else:
            raise KeyError(f"variable {nodes[members[0]][1]} is neither known nor defined")

    def _operation(self, op: str, operands: Sequence[Any]) -> Any:
        if op == "where" and self.blend:
            c, a, b = operands
            return ca.if_else(c, c * a, 0) + ca.if_else(c - 1, (1 - c) * b, 0)  # a branch of weight 0 may be infinite
        if op != "homotopy":
            return BUILD[op](*operands)
        actual, simplified = operands
        return actual if self.homotopy is None else self.homotopy * actual + (1 - self.homotopy) * simplified

    def _external(self, op: Call, operands: tuple[int, ...]) -> Any:
        """One scalar output of an external function; the function is called once for all its outputs."""
        key = op.external, operands
        if key not in self._external_outputs:
            self._external_outputs[key] = call(op.external, [self._scalar(c) for c in operands])
        return self._external_outputs[key][op.entry]

    def _threshold_booleans(self, op: str, operands: Sequence[int], values: list[Any]) -> list[Any]:
        """Operands, with boolean variables compared with one half.

        To an integrator they are states of rate zero, whose corrections may turn 0 into 1e-20, which is true.
        """
        if op not in _LOGIC:
            return values
        nodes = self.pool.nodes
        conditions = 1 if op == "where" else len(values)
        return [
            v > 0.5 if k < conditions and nodes[n][0] in ("var", "where", "noevent") else v
            for k, (n, v) in enumerate(zip(operands, values, strict=True))
        ]

    def _append(self, members: Sequence[int], values: Any) -> None:
        first, capacity = self._filled, self._values.numel()
        self._filled += len(members)
        if self._filled > capacity:
            self._values = ca.vertcat(self._values, ca.SX.zeros(max(capacity, self._filled - capacity)))
        if members:
            self._values[first : self._filled] = values
        self._index.update(zip(members, range(first, self._filled), strict=True))

    def _scalar(self, number: int) -> Any:
        if number not in self.done:
            self.done[number] = self._values[self._index[number]]
        return self.done[number]

    def _gather(self, members: Sequence[int]) -> Any:
        """Values of lowered nodes as a column."""
        scalars = [n for n in dict.fromkeys(members) if n not in self._index]
        if scalars:
            self._append(scalars, ca.vertcat(*(self.done[n] for n in scalars)))
        return self._values[[self._index[n] for n in members]]


class Symbols:
    """One set of SX symbols for the arguments (t, x, z, u, p, m)."""

    def __init__(self, compiled: Lowered) -> None:
        self.t = ca.SX.sym("t")
        self.x = ca.SX.sym("x", len(compiled.states))
        self.z = ca.SX.sym("z", len(compiled.algebraic))
        self.u = ca.SX.sym("u", len(compiled.inputs))
        self.p = ca.SX.sym("p", len(compiled.parameters))
        self.m = ca.SX.sym("m", compiled.n_modes)

    @property
    def inputs(self) -> list[Any]:
        """The symbols in the order of every function's arguments."""
        return [self.t, self.x, self.z, self.u, self.p, self.m]

    def builder(self, compiled: Lowered) -> DefiningBuilder:
        """A builder with symbols for states, algebraic variables, inputs and modes."""
        solution = compiled.solution
        modes = {n: self.m[k] for k, n in zip(compiled.mode_places, compiled.mode_nodes, strict=True)}
        builder = DefiningBuilder(solution.structure.reduced.pool, self.t, self.p, modes)
        first, delays = compiled.n_timely - compiled.delays.size, range(len(compiled.delays.items))
        builder.windows = [self.m[first + WIDTH * k : first + WIDTH * (k + 1)] for k in delays]
        for symbols, variables in (
            (self.x, compiled.state_variables),
            (self.z, solution.algebraic),
            (self.input_values(compiled), solution.structure.reduced.inputs),
        ):
            builder.assign(variables, symbols)
        return builder

    def defined(self, compiled: Lowered, blend: bool = False) -> DefiningBuilder:
        """Like `builder`, with all definitions; `blend` for modes between 0 and 1."""
        builder = self.builder(compiled)
        builder.blend = blend
        builder.define(compiled.solution.definitions, compiled.rewritten)
        return builder

    def input_values(self, compiled: Lowered) -> Any:
        """Inputs as the equations contain them: entries of u, or polynomials in time for driven ones."""
        u, first = ca.SX(self.u), len(compiled.time_events.relations)
        for k, input_index in enumerate(compiled.driven):
            u[input_index] = polynomial(self.m[first + k * INPUT_WIDTH : first + (k + 1) * INPUT_WIDTH], self.t)
        return u


class DefiningBuilder(Builder):
    """A builder with definitions in which relations and kinks are replaced by branches on modes."""

    def define(self, definitions: Sequence[tuple[int, int]], rewritten: dict[int, int]) -> None:
        """Add definitions; relations and kinks in them are replaced by their modes."""
        self.rewritten = rewritten
        for (variable, _), node in zip(definitions, self.replaced(n for _, n in definitions), strict=True):
            self.definitions[variable] = node

    def replaced(self, nodes: Iterable[int]) -> list[int]:
        """Nodes with the relations and kinks in them replaced by branches on modes."""
        nodes = list(nodes)
        if not self.rewritten:
            return nodes
        done = self._replaced
        self.pool.rewrite(nodes, self.pool.var, done)
        return [done[n] for n in nodes]

    @cached_property
    def _replaced(self) -> dict[int, int]:
        return dict(self.rewritten)
