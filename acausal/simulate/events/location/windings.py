"""Relations that may come and go between points at which they look smooth: polynomials of a high degree.

The cubics of compiled loops and the parabolas of a search show polynomials up to the third degree. A kink counts as a
square. Those of a higher degree have all of their zeros where one of their factors is small.
"""

from __future__ import annotations

import math

from acausal.simulate.events.location.guard_graph import GuardGraph

WINDING, FACTOR = "winding", "factor"
"""Operations of a relation of a high degree, with itself and its sides as operands, and of a factor in it."""
# The degree up to which polynomials show relations, and the most factors of one whose zeros are sampled.
_MOST_DEGREE, _MOST_FACTORS = 3, 16


def windings(graph: GuardGraph) -> list[tuple[str, tuple[int, ...]]]:
    """Relations of a high degree on which no rate depends, and their factors: operations and operands."""
    degrees, factors = dict[int, int](), dict[int, set[int]]()
    found: dict[tuple[str, tuple[int, ...]], None] = {}
    for n in graph.in_order(sorted(graph.guarded)):
        inner = graph.operands(n)
        of, within = [degrees.get(k, 0) for k in inner], set[int]().union(*(factors.get(k, ()) for k in inner))
        if n in graph.relations:
            if max(of) > _MOST_DEGREE:
                found[WINDING, (n, *inner)] = None
                found |= {(FACTOR, (k,)): None for k in within if len(within) <= _MOST_FACTORS}
        elif n in graph.moving:
            degrees[n] = 1 if n in graph.effective or not inner else _degree(graph, n, of)
            factors[n] = within if degrees[n] == 1 else within.union(_factors(graph, n, of))
    return list(found)


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
