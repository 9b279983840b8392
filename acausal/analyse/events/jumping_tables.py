"""Tables that jump: the segment becomes a number that changes at located events only.

The slope of a table of straight segments is a table of steps, that of a cubic with one continuous derivative jumps in
its second derivative. Where such a table is one search (`acausal.lookup`) and no tree of relations, nothing in the
equations would tell of its jumps: a multistep method passes a whole segment in one step, since all rates before and
after are constant.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from acausal.analyse.events.time_events import is_of_time
from acausal.flatten.pool import LEAVES, RELATIONS, Pool, closure
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup, lookup

_CONSTANT = frozenset(("floor", "ceil", "sign", "pre", "sample", "initial", "terminal", "infinitesimal", *RELATIONS))
"""Operations whose values change at events only."""


def jumping_tables(pool: Pool, numbers: Iterable[int], definitions: Mapping[int, int]) -> dict[int, Lookup]:
    """The table that each of these nodes reads, where it jumps and its argument moves between events.

    Tables of time itself are left out: runs stop at their segments, or bound their steps by them, and make no event
    (`acausal.simulate.equations.kinks`), as a measured speed has thousands of rows. `definitions` maps variables to
    nodes.
    """
    read = {n: pool.nodes[n] for n in numbers if isinstance(pool.nodes[n][0], Call)}
    found = {n: (op.external, operands[0]) for n, (op, *operands) in read.items() if isinstance(op.external, Lookup)}
    return {
        n: table
        for n, (table, argument) in found.items()
        if table.has_jumps and _moves(pool, argument) and not is_of_time(pool, argument, definitions)
    }


def _moves(pool: Pool, root: int) -> bool:
    """Whether a node changes between events; discrete variables count as moving."""
    nodes, ends = pool.nodes, LEAVES | _CONSTANT
    below = closure([root], lambda n: () if nodes[n][0] in ends else nodes[n][1:])
    return any(nodes[n][0] in ("var", "time") for n in below)


def on_segment(pool: Pool, table: Lookup, argument: int, segment: int) -> int:
    """The node of the polynomial of a table on a given segment, by Horner's scheme."""
    entry = pool.add(segment, pool.const(0.5))  # amid the steps, where rounding chooses no neighbour
    columns = list(np.array(table.coefficients, dtype=float).T)
    value = _by_number(pool, columns[-1].tolist(), entry)
    distance = pool.sub(argument, _by_number(pool, table.breaks[:-1], entry)) if len(columns) > 1 else pool.zero
    for column in columns[-2::-1]:
        value = pool.add(_by_number(pool, column.tolist(), entry), pool.mul(distance, value))
    return value


def _by_number(pool: Pool, values: list[float] | tuple[float, ...], entry: int) -> int:
    steps = lookup([float(k) for k in range(len(values) + 1)], [(v,) for v in values], "step")
    return pool.make(Call(steps, 0), entry)
