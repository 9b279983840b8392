"""Expressions of the same shape: equal equations of a thousand components as operations on columns.

The shape of a node is its operation and the shapes of its operands; leaves are represented by their kind only: states,
algebraic variables, modes, time, and values that do not change during a run. Nodes of one shape at one depth form a
column, each operand of which consists of entries of one other column: the expressions of 10 000 equal sections of a
ladder are five columns. Nodes of rare shapes are left to scalar code, in stages between those of the columns.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from acausal.flatten.pool import LEAVES, Pool

FEW = 32
"""With fewer nodes of one shape a column does not pay: an operation on columns costs as much as 20 scalar ones."""

CONSTANT = "c"
"""Kind of leaves that do not change during a run: expressions of parameters, inputs and numbers."""

_COMMUTATIVE = frozenset(("add", "mul", "min", "max", "and", "or"))
_SCALAR_ONLY = frozenset(("homotopy", "sample", "pre", "initial", "after_reset", "infinitesimal", "terminal"))
_LOGIC = frozenset(("where", "and", "or", "not"))
Leaf = tuple[str, int]


@dataclass(frozen=True, eq=False)
class Column:
    """Nodes of one shape.

    `operands` has one list of nodes, as long as `members`, for each operand of `op`. `booleans` are the indices of
    operands that are boolean variables, which are compared with one half.
    """

    op: str
    members: list[int]
    operands: list[list[int]]
    booleans: frozenset[int]


@dataclass(frozen=True, eq=False)
class Stage:
    """Nodes of rare shapes, one by one, and those of their operands that are not among them; then columns."""

    few: list[Column]
    needed: list[int]
    columns: list[Column]


@dataclass(frozen=True, eq=False)
class Patterns:
    """A program that evaluates some roots."""

    roots: list[int]  # the nodes that represent the roots
    # Kind and index of every leaf that is used; `constants` are those of the kind `CONSTANT` in order.
    leaves: dict[int, Leaf]
    constants: list[int]
    numbers: dict[int, float]  # numbers that are operands so often that they are part of a shape
    stages: list[Stage]  # in the order of evaluation
    divided: bool  # whether there is a division by zero

    @property
    def scalars(self) -> int:
        """Number of nodes that are in no column."""
        return sum(len(stage.few) for stage in self.stages)

    @property
    def lengths(self) -> list[int]:
        """Length of every column."""
        return [len(column.members) for stage in self.stages for column in stage.columns]


def patterns(
    pool: Pool,
    roots: Sequence[int],
    resolved: Callable[[int], int],
    varying: Mapping[int, Leaf],
    fixed: frozenset[int] = frozenset(),
    zeros: Container[int] = (),
) -> Patterns:
    """The columns and stages of some roots.

    Parameters
    ----------
    resolved
        Returns the node that represents a node: for a defined variable its definition.
    varying
        Kind and index of each leaf that changes during a run.
    fixed
        Leaves that do not change, besides parameters and numbers.
    zeros
        Parameters that are zero: products with them are left out.
    """
    return _Search(pool, resolved, dict(varying), fixed, zeros).found([resolved(r) for r in roots])


class _Search:
    def __init__(
        self,
        pool: Pool,
        resolved: Callable[[int], int],
        varying: dict[int, Leaf],
        fixed: frozenset[int],
        zeros: Container[int],
    ) -> None:
        self.nodes = pool.nodes
        self.zero = pool.zero
        self.zeros = zeros
        self.replacement = {pool.zero: pool.zero}  # node -> the node that it equals because an operand is zero
        self.negated: set[int] = set()  # differences `0 - x`
        self.divided = False
        self.moving: set[int] = set()  # nodes that change during a run, even where zeros make them constant
        self.resolved = resolved
        self.varying = varying
        self.fixed = fixed
        self.operands: dict[int, list[int]] = {}
        self.depth = {pool.zero: -1}  # 0 for leaves, -1 for nodes that do not change or are replaced
        self.shape: dict[int, int] = {}
        self.shapes: dict[Any, int] = {}
        self.stage: dict[int, int] = {}  # even: few; odd: columns

    def found(self, roots: list[int]) -> Patterns:
        self._measure(roots)
        roots = [self.replacement.get(r, r) for r in roots]
        uses: dict[int, int] = {}
        for number, below in self.operands.items():
            if self.depth[number] > 0:
                for c in below:
                    if self.depth[c] < 0:
                        uses[c] = uses.get(c, 0) + 1
        # Exponents become numbers: with a variable exponent, powers of negative numbers have no derivative.
        exponents = {below[1] for n, below in self.operands.items() if self.nodes[n][0] == "pow" and len(below) == 2}
        numbers = {
            c: self.nodes[c][1] for c, k in uses.items() if (k >= FEW or c in exponents) and self.nodes[c][0] == "const"
        }
        for r in roots:
            numbers.pop(r, None)
        constants = [c for c in uses if c not in numbers]
        constants += dict.fromkeys(r for r in roots if self.depth[r] < 0 and r not in uses)
        leaves = {n: self.varying[n] for n, d in self.depth.items() if d == 0}
        leaves.update((n, (CONSTANT, k)) for k, n in enumerate(constants))
        self.shape.update((n, self._shape(kind)) for n, (kind, _) in leaves.items())
        self.shape.update((n, self._shape(("number", value))) for n, value in numbers.items())
        stages = self._stages(leaves, numbers)
        return Patterns(roots, leaves, constants, numbers, stages, self.divided)

    def _measure(self, roots: list[int]) -> None:
        """Determine the operands and the depth of everything below the roots."""
        nodes, depth, operands = self.nodes, self.depth, self.operands
        stack = list(roots)
        while stack:
            number = stack[-1]
            if number in depth:
                stack.pop()
                continue
            op, *below = nodes[number]
            if number in self.varying or number in self.fixed or op in LEAVES:
                self._leaf(number, op, below)
                stack.pop()
                continue
            if number not in operands:
                operands[number] = [self.resolved(c) for c in below]
                missing = [c for c in operands[number] if c not in depth]
                if missing:
                    stack.extend(missing)
                    continue
            if op in _SCALAR_ONLY or not self.moving.isdisjoint(operands[number]):
                self.moving.add(number)
            if self._vanishes(number, op) or number not in self.moving:
                depth[number] = -1
            else:
                depth[number] = 1 + max((depth[c] for c in operands[number] if depth[c] > 0), default=0)
            stack.pop()

    def _leaf(self, number: int, op: str, below: list[int]) -> None:
        if number in self.varying:
            self.depth[number] = 0
            self.moving.add(number)
            return
        if op in ("var", "time") and number not in self.fixed:
            raise KeyError(f"{op} {below} is neither known nor defined")
        self.depth[number] = -1
        if (op == "par" and below[0] in self.zeros) or (op == "const" and below[0] == 0.0):
            self.replacement[number] = self.zero

    def _vanishes(self, number: int, op: str) -> bool:
        """Whether this node equals another one because an operand is zero, which is noted as its replacement."""
        below = self.operands[number]
        if self.replacement:
            below = self.operands[number] = [self.replacement.get(c, c) for c in below]
        if self.zero not in below:
            return False
        is_zero = [c == self.zero for c in below]
        self.divided = self.divided or (op == "div" and is_zero[1])
        if op in ("mul", "neg") or (op == "div" and not is_zero[1]) or (op in ("add", "sub") and all(is_zero)):
            self.replacement[number] = self.zero
        elif op == "add":
            self.replacement[number] = below[0] if is_zero[1] else below[1]
        elif op == "sub" and is_zero[1]:
            self.replacement[number] = below[0]
        elif op == "sub":
            self.negated.add(number)
            self.operands[number] = [below[1]]
            return False
        return number in self.replacement

    def _stages(self, leaves: Mapping[int, Leaf], numbers: Mapping[int, float]) -> list[Stage]:
        levels: dict[int, list[int]] = {}
        for number, d in self.depth.items():
            if d > 0:
                levels.setdefault(d, []).append(number)
        few: dict[int, list[Column]] = {}
        columns: dict[int, list[Column]] = {}
        for d in sorted(levels):
            groups: dict[Any, list[int]] = {}
            for number in levels[d]:
                groups.setdefault(self._key(number), []).append(number)
            for key, members in groups.items():
                op = key[0]
                if len(members) < FEW or op in _SCALAR_ONLY or type(op) is not str:
                    for number in members:
                        stage_index = self._after(self.operands[number], odd=0)
                        self.stage[number] = stage_index
                        self.shape[number] = self._shape(("few", stage_index))
                        below = [[c] for c in self.operands[number]]
                        few.setdefault(stage_index, []).append(Column(op, [number], below, key[1]))
                else:
                    stage_index = self._after(self.operands[members[0]], odd=1)
                    shape = self._shape(("column", d, key))
                    for number in members:
                        self.stage[number] = stage_index
                        self.shape[number] = shape
                    below = [list(c) for c in zip(*(self.operands[number] for number in members), strict=True)]
                    columns.setdefault(stage_index, []).append(Column(op, members, below, key[1]))
        last = max((*few, *columns), default=-1)
        return [
            Stage(few.get(k, []), self._outside(few.get(k, []), numbers), columns.get(k + 1, []))
            for k in range(0, last + 1, 2)
        ]

    def _key(self, number: int) -> Any:
        """Operation, indices of boolean operands, shapes of operands; those of commutative operations are sorted."""
        op = self.nodes[number][0] if number not in self.negated else "neg"
        below = self.operands[number]
        shape = self.shape
        if op in _COMMUTATIVE and len(below) == 2 and shape[below[0]] > shape[below[1]]:
            below = self.operands[number] = [below[1], below[0]]
        booleans: frozenset[int] = frozenset()
        if op in _LOGIC:
            conditions = 1 if op == "where" else len(below)
            booleans = frozenset(k for k in range(conditions) if self.nodes[below[k]][0] in ("var", "where", "noevent"))
        return (op, booleans, *(shape[c] for c in below))

    def _shape(self, key: Any) -> int:
        return self.shapes.setdefault(key, len(self.shapes))

    def _after(self, operands: Sequence[int], odd: int) -> int:
        """The first even, or odd, stage at which all operands are available."""
        ready = max((self.stage.get(c, -1) for c in operands), default=-1)
        return ready if ready >= 0 and ready % 2 == odd else ready + 1 if (ready + 1) % 2 == odd else ready + 2

    def _outside(self, few: Sequence[Column], numbers: Mapping[int, float]) -> list[int]:
        few_members = {column.members[0] for column in few}
        outside_operands = (
            c for column in few for (c,) in column.operands if c not in few_members and c not in numbers
        )
        return list(dict.fromkeys(outside_operands))
