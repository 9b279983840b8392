"""Relations that have no value everywhere, such as `sqrt(x) > c`: false where they have none, with an event at its end.

A comparison with nan is false, in Python as in C. The guard of such a relation does not exist beyond the domain of its
functions, and shows no instant at which that domain is entered. The relation therefore becomes `x >= 0 and g > c`,
where `g` is the root in its domain and an odd extension beyond it, as in the branches of `domains.py`; both guards
exist everywhere. Where the operand of a function is never outside its domain, as in `sqrt(x**2 + y**2)`, nothing
changes.

A quotient is nan where both of its operands are zero, which they may be for a while; where only its denominator is, it
is infinite, and can be compared. At a pole its guard changes sign without a zero, and the slope there tells nothing
about its error. A relation of quotients whose denominators may change sign is therefore multiplied out: `1/x > c`
becomes `1 - c*x > 0` where `x >= 0`, and `1 - c*x < 0` elsewhere. Only quotients that the model states count: those
that solve its equations divide by pivots, which are chosen so that they do not vanish.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable
from functools import partial, reduce

import numpy as np

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.domains.branches import extended
from acausal.flatten.pool import LEAVES, RELATIONS, Pool, closure
from acausal.numeric.intervals import Interval, ranges

_PARTIAL = frozenset(("pow", "sqrt", "log", "asin", "acos", "div"))
_OF_FRACTIONS = frozenset(("add", "sub", "mul", "neg", "div"))
_TINY = 1e-100
# What a condition or a discrete memory below a relation contains is evaluated at events.
OPAQUE = frozenset((*RELATIONS, "and", "or", "not", "pre", "sample"))


def in_domains(pool: Pool, existence: Existence, visible: Iterable[int], done: dict[int, int]) -> dict[int, int]:
    """Images of those `visible` relations that have no value somewhere.

    `done`: The images of other nodes; receives these.
    """
    images: dict[int, int] = {}
    if not any(op in _PARTIAL for op, *_ in pool.nodes):
        return images
    for number in visible:
        if pool.nodes[number][0] not in RELATIONS or number in done or not existence.moves(number):
            continue
        exists, everywhere = existence.parts(number)
        if everywhere != number:
            existence.written[everywhere] = number
            images[number] = done[number] = _both(pool, exists, everywhere)
    return images


class Existence:
    """Where nodes of a pool have a value, and their extensions to where they have none.

    `moves`: Whether a node varies between events.
    `exempt`: Whether this is about relations below `no_event`. They are evaluated wherever a solver goes, and none
        is missed because it was nan where a stretch begins: quotients are left out, and relations that have a value at
        all sample points.

    `stated`: The nodes that are in the equations of the model, not only in their solution.

    `written` maps relations with extensions in them to what the model says.
    """

    def __init__(
        self, solution: Solution, moves: Callable[[int], bool], stated: Container[int] = (), *, exempt: bool
    ) -> None:
        self.functions = _PARTIAL - {"div"} if exempt else _PARTIAL
        self.exempt = exempt
        self.reduced, self.points = solution.structure.reduced, solution.structure.points
        self.pool = self.reduced.pool
        self.defined, self.moves, self.stated = dict(solution.definitions), moves, stated
        self.conditions: dict[int, int] = {}
        self.images: dict[int, int] = {}
        self.fractions: dict[int, tuple[int, int]] = {}  # of images with denominators that may change their signs
        self.written: dict[int, int] = {}

    def parts(self, relation: int) -> tuple[int, int]:
        """A node that is true where both sides have a value, and the relation of their extensions."""
        pool = self.pool
        op, *sides = pool.nodes[relation]
        if self.exempt and np.isfinite(self.points.everywhere(pool.sub(*sides))).all():
            return pool.one, relation
        self._visit(sides)
        exists = _both(pool, *(self.conditions[n] for n in sides))
        if not self.fractions.keys().isdisjoint(sides):
            difference, denominator = self._fraction("sub", sides)
            positive = pool.make("ge", denominator, pool.zero)
            return exists, pool.make(op, pool.where(positive, difference, pool.neg(difference)), pool.zero)
        if exists == pool.one:
            return exists, relation
        arcs = [self.pool.nodes[self._resolved(n)] for n in sides]
        for side, (kind, *operands) in enumerate(arcs):
            if kind in ("asin", "acos"):
                return exists, self._of_arc(op, side, kind, operands[0], self.images[sides[1 - side]])
        # the slope of a root has no bound at its zero, which is that of its operand
        image = self._operand_of_root if pool.zero in sides else self.images.__getitem__
        return exists, pool.make(op, *(image(n) for n in sides))

    def _of_arc(self, op: str, side: int, kind: str, operand: int, other: int) -> int:
        """`asin(u) > b` as `u > sin(b)`, since the slope of an arc has no bound at the ends of its domain.

        Beyond 90 degrees, the sine goes on as a straight line, so that it increases everywhere.
        """
        pool = self.pool
        quarter = pool.const(math.pi / 2)
        angle = other if kind == "asin" else pool.sub(quarter, other)
        within = pool.make("max", pool.make("min", angle, quarter), pool.neg(quarter))
        compared = [self.images[operand], pool.add(pool.make("sin", within), pool.sub(angle, within))]
        return pool.make(op, *(compared if (side == 0) == (kind == "asin") else reversed(compared)))

    def _resolved(self, number: int) -> int:
        """A node, or the definition of a variable."""
        nodes = self.pool.nodes
        while nodes[number][0] == "var" and nodes[number][1] in self.defined:
            number = self.defined[nodes[number][1]]
        return number

    def _operand_of_root(self, side: int) -> int:
        """The image of the operand of a root or power that is zero where its operand is; of the side itself if none."""
        op, *operands = self.pool.nodes[side]
        power = 0.5 if op == "sqrt" else self.pool.value(operands[1]) if op == "pow" else None
        is_root = power is not None and power > 0.0 and power != round(power)
        return self.images[operands[0] if is_root else side]

    def may_fail(self, number: int) -> bool:
        """Whether a node may have no value somewhere."""
        self._visit([number])
        return self.conditions[number] != self.pool.one

    def relations(self, relation: int) -> list[int]:
        """The relations that decide a relation: itself, or those of its parts."""
        exists, everywhere = self.parts(relation)
        return [*self._relations([exists]), everywhere]

    def _relations(self, conditions: list[int]) -> list[int]:
        nodes = self.pool.nodes
        ends = closure(conditions, lambda n: nodes[n][1:] if nodes[n][0] in ("and", "or", "where") else ())
        return sorted(n for n in ends if nodes[n][0] in RELATIONS)

    def _visit(self, roots: Iterable[int]) -> None:
        """Fill `conditions` and `images` of `roots` and all below them; definitions may form long chains."""
        begun = set[int]()
        waiting = [(n, False) for n in roots]
        while waiting:
            number, is_begun = waiting.pop()
            if is_begun:
                self._visit_known(number)
            elif number not in self.conditions and number not in begun:
                begun.add(number)
                waiting.append((number, True))
                waiting += [(n, False) for n in self._unknown_below(number)]

    def _unknown_below(self, root: int) -> set[int]:
        """Definitions of the variables below a node, unless they are known."""
        nodes = self.pool.nodes
        variables = (nodes[n][1] for n in self.pool.reachable([root], self.conditions) if nodes[n][0] == "var")
        return {self.defined[v] for v in variables if v in self.defined}.difference(self.conditions)

    def _visit_known(self, root: int) -> None:
        pool = self.pool
        for number in pool.reachable([root], self.conditions):
            op, *operands = pool.nodes[number]
            condition, image = pool.one, number
            # a definition without a condition is part of a cycle that modes have cut
            if op == "var" and self.defined.get(operands[0]) in self.conditions:
                node = self.defined[operands[0]]
                condition = self.conditions[node]
                image = number if condition == pool.one else self.images[node]
                if node in self.fractions:
                    self.fractions[number] = self.fractions[node]
            elif op == "where":
                a, b = operands[1:]
                condition = pool.where(operands[0], self.conditions[a], self.conditions[b])
                image = pool.where(operands[0], self.images[a], self.images[b])
            elif op not in LEAVES and op not in OPAQUE:
                for n in operands:
                    condition = _both(pool, condition, self.conditions[n])
                inside = [self.images[n] for n in operands]
                image = number if inside == operands else pool.make(op, *inside)
                own = self._domain(op, inside) if self._is_partial(number) else []
                if own:
                    condition = reduce(partial(_both, pool), own, condition)
                    image = self._extension(op, inside)
                if own and inside != operands:
                    written = self._relations(self._domain(op, operands))
                    self.written |= zip(self._relations(own), written, strict=False)
                turns = op == "div" and self._is_partial(number) and self._changes_sign(inside[1])
                if turns or (op in _OF_FRACTIONS and not self.fractions.keys().isdisjoint(operands)):
                    self.fractions[number] = self._fraction(op, operands)
            self.conditions[number], self.images[number] = condition, image

    def _is_partial(self, number: int) -> bool:
        """Whether a node is a function that has no value somewhere, or a quotient of the model."""
        op, *operands = self.pool.nodes[number]
        if op not in self.functions or not self.moves(operands[op == "div"]):
            return False
        return op != "div" or number in self.stated

    def _changes_sign(self, denominator: int) -> bool:
        low, high = self._range(denominator, self._value)
        return low < 0.0 < high

    def _fraction(self, op: str, operands: list[int]) -> tuple[int, int]:
        """Numerator and denominator of an operation on images."""
        pool = self.pool
        parts = [self.fractions.get(n, (self.images[n], pool.one)) for n in operands]
        a, b = parts[0]
        if op == "neg":
            return pool.neg(a), b
        c, d = parts[1]
        if op == "mul":
            return pool.mul(a, c), pool.mul(b, d)
        if op == "div":
            return pool.mul(a, d), pool.mul(b, c)
        if b == d:
            return pool.make(op, a, c), b
        return pool.make(op, pool.mul(a, d), pool.mul(c, b)), pool.mul(b, d)

    def _domain(self, op: str, operands: list[int]) -> list[int]:
        """The relations that hold in the domain of a function; none if its operand is always inside."""
        pool = self.pool
        if op == "div":
            return self._nonzero(operands)
        low, high = self._range(operands[0], self._known)
        above = pool.make("gt" if op == "log" else "ge", operands[0], pool.zero)
        if op in ("asin", "acos"):
            ends = pool.make("ge", operands[0], pool.neg(pool.one)), pool.make("le", operands[0], pool.one)
            return [end for end, inside in zip(ends, (low >= -1.0, high <= 1.0), strict=True) if not inside]
        if op != "pow":
            return [] if low > 0.0 or (low == 0.0 and op == "sqrt") else [above]
        exponent = pool.value(operands[1])
        if exponent is None:
            remainder = pool.sub(operands[1], pool.make("floor", operands[1]))
            integer = pool.make("noevent", pool.make("le", pool.make("noevent", remainder), pool.zero))
            return [] if low >= 0.0 else [pool.make("or", integer, above)]
        return [] if low >= 0.0 or exponent == round(exponent) else [above]

    def _nonzero(self, operands: list[int]) -> list[int]:
        """The relation that one of these is not zero; none if that is certain.

        Only the denominator is located: the sign of the numerator has no meaning elsewhere.
        """
        pool = self.pool
        numerator, denominator = operands
        around, (low, high) = (self._range(n, self._value) for n in operands)
        if max(around[0], low) > 0.0 or min(around[1], high) < 0.0:
            return []
        signs = [pool.make(op, denominator, pool.zero) for op, may in (("gt", high > 0.0), ("lt", low < 0.0)) if may]
        numerator = pool.make("fabs", pool.make("noevent", numerator))
        signs.append(pool.make("noevent", pool.make("gt", numerator, pool.zero)))
        return [reduce(partial(pool.make, "or"), signs)]

    def _extension(self, op: str, operands: list[int]) -> int:
        """The function, or something that exists, beyond its domain.

        Towards a pole at the end of its domain it stays as it is there: a guard must not come back from it.
        """
        pool = self.pool
        exponent = pool.value(operands[-1]) if op == "pow" else None
        if op == "log" or (exponent is not None and exponent < 0.0):
            return pool.make(op, pool.make("max", operands[0], pool.const(_TINY)), *operands[1:])
        if op != "div":
            return extended(pool, op, operands)
        a, b = operands
        larger = pool.make("max", *(pool.make("fabs", pool.make("noevent", n)) for n in operands))
        exists = pool.make("noevent", pool.make("gt", larger, pool.zero))
        return pool.where(exists, pool.div(a, pool.where(exists, b, pool.one)), pool.zero)

    def _known(self, number: int) -> float | Interval | None:
        """The value of an operand, or its bounds, that decides whether a function has one; parameters may change."""
        return self.pool.value(number)

    def _value(self, number: int) -> float | None:
        """The value of a node that does not vary: a parameter that is not zero is not expected to become zero."""
        return None if self.moves(number) else float(self.points.of(number)[0])

    def _range(self, number: int, value: Callable[[int], float | Interval | None]) -> Interval:
        """Bounds of a node, through the definitions of its variables, for values of those that are constant."""
        number = self._resolved(number)
        return ranges(self.pool, self.pool.reachable([number]), value, kinks=True)[number]


def _both(pool: Pool, a: int, b: int) -> int:
    if pool.one in (a, b) or a == b:
        return b if a == pool.one else a
    return pool.make("and", a, b)
