"""Relations of saturated expressions: `maximum(k*u, 0) > 0` becomes `u > 0 and k*u > 0`.

The instant of an event is a zero of the difference of the sides of a relation. If this difference is constant beyond a
kink of `minimum`, `maximum`, `fabs` or a choice below `no_event`, it may reach zero without crossing it: the relation
changes although the difference does not change sign. Such a relation is split at its kink, which becomes a relation
itself; on each side the kink is replaced by its active operand.

The position of some kinks is unknown, for instance of those inside external functions or sums of roots. Relations that
still contain such a kink are listed (`Kinks.resting_relations`), and located where their sides become equal, however
long they stay equal (`EventFunctions.signed_at_rest`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from acausal.flatten.pool import LEAVES, RELATIONS, Pool
from acausal.language.expressions.external import Call
from acausal.numeric.evaluate import Samples, values
from acausal.numeric.samples import SamplePoints

_DEEPEST = 4
"""Largest nesting of kinks at which a relation is split."""
_EQUAL = 1e-12
"""Two samples are equal if they differ by less than this fraction of the largest."""
# Number of lines between sample points on which a zero is searched, number of bisections, and the distance beyond the
# zero, as a fraction of the rest of the line, at which the difference is evaluated again.
_LINES, _HALVINGS, _BEYOND = 8, 50, 1e-9
_NOT_SEARCHED = frozenset(("pre", "sample", "initial", "after_reset", "terminal", "infinitesimal"))
_REVERSED = {"gt": "lt", "lt": "gt", "ge": "le", "le": "ge"}
_PLAIN = frozenset(("min", "max", "fabs"))
_KINKS = _PLAIN | {"where"}


def split_at_kinks(kinks: Kinks, points: SamplePoints, visible: Iterable[int], done: dict[int, int]) -> dict[int, int]:
    """Images of those `visible` relations that are saturated beyond a kink.

    `done` has images of other nodes and receives these.
    """
    images: dict[int, int] = {}
    pool, split = kinks.pool, _Split(kinks, points)
    for number in visible:
        if pool.nodes[number][0] in RELATIONS and number not in done:
            image = split.image(number)
            if image != number:
                images[number] = done[number] = image
    return images


class Kinks:
    """Finds kinks without events, and external functions, in expressions of a model."""

    def __init__(self, pool: Pool, definitions: Sequence[tuple[int, int]]) -> None:
        self.pool, self.definitions = pool, definitions
        self._known: dict[int, int] = {}
        self._of: dict[int, int] = {}
        self._defined = False  # `_of` is filled at the first relation of variables; most are of time or parameters

    def resting_relations(self, points: SamplePoints, relations: Iterable[int]) -> frozenset[int]:
        """The relations whose sides may stay equal for a while, as they are equal at several sample points."""
        resting = set[int]()
        for relation in relations:
            level = self.below(relation)
            distance = self.pool.sub(*self.pool.nodes[relation][1:])
            rests = level > 0 and np.count_nonzero(points.everywhere(distance) == 0.0) > 1
            if rests or (level == 2 and self._stays_at_its_zero(points, distance)):
                resting.add(relation)
        return frozenset(resting)

    def _stays_at_its_zero(self, points: SamplePoints, distance: int) -> bool:
        """Whether a difference reaches zero and stays there, on straight lines between sample points.

        Sample points alone do not suffice: a dead zone may be narrower than their distance.
        """
        defined, pool = dict(self.definitions), self.pool
        behind = pool.variables_behind([distance], defined)
        order = [v for v in defined if v in behind]
        at = points.everywhere(distance)
        above, not_above = np.flatnonzero(at > 0.0), np.flatnonzero(at <= 0.0)
        count = min(len(above), len(not_above), _LINES)
        if not count:
            return False
        above, not_above = above[:count], not_above[:count]

        def along(fraction: Samples) -> Samples:
            samples_of: dict[int, Samples] = {}

            def between(samples: Samples) -> Samples:
                return np.asarray(samples[above] + fraction * (samples[not_above] - samples[above]))

            leaves: dict[str, Callable[[int], Any]] = {
                "var": lambda v: samples_of[v] if v in samples_of else between(points.everywhere(pool.var(v))),
                "par": points.parameters.__getitem__,
                "time": lambda _: between(points.everywhere(pool.time)),
            }
            for v in order:
                samples_of[v] = values(pool, [defined[v]], leaves)[defined[v]]
            return np.asarray(values(pool, [distance], leaves)[distance]) + np.zeros(count)

        low, high = np.zeros(count), np.ones(count)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            is_above = along(middle) > 0.0
            low, high = np.where(is_above, middle, low), np.where(is_above, high, middle)
        beyond = high + _BEYOND * (1.0 - high)
        return bool(((along(high) == 0.0) & (along(beyond) == 0.0)).any())

    def below(self, root: int) -> int:
        """0 for a node without kinks, 1 with kinks, 2 with external functions, 3 with some that may jump."""
        nodes, known = self.pool.nodes, self._known
        below = self.pool.reachable([root], known)
        if not self._defined and any(nodes[n][0] == "var" for n in below):
            self._defined = True
            for v, node in self.definitions:  # in the order of evaluation
                self._of[v] = self.below(node)
            below = self.pool.reachable([root], known)
        for number in below:
            op, *rest = nodes[number]
            if op == "var":
                known[number] = self._of.get(rest[0], 0)
            elif isinstance(op, Call):
                known[number] = 3 if op.external.jumps else 2
            else:
                inside = (
                    [known[n] for n in rest[op == "where" :]] if op not in LEAVES and op not in _NOT_SEARCHED else []
                )
                is_exempt = op == "noevent" or (op == "where" and nodes[rest[0]][0] == "noevent")
                known[number] = max((is_exempt or op in _PLAIN, *inside))
        return known[root]


class _Split:
    """Splits the relations of one model at kinks, including those in the definitions of their variables."""

    def __init__(self, kinks: Kinks, points: SamplePoints) -> None:
        self.pool, self.points, self.kinks = kinks.pool, points, kinks
        self.definitions = kinks.definitions
        self.defined = dict(kinks.definitions)

    def image(self, relation: int, depth: int = _DEEPEST) -> int:
        """The relation, or a branch at the first kink beyond which it is saturated."""
        pool = self.pool
        op, *sides = pool.nodes[relation]
        if op not in RELATIONS or not depth or max(self.kinks.below(n) for n in sides) != 1:
            return relation  # without kinks, or with external functions, which may saturate anywhere
        if not self._repeats(self._distance(sides)):
            return relation
        for kink, is_exempt in sorted(self._below(sides).items()):
            condition, here, there = self._branches(kink, is_exempt)
            if not condition or not self._is_saturated(sides, condition):
                continue
            inside, outside = (self._on_branch(op, sides, kink, branch, condition, depth) for branch in (here, there))
            kind, *operands = pool.nodes[condition]
            reversed_condition = pool.make(kind, *reversed(operands))
            if outside == reversed_condition:  # the branch reduces to one relation
                condition, inside, outside = reversed_condition, outside, inside
            is_all = (inside, outside) == (condition, pool.zero)
            return condition if is_all else pool.where(condition, inside, outside)
        return relation

    def _on_branch(self, op: str, sides: Sequence[int], kink: int, branch: int, condition: int, depth: int) -> int:
        """The relation with a kink replaced by one of its branches."""
        pool = self.pool
        left, right = self._replace_kink(sides, kink, branch)
        if left == right:
            return pool.const(float(op in ("le", "ge")))
        if not np.isfinite(self.points.everywhere(pool.sub(left, right))).all():
            return self._by_factors(op, sides, depth - 1)
        return self.image(pool.make(op, left, right), depth - 1)

    def _by_factors(self, op: str, sides: Sequence[int], depth: int) -> int:
        """The relation expressed by the signs of factors, for a root or power that is undefined on the branch."""
        pool = self.pool
        left, right = sides
        if left == pool.zero:
            left, right, op = right, left, _REVERSED[op]
        if right != pool.zero:
            return pool.make(op, left, right)
        if op in ("ge", "le"):
            return pool.make("not", self._by_factors("lt" if op == "ge" else "gt", (left, right), depth))
        node = pool.nodes[left]
        if node[0] == "var" and node[1] in self.defined:
            return self._by_factors(op, (self.defined[node[1]], right), depth)
        opposite = _REVERSED[op]
        if node[0] == "neg":
            return self._by_factors(opposite, (node[1], right), depth)
        if node[0] in ("mul", "div"):
            signs = ("gt", op), ("lt", opposite)
            sign_cases = [
                [self._by_factors(s, (n, right), depth) for s, n in zip(k, node[1:], strict=True)] for k in signs
            ]
            return pool.make("or", pool.make("and", *sign_cases[0]), pool.make("and", *sign_cases[1]))
        power = 0.5 if node[0] == "sqrt" else pool.value(node[2]) if node[0] == "pow" else None
        if power is not None and power > 0.0 and power % 1.0:
            return self._by_factors("gt", (node[1], right), depth) if op == "gt" else pool.zero
        return self.image(pool.make(op, left, right), depth)

    def _below(self, sides: Iterable[int]) -> dict[int, bool]:
        """Maps all nodes below the sides, definitions but not conditions included, to whether below `no_event`."""
        nodes = self.pool.nodes
        exempt_of: dict[int, bool] = {}
        stack = [(n, False) for n in sides]
        while stack:
            number, is_exempt = stack.pop()
            if exempt_of.get(number, False) or exempt_of.get(number) == is_exempt:
                continue
            exempt_of[number] = is_exempt
            op, *rest = nodes[number]
            is_exempt |= op == "noevent"
            if op == "var":
                stack += [(self.defined[v], is_exempt) for v in rest if v in self.defined]
            elif op == "where":
                stack += [(n, is_exempt) for n in rest[1:]]
            elif op not in LEAVES and op not in _NOT_SEARCHED:
                stack += [(n, is_exempt) for n in rest]
        return exempt_of

    def _branches(self, kink: int, is_exempt: bool) -> tuple[int, int, int]:
        """(Relation of a kink, value of the kink where that holds, value elsewhere); the relation is 0 if none."""
        pool = self.pool
        op, *operands = pool.nodes[kink]
        if op == "fabs":
            return pool.make("gt", operands[0], pool.zero), operands[0], pool.neg(operands[0])
        if op not in _KINKS:
            return 0, 0, 0
        if op == "where":
            condition, *rest = operands
            while pool.nodes[condition][0] == "noevent":
                condition, is_exempt = pool.nodes[condition][1], True
            return (condition if is_exempt and pool.nodes[condition][0] in RELATIONS else 0), *rest
        return pool.make("gt" if op == "max" else "lt", *operands), operands[0], operands[1]

    def _is_saturated(self, sides: Sequence[int], condition: int) -> bool:
        """Whether the difference of the sides is constant somewhere on one side of a condition."""
        if not self.points.varies(condition):
            return False
        distance, holds = self._distance(sides), self.points.everywhere(condition) != 0.0
        # Two equal samples suffice: the difference may be saturated only where several kinks are inactive together.
        return self._repeats(distance[holds]) or self._repeats(distance[~holds])

    def _distance(self, sides: Sequence[int]) -> Samples:
        return self.points.everywhere(self.pool.sub(*sides))

    @staticmethod
    def _repeats(values: Samples) -> bool:
        """Whether two of the values, shape (K,), are equal; False if any is not finite."""
        if not np.isfinite(values).all():
            return False
        return bool((np.diff(np.sort(values)) <= _EQUAL * float(np.abs(values).max(initial=0.0))).any())

    def _replace_kink(self, sides: Sequence[int], kink: int, branch: int) -> list[int]:
        """The sides with a kink replaced by a branch; definitions that contain the kink are substituted."""
        pool = self.pool
        done = {kink: branch}
        images: dict[int, int] = {}

        def leaf(v: int) -> int:
            return images.get(v, pool.var(v))

        needed = {pool.nodes[n][1] for n in self._below(sides) if pool.nodes[n][0] == "var"}
        for v, node in self.definitions:
            if v in needed:
                pool.rewrite([node], leaf, done)
                if done[node] != node:
                    images[v] = done[node]
        pool.rewrite(sides, leaf, done)
        return [done[n] for n in sides]
