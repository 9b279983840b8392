"""Long sums as lists of terms, without the partial sums of a chain of additions."""

from __future__ import annotations

from heapq import heappop, heappush

from acausal.flatten.pool import Pool

SUMS = frozenset(("add", "sub"))
LONG = 24


def is_long(pool: Pool, root: int) -> bool:
    """True for a chain of more than `LONG` additions, in any order of operands."""
    nodes = pool.nodes
    for _ in range(LONG):
        _, a, b = nodes[root]
        if nodes[a][0] in SUMS:
            root = a
        elif nodes[b][0] in SUMS:
            root = b
        else:
            return False
    return True


def terms(pool: Pool, root: int) -> list[tuple[int, int]]:
    """(Term, integer factor) of each term of a sum, by ascending number of the node.

    Operands have smaller numbers than the nodes that contain them, so the factor of the largest pending number is
    final. The cost is that of sorting, even if partial sums are shared.
    """
    nodes = pool.nodes
    weight = {root: 1}
    pending = [-root]
    result: list[tuple[int, int]] = []
    while pending:
        number = -heappop(pending)
        times = weight.pop(number)
        op, *operands = nodes[number]
        if op not in SUMS and op != "neg":
            if times:
                result.append((number, times))
            continue
        for k, operand in enumerate(operands):
            signed = -times if op == "neg" or (op == "sub" and k == 1) else times
            if operand in weight:
                weight[operand] += signed
            else:
                weight[operand] = signed
                heappush(pending, -operand)
    return result[::-1]
