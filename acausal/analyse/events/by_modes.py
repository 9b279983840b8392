"""Kinks as branches on the relations that decide their side.

`maximum(x, 0)` has a different slope on each side, and at x = 1e-17 its derivative may be that of the wrong side. A
caller that differentiates over a stretch which begins or ends at a kink therefore takes the side from the mode of a
relation.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from acausal.analyse.domains.partial_relations import Existence
from acausal.flatten.pool import LEAVES, RELATIONS, Pool

KINKS = frozenset(("max", "min", "fabs"))
_PARTIAL = frozenset(("pow", "sqrt", "log", "asin", "acos", "div"))


def by_modes(
    pool: Pool,
    roots: Sequence[int],
    existence: Existence,
    located: Collection[int],
    watched: Iterable[int],
    rewritten: dict[int, int],
) -> dict[int, int]:
    """Maps kinks below `roots`, and relations below `no_event`, to branches on relations.

    `located` are relations of the equations, `watched` those of kinks (`located_kinks.py`); `rewritten` maps nodes to
    their replacements so far. Kinks that keep the argument of a root, power or quotient in its domain stay unchanged.
    """
    domain_conditions = _domain_conditions(pool, roots, existence.defined)
    watched_set, done, branches = set(watched), dict(rewritten), dict[int, int]()
    done |= {n: n for n in watched_set}  # modes are identified by these nodes
    side_of = sides(pool, (*located, *watched_set))
    pool.rewrite(located, pool.var, done)
    for number in pool.reachable(roots):
        if number in rewritten or number in watched_set or number in domain_conditions or number in located:
            continue
        op, *operands = pool.nodes[number]
        parts = existence.relations(number) if op in RELATIONS else [number]
        modes = dict[int, int]()
        for part in parts:
            decision = deciding_relation(pool, part, side_of)
            if decision is not None:
                relation, holds = decision
                modes[part] = done[relation] if holds else pool.make("not", done[relation])
        if len(modes) < len(parts):
            continue
        branch = modes[parts[-1]]
        if len(parts) > 1:
            exists, _ = existence.parts(number)
            pool.rewrite([exists], pool.var, modes)
            branch = pool.make("and", modes[exists], branch)
        if op in KINKS:
            pool.rewrite(operands, pool.var, done)
            u, *rest = (done[n] for n in operands)
            v = rest[0] if rest else pool.neg(u)
            branch = pool.where(branch, *((v, u) if op == "min" else (u, v)))
        branches[number] = done[number] = branch
    return branches


Sides = dict[tuple[int, int], tuple[int, bool]]


def sides(pool: Pool, relations: Iterable[int]) -> Sides:
    """Maps pairs of nodes (a, b) to (relation that decides a > b, whether a > b where that relation is true)."""
    deciding: Sides = {}
    for number in relations:
        op, *operands = pool.nodes[number]
        # a < b means b > a, and a <= b the negation of a > b
        key = _compared(pool, *(operands if op in ("gt", "le") else reversed(operands)))
        deciding.setdefault(key, (number, op in ("gt", "lt")))
    return deciding


def deciding_relation(pool: Pool, number: int, side_of: Sides) -> tuple[int, bool] | None:
    """(Relation that decides the side of a kink or the value of a relation, deciding value); None if there is none.

    With the deciding value, the first operand of a kink is larger (of `fabs`: positive), and a relation is true.
    """
    op, *operands = pool.nodes[number]
    if op not in KINKS and op not in RELATIONS:
        return None
    a, b = operands if len(operands) == 2 else (operands[0], pool.zero)
    if op in RELATIONS:
        decision = side_of.get(_compared(pool, *((a, b) if op in ("gt", "le") else (b, a))))
        return decision if decision is None or op in ("gt", "lt") else (decision[0], not decision[1])
    decision, other = side_of.get(_compared(pool, a, b)), side_of.get(_compared(pool, b, a))
    return decision if decision is not None or other is None else (other[0], not other[1])


def _domain_conditions(pool: Pool, roots: Sequence[int], definitions: Mapping[int, int]) -> set[int]:
    """Nodes that arguments of partially defined functions, and conditions of branches with these, depend on."""
    stack, partial = [], set[int]()
    for number in pool.reachable(roots):  # operands precede their functions
        op, *operands = pool.nodes[number]
        if op in LEAVES:
            continue
        if op in _PARTIAL and not _is_total(pool, op, operands[-1]):
            stack.append(operands[1] if op == "div" else operands[0])
            partial.add(number)
        elif not partial.isdisjoint(operands):
            partial.add(number)
            if op == "where":
                stack.append(operands[0])
    dependences: set[int] = set()
    while stack:
        below = pool.reachable([stack.pop()], dependences)
        dependences.update(below)
        variables = (pool.nodes[n][1] for n in below if pool.nodes[n][0] == "var")
        stack += [definitions[v] for v in variables if v in definitions and definitions[v] not in dependences]
    return dependences


def _is_total(pool: Pool, op: str, last: int) -> bool:
    """Whether an integer power, or a quotient by a constant, is defined wherever its other operand is."""
    kind, *rest = pool.nodes[last]
    if op == "pow":
        return kind == "const" and float(rest[0]).is_integer() and float(rest[0]) >= 0.0
    return op == "div" and kind in ("const", "par")


def _compared(pool: Pool, a: int, b: int) -> tuple[int, int]:
    """The two nodes that a relation compares: (a, b) also if it compares a - b with zero."""
    a, b = (pool.nodes[n][1] if pool.nodes[n][0] == "noevent" else n for n in (a, b))
    for n, other in ((a, b), (b, a)):
        if other == pool.zero and pool.nodes[n][0] == "sub":
            x, y = pool.nodes[n][1:]
            return (x, y) if n == a else (y, x)
    return a, b
