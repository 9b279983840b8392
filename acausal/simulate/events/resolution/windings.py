"""Relations that may come and go between points at which they look smooth: polynomials of a high degree.

The parabolas of a search show polynomials of the second degree. A kink counts as a square. Those of a higher degree
have all of their zeros where one of their factors is small.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Set

from acausal.language.expressions.external import Call
from acausal.simulate.events.resolution.guard_graph import GuardGraph

WINDING, FACTOR = "winding", "factor"
"""Operations of a relation of a high degree, with itself and its sides as operands, and of a factor in it."""
# The degree up to which polynomials show relations, and the most factors of one whose zeros are sampled.
_MOST_DEGREE, _MOST_FACTORS = 2, 16


def windings(graph: GuardGraph) -> dict[int, set[int]]:
    """Relations of a high degree that no rate shows as long as they do not hold, and the factors of each.

    Where external functions are behind a relation, rates show it as some relations hold: bounds of those functions
    would be too wide to exclude anything. So do kinks of rates, which are no events.
    """
    relations, watched = graph.compiled.state_events.relations, graph.compiled.state_events.watched
    shown = _opaque(graph).union(relations[k] for k in watched)
    hidden = {n: factors for n, factors in _wound(graph, graph.resolved).items() if n not in shown}
    return hidden | _wound(graph, graph.effective)


def sampled_operations(graph: GuardGraph, found: dict[int, set[int]]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """The operations and operands of some relations, and of their factors, unless there are too many to sample."""
    for n, factors in found.items():
        yield WINDING, (n, *graph.operands(n))
        if len(factors) <= _MOST_FACTORS:
            yield from ((FACTOR, (k,)) for k in sorted(factors))


def unsampled(found: dict[int, set[int]]) -> set[int]:
    """Relations with more factors than are sampled."""
    return {n for n, factors in found.items() if len(factors) > _MOST_FACTORS}


def _wound(graph: GuardGraph, shown: Set[int]) -> dict[int, set[int]]:
    """Relations of a high degree and their factors, where rates show the nodes `shown`."""
    degrees, factors, found = dict[int, int](), dict[int, set[int]](), dict[int, set[int]]()
    for n in graph.in_order(sorted(graph.guarded)):
        inner = graph.operands(n)
        of, within = [degrees.get(k, 0) for k in inner], set[int]().union(*(factors.get(k, ()) for k in inner))
        if n in graph.relations:
            if max(of) > _MOST_DEGREE:
                found[n] = within
        elif n in graph.moving:
            degrees[n] = 1 if n in shown or not inner else _degree(graph, n, of)
            factors[n] = within if degrees[n] == 1 else within.union(_factors(graph, n, of))
    return found


def _opaque(graph: GuardGraph) -> set[int]:
    """Nodes that depend on an external function."""
    found = set[int]()
    for n in graph.in_order(sorted(graph.guarded)):
        if isinstance(graph.pool.nodes[n][0], Call) or not found.isdisjoint(graph.operands(n)):
            found.add(n)
    return found


def _degree(graph: GuardGraph, n: int, of: list[int]) -> int:
    """The degree of a node, from those of its operands."""
    op, *operands = graph.pool.nodes[n]
    if op == "mul":
        return sum(of)
    if op == "div":
        return of[0] + 2 * of[1]
    if op == "pow":
        exponent = graph.pool.nodes[operands[1]]
        return math.ceil(abs(float(exponent[1]) if exponent[0] == "const" else 1.0) * of[0])
    if op in ("sin", "cos", "tan"):  # their phases are sampled
        return 1
    return (2 if op in ("fabs", "min", "max") else 1) * max(of)


def _factors(graph: GuardGraph, n: int, of: list[int]) -> list[int]:
    """The moving factors of a product, the base of a power, or the operand of `fabs`."""
    op, inner = graph.pool.nodes[n][0], graph.operands(n)
    if op == "mul":
        return list(inner) if all(of) else []
    return [inner[0]] if op in ("fabs", "pow") else []
