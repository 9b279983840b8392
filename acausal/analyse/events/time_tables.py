"""Long tables read at a time: what they do is known before the run, where it matters depends on the tolerance.

Their rows stay one function in the equations (`acausal.lookup`): ten thousand relations would be as many modes. Here is
found which of them are read at `slope * (time - origin)` with both free of variables.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from acausal.analyse.events.time_events import affine_in_time
from acausal.flatten.pool import Pool
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup


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
