"""Long tables: where along them a run has to stop.

Read at `slope * (time - origin)`, with both free of variables, what they do is known before the run; where it matters
depends on the tolerance. Read at a variable, the number of the stretch that it is in says where.

What begins at the end of a stretch may be over before the next step ends. The number is the whole part of a broken line
(`floor`), so that two relations locate all ends of a table, however many and whichever way it is passed. It stands in
no equation: the rows stay one function there (`acausal.lookup`), as ten thousand relations would be as many modes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from acausal.analyse.events.time_events import affine_in_time
from acausal.flatten.pool import LEAVES, Pool
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup, lookup
from acausal.numeric.table_ends import stops, table_ends

# Share of a stretch, from either of its ends, in which its number has the slope of that end.
_NEAR = 0.25


def stretch_numbers(
    pool: Pool, roots: Iterable[int], definitions: Mapping[int, int], relative: float
) -> tuple[tuple[int, ...], int]:
    """The numbers of the stretches of all such tables below `roots`, for a run of this relative tolerance.

    And at how many ends no run stops, as they are one of very many.
    """
    found: dict[int, int] = {}
    seen: set[int] = set()
    stack = list(roots)
    while stack:
        number = stack.pop()
        op, *operands = pool.nodes[number]
        # what is below a whole part is constant between events
        if number in seen or op in LEAVES or op in ("floor", "ceil"):
            continue
        seen.add(number)
        stack += operands
        table = op.external if isinstance(op, Call) else None
        if not isinstance(table, Lookup) or is_of_time(pool, operands[0], definitions):
            continue
        ends = stops(table, relative).tolist() if len(table.coefficients[0]) > 1 else []
        if ends:
            place = _number(pool, operands[0], [table.breaks[0], *ends, table.breaks[-1]])
            found[place] = len(table_ends(table, relative)) - len(ends)
    return tuple(found), sum(found.values())


def _number(pool: Pool, argument: int, ends: list[float]) -> int:
    places = lookup(*_line(ends), "stretch")
    place = pool.make(Call(places, 0), argument)
    inside = pool.make("min", pool.make("max", place, pool.const(0.5)), pool.const(len(ends) - 1.5))
    return pool.make("floor", inside)


def _line(ends: list[float]) -> tuple[list[float], list[tuple[float, float]]]:
    """Breaks and rows of a broken line that is k at the end k, without a kink there.

    A run that stops at an end begins within rounding of it, on either side, and judges the relations by their rates:
    from 2e-4 to 10 s they fell by 50 000, so that a row was searched in ever smaller parts for what it might pass. So
    the slope at an end is that of the longer of its stretches, up to a quarter of the shorter one.
    """
    lengths = np.diff(ends)
    slopes = 1.0 / np.maximum(np.append(0.0, lengths), np.append(lengths, 0.0))
    breaks, rows = [ends[0]], list[tuple[float, float]]()
    for k, (a, b) in enumerate(pairwise(ends)):
        near = _NEAR * (b - a)
        left, right = k + near * slopes[k], k + 1.0 - near * slopes[k + 1]
        steep = (right - left) / (b - a - 2.0 * near)
        breaks += [a + near, b - near, b]
        rows += [(float(k), float(slopes[k])), (float(left), float(steep)), (float(right), float(slopes[k + 1]))]
    return breaks, rows


@dataclass(frozen=True)
class TimeTable:
    """A table whose argument is zero at the node `origin` [s] and grows by the node `slope` [1/s]."""

    table: Lookup
    origin: int
    slope: int


def time_tables(pool: Pool, roots: Iterable[int], definitions: Mapping[int, int]) -> tuple[TimeTable, ...]:
    """All such tables below `roots`, each once; `definitions` are the nodes that variables are equal to."""
    found: dict[TimeTable, None] = {}
    for number in pool.reachable(roots):
        op, *operands = pool.nodes[number]
        if not isinstance(op, Call) or not isinstance(op.external, Lookup):
            continue
        argument = _of_time(pool, operands[0], definitions)
        affine = None if argument is None else affine_in_time(pool, argument)
        if affine is not None:
            found[TimeTable(op.external, *affine)] = None
    return tuple(found)


def is_of_time(pool: Pool, number: int, definitions: Mapping[int, int]) -> bool:
    """Whether a node is affine in time, with coefficients free of variables, or constant."""
    argument = _of_time(pool, number, definitions)
    return argument is not None and (
        affine_in_time(pool, argument) is not None or pool.time not in pool.reachable([argument])
    )


def _of_time(pool: Pool, number: int, definitions: Mapping[int, int]) -> int | None:
    """A node with its variables replaced by what they are equal to; None where one of them is equal to nothing."""
    while inside := pool.variables_in(number):
        if not definitions.keys() >= inside:
            return None
        done: dict[int, int] = {}
        pool.rewrite([number], definitions.__getitem__, done)
        number = done[number]
    return number
