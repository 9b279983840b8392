"""What expressions cost in a run, where parameters are numbers: those that are zero take their products with them."""

from __future__ import annotations

from collections.abc import Iterable

from acausal.flatten.pool import LEAVES
from acausal.numeric.samples import SamplePoints


def operations(points: SamplePoints, roots: Iterable[int]) -> int:
    """Number of operations below `roots` that depend on variables or time and are not trivial because of a zero."""
    pool = points.reduced.pool
    nodes = pool.nodes
    zero: set[int] = set()
    varying: set[int] = set()
    count = 0
    for number in pool.reachable(roots):
        op, *below = nodes[number]
        if op in LEAVES:
            value = below[0] if op == "const" else points.parameters[below[0]] if op == "par" else None
            if value == 0.0:
                zero.add(number)
            elif value is None:
                varying.add(number)
            continue
        gone = [b in zero for b in below]
        if (op in ("mul", "div") and (gone[0] or (op == "mul" and gone[1]))) or (op in _SUMS and all(gone)):
            zero.add(number)
        elif any(b in varying for b in below):
            varying.add(number)
            count += op not in ("add", "sub") or not any(gone)
    return count


_SUMS = ("add", "sub", "neg")
