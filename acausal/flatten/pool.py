"""Hash-consed scalar expressions as integers.

A node is a tuple `(op, operand, ...)`; its number is its index in `Pool.nodes`. Operands have smaller numbers than the
node, so ascending order is an evaluation order, and no traversal needs recursion. Equal expressions have the same
number, so shared sub-expressions are lowered once.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from itertools import compress
from typing import Any

from acausal.language.expressions.delay import Delayed
from acausal.language.expressions.external import Call

Node = tuple[Any, ...]

_UNARY: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "fabs": abs,
    "sign": lambda x: float((x > 0) - (x < 0)),
    "floor": lambda x: float(math.floor(x)),
    "ceil": lambda x: float(math.ceil(x)),
    "not": lambda x: float(not x),
    "noevent": lambda x: x,
}
_BINARY: dict[str, Callable[[float, float], float]] = {
    "pow": math.pow,
    "atan2": math.atan2,
    "homotopy": lambda a, s: a,
    "min": min,
    "max": max,
    "lt": lambda a, b: float(a < b),
    "le": lambda a, b: float(a <= b),
    "gt": lambda a, b: float(a > b),
    "ge": lambda a, b: float(a >= b),
    "and": lambda a, b: float(bool(a) and bool(b)),
    "or": lambda a, b: float(bool(a) or bool(b)),
}
LEAVES = frozenset(("const", "var", "par", "time"))
RELATIONS = frozenset(("lt", "le", "gt", "ge"))
_VARYING = frozenset(("var", "time", "sample", "pre", "initial", "after_reset", "infinitesimal", "terminal"))
IMPULSE = "impulse"
"""Operation of (velocity, its value after an impact): the value that a `when` assigns to the impulsive force."""
_UNEVALUATED = frozenset(("sample", "pre", "initial", "after_reset", "infinitesimal", "terminal", IMPULSE))
"""Operations whose values are known only in a run."""
_SUMS = frozenset(("add", "sub", "neg", "mul"))  # a product with a constant is a term with a factor
_MOST_CACHED = 32  # the variables of a node are cached if there are no more than this
_MOST_WITHOUT_SET = 50  # number of nodes visited before a traversal marks visited nodes
_DENSE = 16  # roots are many if there is more than one per this number of nodes


class Pool:
    """An append-only table of scalar expressions over numbered variables, parameters and time.

    Variables are numbered from 0; `derivative(i)` is the number of the time derivative of variable i, created on first
    use. `slope` maps a variable to the node of its derivative where the modeller gave a rule for it.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._number: dict[Node, int] = {}
        self.n_variables = 0
        self.derivative_of: dict[int, int] = {}
        self.integral_of: dict[int, int] = {}
        self.slope: dict[int, int] = {}
        self.delays: list[tuple[int, int, int | None, str]] = []  # (signal, delay, its maximum, text)
        self.undelayed: list[tuple[int, str]] = []  # (delay, text) of delays that are zero
        self.parameter_values: list[float] | None = None  # None until they are known
        self._slopes: dict[int, int] = {}
        self._variables: dict[int, tuple[int, ...]] = {}
        self._node_of: list[int] = []  # of each variable, -1 for those without one so far
        self.zero = self.const(0.0)
        self.one = self.const(1.0)
        self.time = self.intern(("time",))

    def __getstate__(self) -> dict[str, Any]:
        numbers = {node: k for k, node in enumerate(self.nodes)}
        return {**self.__dict__, "_variables": {}, "_node_of": [], "_number": numbers}

    def retire(self) -> None:
        """Drop the lookup table of nodes; the next new node rebuilds it.

        For a pool that is only read from then on; the table takes a fifth of the memory of a large model.
        """
        self._number = _Retired(self)
        self._variables, self._node_of = {}, []

    def __repr__(self) -> str:
        return f"Pool({len(self.nodes)} nodes, {self.n_variables} variables)"

    def intern(self, node: Node) -> int:
        """Number of a node, without any simplification."""
        new = len(self.nodes)
        number = self._number.setdefault(node, new)
        if number == new:
            self.nodes.append(node)
        return number

    def const(self, value: float) -> int:
        return self.intern(("const", value + 0.0))

    def var(self, index: int) -> int:
        """Node of a variable, or of a stand-in with a negative index (`acausal.analyse.hidden`)."""
        # A list is several times faster than the table of all nodes.
        node_of = self._node_of
        if 0 <= index < len(node_of) and node_of[index] >= 0:
            return node_of[index]
        number = self.intern(("var", index))
        if index >= 0:
            node_of.extend([-1] * (max(index + 1, self.n_variables) - len(node_of)))
            node_of[index] = number
        return number

    def vars(self, variables: Iterable[int]) -> tuple[int, ...]:
        """Nodes of several variables."""
        return tuple(map(self.var, variables))

    def par(self, index: int) -> int:
        return self.intern(("par", index))

    def new_variables(self, count: int) -> int:
        """Number of the first of `count` new variables."""
        first = self.n_variables
        self.n_variables += count
        return first

    def derivative(self, variable: int) -> int:
        """The variable that is the time derivative of `variable`."""
        new = self.derivative_of.get(variable)
        if new is None:
            new = self.derivative_of[variable] = self.new_variables(1)
            self.integral_of[new] = variable
        return new

    def value(self, number: int) -> float | None:
        """The value of a constant node, else None."""
        node = self.nodes[number]
        return node[1] if node[0] == "const" else None

    def delayed(self, source: int, time: int, most: int | None, label: str) -> int:
        """The node of a signal delayed by `time`; equal delays share a number."""
        key = source, time, most
        index = next((k for k, d in enumerate(self.delays) if d[:3] == key), len(self.delays))
        if index == len(self.delays):
            self.delays.append((*key, label))
        return self.intern((Delayed(index, label), self.sub(self.time, time)))

    def parameter_value(self, root: int, given: Sequence[float] | None = None) -> float:
        """Value of a node for parameters `given`, shape (np,), or those of the model; nan if it is not constant."""
        value_of: dict[int, float] = {}
        values = (self.parameter_values or []) if given is None else given
        for number in self.reachable([root]):
            op, *args = self.nodes[number]
            if op == "const":
                value_of[number] = args[0]
            elif op == "par":
                value_of[number] = values[args[0]] if args[0] < len(values) else math.nan
            elif op in _VALUES and not any(math.isnan(value_of[a]) for a in args):
                try:
                    value_of[number] = _VALUES[op](*[value_of[a] for a in args])
                except (ValueError, OverflowError, ZeroDivisionError):
                    value_of[number] = math.nan
            else:
                value_of[number] = math.nan
        return value_of[root]

    def is_constant(self, root: int) -> bool:
        """True for an expression of parameters alone, whose value is known before the run."""
        nodes = self.nodes
        node = nodes[root]
        if node[0] in LEAVES or node[0] in _VARYING:
            return node[0] not in _VARYING
        stack, seen = [root], {root}
        while stack:  # usually ends immediately, at the first variable
            for number in nodes[stack.pop()][1:]:
                op = nodes[number][0]
                if op in _VARYING:
                    return False
                if op not in LEAVES and number not in seen:
                    seen.add(number)
                    stack.append(number)
        return True

    def varies(self, root: int) -> bool:
        """Whether a node depends on a variable or on time."""
        return any(self.nodes[n][0] in ("var", "time") for n in self.reachable([root]))

    def make(self, op: str, *args: int) -> int:
        """The node `op(args)`, simplified where that is exact for all values of the operands."""
        if op in _MAKE:
            return _MAKE[op](self, *args)
        if op in _UNEVALUATED or isinstance(op, Call | Delayed):
            return self.intern((op, *args))
        values: list[Any] = [self.value(a) for a in args]
        if all(v is not None for v in values):
            try:
                return self.const((_UNARY if len(args) == 1 else _BINARY)[op](*values))
            except (ValueError, OverflowError, ZeroDivisionError):
                pass  # left to the run, whose error names the equation
        if op == "pow" and values[1] is not None and values[1] in (0.0, 1.0):
            return self.one if values[1] == 0.0 else args[0]
        return self.intern((op, *args))

    def add(self, a: int, b: int) -> int:
        if a == self.zero:
            return b
        if b == self.zero:
            return a
        x, y = self.nodes[a], self.nodes[b]
        if x[0] == "const" and y[0] == "const":
            return self.const(x[1] + y[1])
        if y[0] == "neg":
            return self.sub(a, y[1])
        if x[0] == "neg":
            return self.sub(b, x[1])
        return self.intern(("add", a, b) if a < b else ("add", b, a))

    def sub(self, a: int, b: int) -> int:
        if b == self.zero:
            return a
        if a == self.zero:
            return self.neg(b)
        if a == b:
            return self.zero
        x, y = self.nodes[a], self.nodes[b]
        if x[0] == "const" and y[0] == "const":
            return self.const(x[1] - y[1])
        if y[0] == "neg":
            return self.add(a, y[1])
        return self.intern(("sub", a, b))

    def neg(self, a: int) -> int:
        node = self.nodes[a]
        if node[0] == "const":
            return self.const(-node[1])
        if node[0] == "neg":
            return int(node[1])
        if node[0] == "sub":
            return self.intern(("sub", node[2], node[1]))
        return self.intern(("neg", a))

    def mul(self, a: int, b: int) -> int:
        if a == self.zero or b == self.zero:
            return self.zero
        if a == self.one:
            return b
        if b == self.one:
            return a
        x, y = self.nodes[a], self.nodes[b]
        if x[0] == "const":
            if y[0] == "const":
                return self.const(x[1] * y[1])
            if x[1] == -1.0:
                return self.neg(b)
        elif y[0] == "const" and y[1] == -1.0:
            return self.neg(a)
        if x[0] == "neg":
            return self.neg(self.mul(x[1], b))
        if y[0] == "neg":
            return self.neg(self.mul(a, y[1]))
        return self.intern(("mul", a, b) if a < b else ("mul", b, a))

    def div(self, a: int, b: int) -> int:
        if b == self.one:
            return a
        y = self.nodes[b]
        if y[0] == "const" and y[1] != 0.0:
            x = self.nodes[a]
            if x[0] == "const":
                return self.const(x[1] / y[1])
            if y[1] == -1.0:
                return self.neg(a)
        if a == self.zero and y[0] in ("par", "const") and y != ("const", 0.0):
            return self.zero
        return self.intern(("div", a, b))

    def where(self, condition: int, a: int, b: int) -> int:
        decided = self.value(condition)
        if decided is not None:
            return a if decided else b
        return a if a == b else self.intern(("where", condition, a, b))

    def sum(self, terms: Iterable[int]) -> int:
        total = self.zero
        for term in terms:
            total = self.add(total, term)
        return total

    def collected(self, root: int) -> int:
        """A sum with equal terms combined: (a - b) - a is -b; `root` itself if no term occurs twice."""
        nodes = self.nodes
        node = nodes[root]
        if len(node) == 3 and node[1] != node[2] and nodes[node[1]][0] in LEAVES and nodes[node[2]][0] in LEAVES:
            return root  # the common case: most equations of a network
        if not self._repeats(root):
            return root
        factors: dict[int, float] = {root: 1.0}
        sizes: dict[int, float] = {root: 1.0}
        terms: list[int] = []
        # Descending order: operands have smaller numbers, so that the factors of a node are complete when it is popped.
        heap = [-root]
        while heap:
            number = -heapq.heappop(heap)
            below = _summands(nodes, nodes[number])
            if not below:
                terms.append(number)
            for operand, factor in below:
                if operand not in factors:
                    heapq.heappush(heap, -operand)
                factors[operand] = factors.get(operand, 0.0) + factor * factors[number]
                sizes[operand] = sizes.get(operand, 0.0) + abs(factor) * sizes[number]
        total = self.zero
        for number in reversed(terms):
            if abs(factors[number]) > 1e-14 * sizes[number]:
                total = self.add(total, self.mul(self.const(factors[number]), number))
        return total

    def _repeats(self, root: int) -> bool:
        """Whether a term of a sum occurs twice; called for every equation, and nearly always false."""
        nodes = self.nodes
        node = nodes[root]
        if node[0] not in _SUMS or (len(node) == 3 and node[1] != node[2] and not self._adds(node)):
            return False
        seen: set[int] = set()
        stack = [root]
        while stack:
            number = stack.pop()
            if number in seen:
                return True
            seen.add(number)
            node = nodes[number]
            op = node[0]
            if op == "add" or op == "sub":
                stack += node[1:]
            elif op == "neg":
                stack.append(node[1])
            elif op == "mul":
                stack += [operand for operand, _ in _summands(nodes, node)]
        return False

    def _adds(self, node: Node) -> bool:
        """Whether an operand is itself a sum, or a product with a constant."""
        nodes = self.nodes
        for number in node[1:]:
            below = nodes[number]
            op = below[0]
            if op in _SUMS and (op != "mul" or nodes[below[1]][0] == "const" or nodes[below[2]][0] == "const"):
                return True
        return False

    def reachable(self, roots: Iterable[int], done: Collection[int] | None = None) -> list[int]:
        """All nodes needed to evaluate `roots`, in evaluation order, without nodes in `done` and those below them."""
        nodes = self.nodes
        stack = list(roots) if done is None else [r for r in roots if r not in done]
        if len(stack) * _DENSE > len(nodes):
            return self._reachable_of_many(stack, done or ())
        seen: set[int] = set()
        while stack:
            number = stack.pop()
            if number in seen or (done and number in done):
                continue
            seen.add(number)
            node = nodes[number]
            if node[0] not in LEAVES:
                stack.extend(node[1:])
        return sorted(seen)

    def _reachable_of_many(self, roots: Iterable[int], done: Container[int]) -> list[int]:
        """Like `reachable`, with a mark for every node: half the cost of sorting a set of most nodes."""
        nodes = self.nodes
        marks = bytearray(len(nodes))
        for number in roots:
            marks[number] = 1
        for number in range(len(nodes) - 1, -1, -1):
            if marks[number]:
                if done and number in done:
                    marks[number] = 0
                    continue
                node = nodes[number]
                if node[0] not in LEAVES:
                    for child in node[1:]:
                        marks[child] = 1
        return list(compress(range(len(nodes)), marks))

    def variables_in(self, *roots: int) -> frozenset[int]:
        """Numbers of the variables that `roots` depend on; small results for a single root are cached."""
        if len(roots) != 1:
            return frozenset(self._variables_of_many(roots))
        cached = self._variables.get(roots[0])
        if cached is not None:
            return frozenset(cached)
        variables = frozenset(set(self.entries(roots[0])))
        if len(variables) <= _MOST_CACHED:  # caching all partial sums of n terms would need memory of order n^2
            self._variables[roots[0]] = tuple(variables)  # a tuple needs a third of the memory of a set
        return variables

    def entries(self, root: int) -> list[int]:
        """Variables that a node depends on, in no particular order and possibly repeated; without caching."""
        nodes, stack = self.nodes, [root]
        variables: list[int] = []
        if nodes[root][0] in LEAVES:
            return [nodes[root][1]] if nodes[root][0] == "var" else []
        for _ in range(_MOST_WITHOUT_SET):
            if not stack:
                return variables
            for number in nodes[stack.pop()][1:]:
                node = nodes[number]
                op = node[0]
                if op == "var":
                    variables.append(node[1])
                elif op not in LEAVES:
                    stack.append(number)
        # A large expression may share so many nodes that the number of its paths explodes.
        return list(self._variables_of_many((root,)))

    def _variables_of_many(self, roots: Iterable[int]) -> set[int]:
        nodes, cached = self.nodes, self._variables
        stack = list(roots)
        if len(stack) * _DENSE > len(nodes):
            return {nodes[n][1] for n in self.reachable(stack) if nodes[n][0] == "var"}
        seen, variables = set[int](), set[int]()
        while stack:
            number = stack.pop()
            if number in seen:
                continue
            seen.add(number)
            if number in cached:
                variables.update(cached[number])
                continue
            node = nodes[number]
            op = node[0]
            if op == "var":
                variables.add(node[1])
            elif op not in LEAVES:
                stack.extend(node[1:])
        return variables

    def variables_behind(self, roots: Iterable[int], definitions: Mapping[int, int]) -> set[int]:
        """Variables that `roots` depend on, also through definitions of variables by nodes."""
        return closure(
            self.variables_in(*roots), lambda v: self.variables_in(definitions[v]) if v in definitions else ()
        )

    def rewrite(self, roots: Iterable[int], leaf: Callable[[int], int], done: dict[int, int]) -> None:
        """Substitute node `leaf(i)` for each variable i, and add the image of every node below `roots` to `done`."""
        nodes = self.nodes
        for number in self.reachable(roots, done):
            node = nodes[number]
            op = node[0]
            if op == "var":
                done[number] = leaf(node[1])
            elif op in LEAVES:
                done[number] = number
            elif op in _BINARY_MAKE:
                _, old_a, old_b = node
                a, b = done[old_a], done[old_b]
                done[number] = number if a == old_a and b == old_b else _BINARY_MAKE[op](self, a, b)
            else:
                image = tuple([done[c] for c in node[1:]])
                done[number] = number if image == node[1:] else self.make(op, *image)

    def copy(self, other: Pool, numbers: Iterable[int], images: dict[int, int]) -> None:
        """Copy the nodes `numbers` of another pool, given in evaluation order, and add their images to `images`.

        Beforehand `images` has those of all variables, and of any other nodes that are replaced.
        """
        nodes = other.nodes
        for number in numbers:
            if number in images:
                continue
            node = nodes[number]
            op = node[0]
            if op in LEAVES:
                images[number] = images[number] if op == "var" else self.intern(node)  # KeyError for a variable
            elif op in _BINARY_MAKE:
                images[number] = _BINARY_MAKE[op](self, images[node[1]], images[node[2]])
            else:
                images[number] = self.make(op, *[images[c] for c in node[1:]])


def closure(start: Iterable[int], depends: Callable[[int], Iterable[int]]) -> set[int]:
    """`start` and everything that these depend on, directly or indirectly."""
    reached: set[int] = set()
    stack = list(start)
    while stack:
        here = stack.pop()
        if here not in reached:
            reached.add(here)
            stack.extend(depends(here))
    return reached


class _Retired(dict[Node, int]):
    """Placeholder of a dropped lookup table, which the first access rebuilds."""

    def __init__(self, pool: Pool) -> None:
        super().__init__()
        self.pool = pool

    def setdefault(self, node: Node, default: int) -> int:
        """The number of a node, from the rebuilt table, to which it is added if needed."""
        self.pool._number = {node: k for k, node in enumerate(self.pool.nodes)}
        return self.pool._number.setdefault(node, default)


def _summands(nodes: list[Node], node: Node) -> tuple[tuple[int, float], ...]:
    """(Operand, factor) of each term of a sum; empty for a node that is not a sum."""
    op = node[0]
    if op in ("add", "sub"):
        return (node[1], 1.0), (node[2], 1.0 if op == "add" else -1.0)
    if op == "neg":
        return ((node[1], -1.0),)
    if op == "mul":
        for factor, other in ((node[1], node[2]), (node[2], node[1])):
            if nodes[factor][0] == "const":
                return ((other, nodes[factor][1]),)
    return ()


_VALUES: dict[str, Callable[..., float]] = {
    **_UNARY,
    **_BINARY,
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "neg": lambda a: -a,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "where": lambda c, a, b: a if c else b,
}


_BINARY_MAKE: dict[str, Callable[[Pool, int, int], int]] = {
    "add": Pool.add,
    "sub": Pool.sub,
    "mul": Pool.mul,
    "div": Pool.div,
}
_MAKE: dict[str, Callable[..., int]] = {**_BINARY_MAKE, "neg": Pool.neg, "where": Pool.where}
