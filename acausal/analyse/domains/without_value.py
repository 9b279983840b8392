"""Operations that would give a number for an operand without value: `minimum(sqrt(x), 2)` is 2 in C where x < 0.

`fmin` and `fmax` return the other operand if one of them is nan, and a branch on relations is that of false ones, which
makes a sign of nan -1. A run would go on with it. The image of such an operation is therefore multiplied by a factor
that is 1 where the operand has a value, and nan elsewhere: `sign(2 + sign(u))`, whose slope is zero. (CasADi replaces
the square of a root by its operand, so that `sign(1 + u*u)` would be a number.) Only operands that may have no value
get one: those of roots, logarithms and the like that may leave their domain, and quotients that may become 0/0.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.domains.partial_relations import OPAQUE, Existence
from acausal.flatten.pool import LEAVES, Pool
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup
from acausal.numeric.intervals import Interval

EXTREMA = frozenset(("min", "max"))
_OPERATIONS = EXTREMA | {"sign", "floor", "ceil"}


class WithoutValue:
    """Finds operands that may have no value, whether they vary within a stretch or at events only.

    `stated`: The nodes that are in the equations of the model, in evaluation order. Those that are only in their
        solution are chosen so that they have a value.
    """

    def __init__(self, solution: Solution, stated: Sequence[int]) -> None:
        self._stated, self._definitions = stated, solution.definitions
        self.pool: Pool = solution.structure.reduced.pool
        self._varying: dict[int, bool] = {}
        self._existence = _OfModel(solution, self._varies, frozenset(stated), exempt=False)

    def extrema(self) -> list[int]:
        """The minima and maxima of the model with an operand that may have no value, in evaluation order."""
        nodes = self.pool.nodes
        return [n for n in self._stated if nodes[n][0] in EXTREMA and self.concerns(n)]

    def concerns(self, number: int) -> bool:
        """Whether a node is an operation that keeps nan, on an operand that may have no value."""
        op, *operands = self.pool.nodes[number]
        return (op in _OPERATIONS or isinstance(op, Call)) and any(map(self.is_for, operands))

    def is_for(self, operand: int) -> bool:
        """Whether an operand may have no value: of external functions, nothing is known."""
        return self._existence.may_fail(operand) or operand in self._external

    def images(self, numbers: Iterable[int], images: Mapping[int, int]) -> dict[int, int]:
        """Images of extrema that keep nan; `images` are those of other nodes."""
        pool, done, kept = self.pool, dict(images), dict[int, int]()
        for number in numbers:
            op, *operands = pool.nodes[number]
            pool.rewrite(operands, pool.var, done)
            image = done[number] if number in images else pool.make(op, *(done[n] for n in operands))
            kept[number] = done[number] = self.kept(image, operands, done)
        return kept

    def kept(self, image: int, operands: Sequence[int], done: Mapping[int, int]) -> int:
        """The image of an operation, nan where one of the operands has no value; `done` has their images."""
        pool = self.pool
        for n in filter(self.is_for, operands):
            positive = pool.add(pool.const(2.0), pool.make("sign", done[n]))
            image = pool.mul(image, pool.make("noevent", pool.make("sign", positive)))
        return image

    @cached_property
    def _external(self) -> set[int]:
        """Nodes that depend on an external function, also through definitions of variables."""
        nodes, found, variables = self.pool.nodes, set[int](), set[int]()
        sources = {
            n for n, (op, *_) in enumerate(nodes) if isinstance(op, Call) and not isinstance(op.external, Lookup)
        }
        if not sources:
            return found
        done = set[int]()
        for variable, root in (*self._definitions, *((None, n) for n in self._stated)):
            for number in self.pool.reachable([root], done):
                op, *operands = nodes[number]
                done.add(number)
                inside = op not in LEAVES and op not in OPAQUE and not found.isdisjoint(operands)
                if inside or number in sources or (op == "var" and operands[0] in variables):
                    found.add(number)
            if root in found and variable is not None:
                variables.add(variable)
        return found

    def _varies(self, number: int) -> bool:
        """Whether a node depends on more than parameters."""
        for n in self.pool.reachable([number], self._varying):
            op, *rest = self.pool.nodes[n]
            inner = op not in LEAVES and any(self._varying[c] for c in rest)
            self._varying[n] = inner or op in ("var", "time")
        return self._varying[number]


class _OfModel(Existence):
    """Where expressions of the model have a value, parameters within their declared bounds.

    What solves its equations does not count.
    """

    @cached_property
    def _bounds(self) -> dict[int, Interval]:
        """The bounds of parameters, by nodes."""
        flat = self.reduced.flat
        return {n: (q.declaration.min, q.declaration.max) for q in flat.parameters if q.free for n in q.nodes}

    def _is_partial(self, number: int) -> bool:
        op = self.pool.nodes[number][0]
        return number in self.stated and (op in self.functions - {"div"} or super()._is_partial(number))

    def _known(self, number: int) -> float | Interval | None:
        return self._bounds.get(number, self.pool.value(number))
