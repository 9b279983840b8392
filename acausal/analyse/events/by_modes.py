"""Kinks as branches on the relations that tell their sides.

`maximum(x, 0)` has one slope on each side, and at x = 1e-17 perhaps that of the wrong one: whoever differentiates a
stretch that begins or ends at a kink takes the side from the mode.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from acausal.flatten.pool import LEAVES, RELATIONS, Pool

KINKS = frozenset(("max", "min", "fabs"))
_PARTIAL = frozenset(("pow", "sqrt", "log", "asin", "acos", "div"))


def by_modes(
    pool: Pool,
    roots: Sequence[int],
    definitions: Mapping[int, int],
    located: Collection[int],
    watched: Iterable[int],
    rewritten: dict[int, int],
) -> dict[int, int]:
    """The kinks below some roots, and relations below `no_event`, by the nodes that stand for them.

    `located` are relations of the equations, `watched` those of kinks (`sleeping.py`), `rewritten` nodes by what stands
    for them already. Kinks that keep a root, a power or a quotient defined stay as they are.
    """
    keeping = _keeping(pool, roots, definitions)
    own, done, found = set(watched), dict(rewritten), dict[int, int]()
    done |= {n: n for n in own}  # nodes of their own, which modes are known by
    known = sides(pool, (*located, *own))
    pool.rewrite(located, pool.var, done)
    for number in pool.reachable(roots):
        if number in rewritten or number in own or number in keeping or number in located:
            continue
        told = teller(pool, number, known)
        if told is None:
            continue
        relation, holds = told
        truth = done[relation] if holds else pool.make("not", done[relation])
        op, *operands = pool.nodes[number]
        if op in KINKS:
            pool.rewrite(operands, pool.var, done)
            u, *rest = (done[n] for n in operands)
            v = rest[0] if rest else pool.neg(u)
            truth = pool.where(truth, *((v, u) if op == "min" else (u, v)))
        found[number] = done[number] = truth
    return found


Sides = dict[tuple[int, int], tuple[int, bool]]


def sides(pool: Pool, relations: Iterable[int]) -> Sides:
    """Of two nodes the relation that tells whether the first is larger, and whether this holds where it is true."""
    found: Sides = {}
    for number in relations:
        op, *operands = pool.nodes[number]
        # a < b is b > a, and a <= b is not a > b
        key = _compared(pool, *(operands if op in ("gt", "le") else reversed(operands)))
        found.setdefault(key, (number, op in ("gt", "lt")))
    return found


def teller(pool: Pool, number: int, known: Sides) -> tuple[int, bool] | None:
    """A relation that tells which operand of a kink is larger, or whether a relation holds, if it is true, or false."""
    op, *operands = pool.nodes[number]
    if op not in KINKS and op not in RELATIONS:
        return None
    a, b = operands if len(operands) == 2 else (operands[0], pool.zero)
    if op in RELATIONS:
        told = known.get(_compared(pool, *((a, b) if op in ("gt", "le") else (b, a))))
        return told if told is None or op in ("gt", "lt") else (told[0], not told[1])
    told, other = known.get(_compared(pool, a, b)), known.get(_compared(pool, b, a))
    return told if told is not None or other is None else (other[0], not other[1])


def _keeping(pool: Pool, roots: Sequence[int], definitions: Mapping[int, int]) -> set[int]:
    """What arguments of functions depend on that are not defined everywhere, and conditions of such functions."""
    stack, partial = [], set[int]()
    for number in pool.reachable(roots):  # operands come before
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
    found: set[int] = set()
    while stack:
        below = pool.reachable([stack.pop()], found)
        found.update(below)
        variables = (pool.nodes[n][1] for n in below if pool.nodes[n][0] == "var")
        stack += [definitions[v] for v in variables if v in definitions and definitions[v] not in found]
    return found


def _is_total(pool: Pool, op: str, last: int) -> bool:
    """Whether a whole power, or a quotient by a number, is defined wherever its other operand is."""
    kind, *rest = pool.nodes[last]
    if op == "pow":
        return kind == "const" and float(rest[0]).is_integer() and float(rest[0]) >= 0.0
    return op == "div" and kind in ("const", "par")


def _compared(pool: Pool, a: int, b: int) -> tuple[int, int]:
    """Two nodes that are compared; a - b and zero are a and b."""
    a, b = (pool.nodes[n][1] if pool.nodes[n][0] == "noevent" else n for n in (a, b))
    for n, other in ((a, b), (b, a)):
        if other == pool.zero and pool.nodes[n][0] == "sub":
            x, y = pool.nodes[n][1:]
            return (x, y) if n == a else (y, x)
    return a, b
