"""Kinks as branches on the relations that tell their sides.

`maximum(x, 0)` has one slope on each side, and at x = 1e-17 perhaps that of the wrong one: whoever differentiates a
stretch that begins or ends at a kink takes the side from the mode.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from acausal.flatten.pool import RELATIONS, Pool

_KINKS = frozenset(("max", "min", "fabs"))
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
    done, found = dict(rewritten), dict[int, int]()
    larger: dict[tuple[int, int], int] = {}
    for relations, is_watched in ((located, False), (watched, True)):
        for number in relations:
            op, *sides = pool.nodes[number]
            if is_watched:
                done[number] = number
            else:
                pool.rewrite([number], pool.var, done)
            # a < b is b > a, and a <= b is not a > b
            key = compared(pool, *(sides if op in ("gt", "le") else reversed(sides)))
            larger.setdefault(key, done[number] if op in ("gt", "lt") else pool.make("not", done[number]))
    own = {n for n in larger.values()}
    for number in pool.reachable(roots):
        op, *operands = pool.nodes[number]
        if number in rewritten or number in own or number in keeping or not (op in _KINKS or op in RELATIONS):
            continue
        a, b = operands if len(operands) == 2 else (operands[0], pool.zero)
        is_larger = larger.get(compared(pool, a, b))
        if is_larger is None and op in _KINKS and compared(pool, b, a) in larger:
            is_larger = pool.make("not", larger[compared(pool, b, a)])
        if op in RELATIONS:
            image = _relation(pool, op, (a, b), larger) if number not in located else None
        elif is_larger is None:
            image = None
        else:
            pool.rewrite([a, b], pool.var, done)
            u, v = (done[b], done[a]) if op == "min" else (done[a], done[b] if op == "max" else pool.neg(done[a]))
            image = pool.where(is_larger, u, v)
        if image is not None:
            found[number] = done[number] = image
    return found


def _keeping(pool: Pool, roots: Sequence[int], definitions: Mapping[int, int]) -> set[int]:
    """Nodes that arguments of functions depend on which are not defined everywhere."""
    stack = []
    for number in pool.reachable(roots):
        op, *operands = pool.nodes[number]
        if op in _PARTIAL and not (op == "pow" and _is_whole(pool, operands[1])):
            stack.append(operands[1] if op == "div" else operands[0])
    found: set[int] = set()
    while stack:
        below = pool.reachable([stack.pop()], found)
        found.update(below)
        variables = (pool.nodes[n][1] for n in below if pool.nodes[n][0] == "var")
        stack += [definitions[v] for v in variables if v in definitions and definitions[v] not in found]
    return found


def _is_whole(pool: Pool, number: int) -> bool:
    node = pool.nodes[number]
    return node[0] == "const" and float(node[1]).is_integer() and float(node[1]) >= 0.0


def compared(pool: Pool, a: int, b: int) -> tuple[int, int]:
    """Two nodes that are compared; a - b and zero are a and b."""
    a, b = (pool.nodes[n][1] if pool.nodes[n][0] == "noevent" else n for n in (a, b))
    for n, other in ((a, b), (b, a)):
        if other == pool.zero and pool.nodes[n][0] == "sub":
            x, y = pool.nodes[n][1:]
            return (x, y) if n == a else (y, x)
    return a, b


def _relation(pool: Pool, op: str, sides: tuple[int, int], larger: dict[tuple[int, int], int]) -> int | None:
    """The same relation by a mode, where there is one of these sides."""
    is_larger = larger.get(compared(pool, *(sides if op in ("gt", "le") else reversed(sides))))
    if is_larger is None:
        return None
    return is_larger if op in ("gt", "lt") else pool.make("not", is_larger)
