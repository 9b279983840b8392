"""Tables that jump: the number of the active segment becomes a quantity that changes at located events only.

The slope of a table of straight segments is a table of steps, and the second derivative of a cubic with one continuous
derivative jumps. Such a table is one search (`acausal.lookup`) instead of a tree of relations, so that the equations
themselves do not show its jumps: a multistep method would pass a whole segment in one step, because all rates before
and after it are constant.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from acausal.analyse.events.time_events import is_of_time
from acausal.flatten.pool import LEAVES, RELATIONS, Pool, closure
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup, lookup

_PIECEWISE_CONSTANT = frozenset(
    ("floor", "ceil", "sign", "pre", "sample", "initial", "after_reset", "terminal", "infinitesimal", *RELATIONS)
)
"""Operations whose values change at events only."""


def jumping_tables(pool: Pool, numbers: Iterable[int], definitions: Mapping[int, int]) -> dict[int, Lookup]:
    """Maps those of the nodes that read a table which jumps, at an argument that varies between events, to the table.

    Tables of time itself are left out: a measured speed has thousands of rows, so that runs stop at the segments, or
    bound their steps by them, without an event (`acausal.simulate.equations.kinks`). `definitions` maps variables to
    nodes.
    """
    read = {n: pool.nodes[n] for n in numbers if isinstance(pool.nodes[n][0], Call)}
    reads = {n: (op.external, operands[0]) for n, (op, *operands) in read.items() if isinstance(op.external, Lookup)}
    return {
        n: table
        for n, (table, argument) in reads.items()
        if table.has_jumps and _moves(pool, argument) and not is_of_time(pool, argument, definitions)
    }


def _moves(pool: Pool, root: int) -> bool:
    """Whether a node varies between events; discrete variables count as varying."""
    nodes, ends = pool.nodes, LEAVES | _PIECEWISE_CONSTANT
    below = closure([root], lambda n: () if nodes[n][0] in ends else nodes[n][1:])
    return any(nodes[n][0] in ("var", "time") for n in below)


def on_segment(pool: Pool, table: Lookup, argument: int, segment: int) -> int:
    """The node of the polynomial of a table on a given segment, by Horner's scheme."""
    index = pool.add(segment, pool.const(0.5))  # the middle of a step, so that rounding selects no neighbour
    columns = list(np.array(table.coefficients, dtype=float).T)
    value = _by_number(pool, columns[-1].tolist(), index)
    distance = pool.sub(argument, _by_number(pool, table.breaks[:-1], index)) if len(columns) > 1 else pool.zero
    for column in columns[-2::-1]:
        value = pool.add(_by_number(pool, column.tolist(), index), pool.mul(distance, value))
    return value


def _by_number(pool: Pool, values: list[float] | tuple[float, ...], index: int) -> int:
    steps = lookup([float(k) for k in range(len(values) + 1)], [(v,) for v in values], "step")
    return pool.make(Call(steps, 0), index)
