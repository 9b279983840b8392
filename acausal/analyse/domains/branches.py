"""Branches of `where` and the domains of their functions: roots, powers, logarithms, quotients.

`where(h < 0, k * (-h)**1.5, 0)` is a valid model, and both of its branches are part of one expression graph. The
inactive branch evaluates to nan. The value of the model does not depend on that, but every derivative does, through
0 * nan. The active branch, too, is evaluated slightly beyond its guard: by stages of a step that is later rejected, by
Newton iterates, and while the end of the branch is located.

Inside a branch, `f(q)` is therefore kept where `q` is in the domain of `f` or the guard holds at the point itself,
whatever the mode of the relation, and replaced by an extension of `f` elsewhere. Recorded points satisfy their guards.
Hence no value of a result is an extension, and a branch that leaves its domain although its guard holds is nan, as it
would be without extensions.

A node in several branches has one image, extended where none of their guards holds, so that a model grows by a constant
factor, however deeply branches are nested. A node that is also needed outside branches is not changed. Neither is a
branch whose guard is computed from variables that are defined later, after a mode has cut a cycle of definitions.

A power or a root of an expression that is zero over a range, such as `maximum(f, 0.0)**1.3`, is defined there, but its
second derivative is infinity times zero. There it is replaced by the constant zero. Such an expression is a maximum or
minimum with zero, or a branch that is zero; it may also be a factor, or the definition of a variable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from acausal.flatten.pool import LEAVES, RELATIONS, Pool

_OPPOSITE = {"lt": "ge", "le": "gt", "gt": "le", "ge": "lt"}
_STRICT = {"lt": "lt", "le": "lt", "gt": "gt", "ge": "gt"}
_LARGEST_EXPONENT = 600.0  # exp(600) is 4e260, and the exponentials are extended from there on
_TINY = 1e-100
_PARTIAL = frozenset(("pow", "sqrt", "log", "asin", "acos", "div", "exp", "sinh", "cosh", "atan2"))
_MODE_NODES = frozenset((*RELATIONS, "pre"))  # modes are identified by these nodes, inside and outside branches


class _Guard(NamedTuple):
    """Nodes that are true where a branch is active: `loose` includes points where its relations are equalities.

    A function that is continuous up to the end of its domain but has no derivative there, such as the root, is extended
    from that end on, and therefore needs `strict`.
    """

    loose: int
    strict: int


def guarded(
    pool: Pool,
    roots: Iterable[int],
    done: dict[int, int],
    discrete: Mapping[int, int],
    definitions: Sequence[tuple[int, int]],
    above: Iterable[int] = (),
) -> dict[int, int]:
    """Images of those branches, powers and roots below `roots` that contain partially defined functions.

    `done` has images of other nodes and receives those of all nodes below; `discrete` maps discrete variables to their
    definitions, `definitions` lists those of other variables in the order of evaluation. `above` are nodes whose images
    in `done` may contain such nodes.
    """
    roots = list(roots)
    numbers = [n for n in pool.reachable(roots) if pool.nodes[n][0] in ("where", "pow", "sqrt")]
    if not numbers:
        return {}
    numbers += above
    roots += [node for _, node in definitions]
    pool.rewrite(roots, pool.var, done)
    numbers = [n for n in numbers if n in done]  # others are needed only below nodes that already have an image
    extended = _Extensions(pool, discrete, definitions)
    if not any(extended.concerns(done[n]) for n in numbers):
        return {}
    first = {done[node]: k for k, (_, node) in reversed(list(enumerate(definitions)))}
    images = extended.images({done[r]: first.get(done[r], len(definitions)) for r in roots})
    return {n: images[done[n]] for n in numbers if images.get(done[n], done[n]) != done[n]}


class _Extensions:
    """Images of nodes, which depend on the branches that need them."""

    def __init__(self, pool: Pool, discrete: Mapping[int, int], definitions: Sequence[tuple[int, int]]) -> None:
        self.pool = pool
        self.discrete = discrete
        self.position = {v: k for k, (v, _) in enumerate(definitions)}  # in the order of evaluation
        self.defined = dict(definitions)
        self._at_rest: dict[int, bool] = {}
        self._is_partial: dict[int, bool] = {}
        self._guards: dict[tuple[int, bool, bool], int] = {}
        self._latest: dict[int, int] = {}

    def concerns(self, number: int) -> bool:
        """Whether a node may need an image: a branch with partial functions, or a clamped power or root."""
        op, *operands = self.pool.nodes[number]
        if op == "where":
            return any(self._has_partial(n) for n in operands[1:])
        return op in ("pow", "sqrt") and self._is_clamped(op, operands)

    def images(self, roots: Mapping[int, int]) -> dict[int, int]:
        """Images of all nodes below `roots`, a map from root to its position in the order of evaluation."""
        pool, nodes = self.pool, self.pool.nodes
        nodes_below = pool.reachable(roots)
        guards = self._required_guards(nodes_below, roots)
        done: dict[int, int] = {}
        for number in nodes_below:
            op, *operands = nodes[number]
            if op in LEAVES or not self._has_partial(number):
                done[number] = number
                continue
            operand_images = [done[n] for n in operands]
            guard = guards.get(number)
            if op in ("pow", "sqrt") and self._is_clamped(op, operands):
                done[number] = _clamped(pool, op, operand_images)
            elif guard is not None and op in _PARTIAL and self._may_fail(op, operands):
                done[number] = extended(pool, op, operand_images, guard)
            else:
                done[number] = number if operand_images == operands else pool.make(op, *operand_images)
        return done

    def _required_guards(self, nodes_below: Sequence[int], roots: Mapping[int, int]) -> dict[int, _Guard | None]:
        """Guard under which each node is needed; None for always."""
        nodes = self.pool.nodes
        needed: dict[int, _Guard | None] = dict.fromkeys(roots)
        earliest = dict(roots)  # position of the first definition that needs a node
        for number in reversed(
            nodes_below
        ):  # operands have smaller numbers, so every use of a node is visited before it
            op, *operands = nodes[number]
            if op in LEAVES or not self._has_partial(number):
                continue
            here, guard = earliest[number], needed[number]
            if guard is not None and self._known_from(guard) >= here:
                guard = needed[number] = None
            if op == "where":
                operand_guards = [
                    None,
                    self._branch(guard, operands[0], True, here),
                    self._branch(guard, operands[0], False, here),
                ]
            else:
                operand_guards = [None if op in _MODE_NODES else guard] * len(operands)
            for operand, new in zip(operands, operand_guards, strict=True):
                if operand not in needed:
                    needed[operand], earliest[operand] = new, here
                else:
                    needed[operand] = self._either(needed[operand], new)
                    earliest[operand] = min(earliest[operand], here)
        return needed

    def _branch(self, outer: _Guard | None, condition: int, holds: bool, here: int) -> _Guard | None:
        """Guard of a nested branch; the outer guard alone if the condition is not yet computed at position `here`."""
        guard = _Guard(self._at_this_point(condition, holds, False), self._at_this_point(condition, holds, True))
        if self._known_from(guard) >= here:
            return outer
        if outer is None:
            return guard
        return _Guard(*(x if x == y else self.pool.make("and", x, y) for x, y in zip(outer, guard, strict=True)))

    def _either(self, a: _Guard | None, b: _Guard | None) -> _Guard | None:
        if a is None or b is None or a == b:
            return None if a is None or b is None else a
        return _Guard(*(self.pool.make("or", x, y) for x, y in zip(a, b, strict=True)))

    def _known_from(self, guard: _Guard) -> int:
        """Position of the last definition that a guard depends on; -1 if it depends on none."""
        latest = self._latest
        for number in self.pool.reachable(guard, latest):
            op, *operands = self.pool.nodes[number]
            if op == "var":
                latest[number] = self.position.get(operands[0], -1)
            else:
                latest[number] = -1 if op in LEAVES else max((latest[n] for n in operands), default=-1)
        return max(latest[n] for n in guard)

    def _has_partial(self, root: int) -> bool:
        """Whether a node contains a partially defined function."""
        is_partial = self._is_partial
        for number in () if root in is_partial else self.pool.reachable([root], is_partial):
            op, *operands = self.pool.nodes[number]
            below = op not in LEAVES and any(is_partial[c] for c in operands)
            is_partial[number] = below or (op in _PARTIAL and self._may_fail(op, operands))
        return is_partial[root]

    def _is_clamped(self, op: str, operands: Sequence[int]) -> bool:
        """Whether this is a power or root without second derivative at zero, of an expression that may rest there."""
        if op == "pow" and (exponent := self.pool.value(operands[1])) is not None:
            may = 0.0 < exponent < 2.0 and exponent != 1.0
        else:
            may = op == "sqrt" or self._is_constant(operands[1])
        return may and self._may_rest(operands[0])

    def _is_constant(self, root: int) -> bool:
        """Whether a node depends on parameters alone."""
        nodes = self.pool.nodes
        return all(
            nodes[n][0] in ("const", "par") or (nodes[n][0] not in LEAVES and nodes[n][0] not in _MODE_NODES)
            for n in self.pool.reachable([root])
        )

    def _may_rest(self, root: int) -> bool:
        """Whether a node may be exactly zero over a range of its variables: `maximum(x, 0)`, an inactive branch."""
        pool, at_rest = self.pool, self._at_rest
        stack = [root]
        while stack:
            number = stack[-1]
            op, *operands = pool.nodes[number]
            if op == "var":
                operands = [self.defined[operands[0]]] if operands[0] in self.defined else []
            elif op == "where":
                operands = operands[1:]
            elif op in ("pow", "div"):
                operands = operands[:1]
            elif op not in ("max", "min", "mul", "sqrt", "noevent"):
                at_rest[number] = op == "fabs" or pool.value(number) == 0.0
                stack.pop()
                continue
            if missing := [n for n in operands if n not in at_rest]:
                at_rest[number] = False  # for a cyclic definition
                stack += missing
                continue
            both = op in ("max", "min") and pool.zero not in operands
            at_rest[number] = (all if both else any)(at_rest[n] for n in operands)
            stack.pop()
        return at_rest[root]

    def _may_fail(self, op: str, operands: list[int]) -> bool:
        pool = self.pool
        if op == "div":
            return pool.nodes[operands[1]][0] not in ("const", "par")
        if op == "pow":
            base, exponent = (pool.value(n) for n in operands)
            return base is None and not (exponent is not None and exponent >= 0.0 and exponent == round(exponent))
        return True

    def _at_this_point(self, condition: int, holds: bool, strict: bool) -> int:
        """A condition, or its negation, evaluated at the point itself and not by modes."""
        key = condition, holds, strict
        if key not in self._guards:
            self._guards[key] = self._build_at_this_point(condition, holds, strict)
        return self._guards[key]

    def _build_at_this_point(self, condition: int, holds: bool, strict: bool) -> int:
        pool = self.pool
        op, *operands = pool.nodes[condition]
        if op in RELATIONS:
            op = op if holds else _OPPOSITE[op]
            relation = pool.make(_STRICT[op] if strict else op, *(pool.make("noevent", n) for n in operands))
            # `noevent` around the operands distinguishes it from the relation of the mode.
            return pool.make("noevent", relation)
        if op == "not":
            return self._at_this_point(operands[0], not holds, strict)
        if op in ("and", "or"):
            parts = [self._at_this_point(n, holds, strict) for n in operands]
            return pool.make(op if holds else {"and": "or", "or": "and"}[op], *parts)
        if op == "noevent":
            return self._at_this_point(operands[0], holds, strict)
        if op == "var" and operands[0] in self.discrete:
            node = self.discrete[operands[0]]
            if pool.nodes[node][0] in (*RELATIONS, "and", "or", "not"):
                return self._at_this_point(node, holds, strict)
        return condition if holds else pool.make("not", condition)


def extended(pool: Pool, op: str, q: list[int], guard: _Guard | None = None) -> int:
    """`op` of `q` in its domain or under a guard, else its extension; each is finite where the other applies."""
    domain, instead, beyond, ends = _EXTENSIONS[op](pool, q)
    allowed = domain
    if guard is not None:
        allowed = pool.make("noevent", pool.make("or", domain, guard.strict if ends else guard.loose))
    inside = [n if s is None else pool.where(allowed, n, s) for n, s in zip(q, instead, strict=True)]
    return pool.where(allowed, pool.make(op, *inside), beyond)


def _clamped(pool: Pool, op: str, q: list[int]) -> int:
    """A power or root, replaced by the constant zero at zero if its exponent is positive; nan stays nan."""
    clamped = pool.nodes[q[0]][0] == "max" and pool.zero in pool.nodes[q[0]][1:]
    at_zero = _test(pool, "le", q[0] if clamped else pool.make("fabs", q[0]), 0.0)
    if op == "pow" and pool.value(q[1]) is None:
        at_zero = pool.make("and", at_zero, _test(pool, "gt", q[1], 0.0))
    return pool.where(at_zero, pool.zero, pool.make(op, pool.where(at_zero, pool.one, q[0]), *q[1:]))


_Extension = tuple[int, list[int | None], int, bool]
"""(Condition of the domain, substitutes of the operands elsewhere or None for unchanged, value elsewhere, whether the
function is continuous up to the end of its domain)."""


def _test(pool: Pool, op: str, a: int, b: float) -> int:
    return pool.make("noevent", pool.make(op, pool.make("noevent", a), pool.const(b)))


def _size(pool: Pool, a: int, least: float) -> int:
    return pool.make("max", pool.make("fabs", a), pool.const(least))


def _power(pool: Pool, q: list[int]) -> _Extension:
    """Odd extension: x |x|^(n-1) has a continuous derivative for n > 1, and increases with x for every n > 0."""
    base, exponent = q
    n = pool.value(exponent)
    odd = pool.mul(base, pool.make("pow", _size(pool, base, _TINY), pool.sub(exponent, pool.one)))
    is_integer = n is not None and n == round(n)  # negative, as other integer powers are total
    defined = _test(pool, "gt", pool.make("fabs", base) if is_integer else base, _TINY if n is None or n < 0.0 else 0.0)
    return defined, [pool.one, None], odd, n is not None and n > 0.0


def _root(pool: Pool, q: list[int]) -> _Extension:
    odd = pool.div(q[0], pool.make("sqrt", _size(pool, q[0], _TINY)))
    return _test(pool, "gt", q[0], 0.0), [pool.one], odd, True


def _logarithm(pool: Pool, q: list[int]) -> _Extension:
    return _test(pool, "gt", q[0], 0.0), [pool.one], pool.make("log", _size(pool, q[0], _TINY)), False


def _arc(op: str) -> Callable[[Pool, list[int]], _Extension]:
    """Extension by straight lines: a guard that is constant on both sides of a narrow domain would not show it."""

    def extension(pool: Pool, q: list[int]) -> _Extension:
        lines = []
        for end in (1.0, -1.0):
            beyond = pool.sub(q[0], pool.const(end))
            lines.append(pool.make("add" if op == "asin" else "sub", pool.make(op, pool.const(end)), beyond))
        beyond = pool.where(_test(pool, "gt", q[0], 0.0), *lines)
        return _test(pool, "lt", pool.make("fabs", q[0]), 1.0), [pool.zero], beyond, True

    return extension


def _quotient(pool: Pool, q: list[int]) -> _Extension:
    return _test(pool, "gt", pool.make("fabs", q[1]), _TINY), [None, pool.one], pool.zero, False


def _exponential(op: str) -> Callable[[Pool, list[int]], _Extension]:
    """Extension by the tangent at the largest exponent, which keeps the sign of the slope for Newton's method."""

    def extension(pool: Pool, q: list[int]) -> _Extension:
        size = q[0] if op == "exp" else pool.make("fabs", q[0])
        last = pool.make("exp", pool.const(_LARGEST_EXPONENT))
        line = pool.mul(last, pool.add(pool.one, pool.sub(size, pool.const(_LARGEST_EXPONENT))))
        if op == "sinh":
            line = pool.mul(pool.make("sign", q[0]), line)
        return _test(pool, "lt", size, _LARGEST_EXPONENT), [pool.zero], line, False

    return extension


def _angle(pool: Pool, q: list[int]) -> _Extension:
    size = pool.add(*(pool.make("fabs", n) for n in q))
    return _test(pool, "gt", size, _TINY), [None, pool.one], pool.zero, False


_EXTENSIONS: dict[str, Callable[[Pool, list[int]], _Extension]] = {
    "pow": _power,
    "sqrt": _root,
    "log": _logarithm,
    "asin": _arc("asin"),
    "acos": _arc("acos"),
    "div": _quotient,
    "exp": _exponential("exp"),
    "sinh": _exponential("sinh"),
    "cosh": _exponential("cosh"),
    "atan2": _angle,
}
