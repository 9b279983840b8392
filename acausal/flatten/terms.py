"""Long sums as lists of terms: a chain of a thousand additions has a thousand partial sums, which nobody needs."""

from __future__ import annotations

from heapq import heappop, heappush

from acausal.flatten.pool import Pool

SUMS = frozenset(("add", "sub"))
LONG = 24


def is_long(pool: Pool, root: int) -> bool:
    """True where a sum is a chain of more than two dozen additions, however their operands are ordered."""
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
    """Terms of a sum, each once with the whole number of times it counts, in the order in which they were made.

    Operands are older than what is made of them, so that the youngest is always complete: the cost is that of sorting,
    also where partial sums are shared.
    """
    nodes = pool.nodes
    weight = {root: 1}
    waiting = [-root]
    found: list[tuple[int, int]] = []
    while waiting:
        number = -heappop(waiting)
        times = weight.pop(number)
        op, *operands = nodes[number]
        if op not in SUMS and op != "neg":
            if times:
                found.append((number, times))
            continue
        for k, operand in enumerate(operands):
            signed = -times if op == "neg" or (op == "sub" and k == 1) else times
            if operand in weight:
                weight[operand] += signed
            else:
                weight[operand] = signed
                heappush(waiting, -operand)
    return found[::-1]
