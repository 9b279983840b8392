"""Time events: relations that depend on time and parameters only, whose instants are known before the run.

The run is divided there. Within a segment such a relation is a constant mode, and the right-hand side is smooth in time
up to both ends. No solver has to discover a pulse; left to themselves, six solvers overlook one of 10 ms and return 0.

The ends of the stretches of long tables are stops, too. Those of a table of `slope * (time - origin)`, where both
depend on parameters only, are known before the run and depend on the tolerance. For a table of a variable, relations of
the number of the current stretch locate the ends, because a change at the end of a stretch may be over before the next
step ends. The stretch number is the integer part (`floor`) of a piecewise linear function, so that two relations locate
all ends of a table, whatever their number and the direction of passage. It occurs in no equation: the table itself
remains one function (`acausal.lookup`), since ten thousand relations would be as many modes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from acausal.analyse.blocks.linear import linear_in
from acausal.flatten.pool import LEAVES, RELATIONS, Pool
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup, lookup
from acausal.numeric.table_ends import stops, table_ends

_AS_RELATION = {"min": "lt", "max": "gt"}
_SWITCHED = frozenset((*RELATIONS, "min", "max", "fabs", "sign"))


@dataclass(frozen=True)
class TimeEvents:
    """Relation nodes that switch at known instants.

    `instants[k]` is the node of the time at which `relations[k]` changes, `slopes[k]` that of the rate of its left
    minus its right side; both depend on parameters only. `rewritten` maps `min`, `max`, `fabs` and `sign` of time to
    branches on such relations.
    """

    relations: tuple[int, ...]
    instants: tuple[int, ...]
    slopes: tuple[int, ...]
    rewritten: dict[int, int]


def find_time_events(pool: Pool, roots: Iterable[int]) -> TimeEvents:
    """Time events of all relations below `roots` that are affine in time, with coefficients free of variables."""
    switched = [n for n in pool.reachable(roots) if pool.nodes[n][0] in _SWITCHED]
    if not switched:
        return TimeEvents((), (), (), {})
    timely = _of_time_only(pool, pool.reachable(switched))
    passage_of: dict[int, tuple[int, int]] = {}
    rewritten: dict[int, int] = {}
    for number in switched:
        node = pool.nodes[number]
        op = node[0]
        if number not in timely:
            continue
        if op in RELATIONS:
            passage = affine_in_time(pool, pool.sub(node[1], node[2]))
            if passage is not None:
                passage_of[number] = passage
        else:
            branch = _branch(pool, op, node[1:])
            if branch is None:
                continue
            rewritten[number], relation, passage = branch
            passage_of.setdefault(relation, passage)
    instants, slopes = (tuple(passage[k] for passage in passage_of.values()) for k in range(2))
    return TimeEvents(tuple(passage_of), instants, slopes, rewritten)


def _of_time_only(pool: Pool, nodes_in_order: list[int]) -> set[int]:
    """Nodes that depend on time but on no variable."""
    depends: dict[int, tuple[bool, bool]] = {}
    for number in nodes_in_order:
        node = pool.nodes[number]
        if node[0] in ("const", "par"):
            depends[number] = (False, False)
        elif node[0] == "time":
            depends[number] = (True, False)
        elif node[0] == "var":
            depends[number] = (False, True)
        else:
            below = [depends[c] for c in node[1:]]
            depends[number] = (any(t for t, _ in below), any(v for _, v in below))
    return {n for n, (t, v) in depends.items() if t and not v}


def affine_in_time(pool: Pool, number: int) -> tuple[int, int] | None:
    """(Node of the time at which a node is zero, node of its slope); None for a node that is not affine in time."""
    stand_in = -1  # no variable has this number
    done: dict[int, int] = {pool.time: pool.intern(("var", stand_in))}
    pool.rewrite([number], pool.var, done)
    form = linear_in(pool, done[number], stand_in)
    if form is None or stand_in not in form[1]:
        return None
    slope = form[1][stand_in]
    return pool.div(pool.neg(form[0]), slope), slope


def _branch(pool: Pool, op: str, args: tuple[int, ...]) -> tuple[int, int, tuple[int, int]] | None:
    a = args[0]
    b = args[1] if len(args) > 1 else pool.zero
    passage = affine_in_time(pool, pool.sub(a, b))
    if passage is None:
        return None
    relation = pool.make(_AS_RELATION.get(op, "gt"), a, b)
    if op == "fabs":
        return pool.where(relation, a, pool.neg(a)), relation, passage
    if op == "sign":
        return pool.where(relation, pool.one, pool.neg(pool.one)), relation, passage
    return pool.where(relation, a, b), relation, passage


# Fraction of a stretch, from either end, over which the stretch number has the slope that belongs to that end.
_END_FRACTION = 0.25


def stretch_numbers(
    pool: Pool, roots: Iterable[int], definitions: Mapping[int, int], relative: float
) -> tuple[tuple[int, ...], int]:
    """(Nodes of the stretch numbers of all tables of variables below `roots`, number of ends that are not located).

    `relative` is the relative tolerance of the run.
    """
    unlocated_ends: dict[int, int] = {}
    seen: set[int] = set()
    stack = list(roots)
    while stack:
        number = stack.pop()
        op, *operands = pool.nodes[number]
        # `floor` and `ceil` are constant between events, whatever is below them.
        if number in seen or op in LEAVES or op in ("floor", "ceil"):
            continue
        seen.add(number)
        stack += operands
        table = op.external if isinstance(op, Call) else None
        if not isinstance(table, Lookup) or is_of_time(pool, operands[0], definitions):
            continue
        ends = stops(table, relative).tolist() if len(table.coefficients[0]) > 1 else []
        if ends:
            segment = segment_number(pool, operands[0], [table.breaks[0], *ends, table.breaks[-1]])
            unlocated_ends[segment] = len(table_ends(table, relative)) - len(ends)
    return tuple(unlocated_ends), sum(unlocated_ends.values())


def segment_number(pool: Pool, argument: int, ends: list[float]) -> int:
    """The node of the number of the segment between `ends` that contains `argument`; the outer ones are unbounded."""
    line = lookup(*_line(ends), "stretch")
    position = pool.make(Call(line, 0), argument)
    clamped = pool.make("min", pool.make("max", position, pool.const(0.5)), pool.const(len(ends) - 1.5))
    return pool.make("floor", clamped)


def _line(ends: list[float]) -> tuple[list[float], list[tuple[float, float]]]:
    """Breaks and rows of a piecewise linear function that equals k at end k, and has no kink there.

    A run that stops at an end restarts on either side of it, within rounding errors, and predicts the relations by
    their rates. If the rate jumped at the end, for instance by a factor of 50 000 between stretches of 2e-4 s and 10 s,
    the search for an event would divide a step of the solver into ever smaller parts. The slope at an end is therefore
    that of the longer of its two stretches, over a quarter of each stretch.
    """
    lengths = np.diff(ends)
    slopes = 1.0 / np.maximum(np.append(0.0, lengths), np.append(lengths, 0.0))
    breaks, rows = [ends[0]], list[tuple[float, float]]()
    for k, (a, b) in enumerate(pairwise(ends)):
        reach = _END_FRACTION * (b - a)
        left, right = k + reach * slopes[k], k + 1.0 - reach * slopes[k + 1]
        steep = (right - left) / (b - a - 2.0 * reach)
        breaks += [a + reach, b - reach, b]
        rows += [(float(k), float(slopes[k])), (float(left), float(steep)), (float(right), float(slopes[k + 1]))]
    return breaks, rows


@dataclass(frozen=True)
class TimeTable:
    """A table with the argument `slope * (time - origin)`, nodes in [1/s] and [s]."""

    table: Lookup
    origin: int
    slope: int


def time_tables(pool: Pool, roots: Iterable[int], definitions: Mapping[int, int]) -> tuple[TimeTable, ...]:
    """All tables of time below `roots`, without repetitions; `definitions` maps variables to nodes."""
    tables: dict[TimeTable, None] = {}
    for number in pool.reachable(roots):
        op, *operands = pool.nodes[number]
        if not isinstance(op, Call) or not isinstance(op.external, Lookup):
            continue
        argument = _of_time(pool, operands[0], definitions)
        affine = None if argument is None else affine_in_time(pool, argument)
        if affine is not None:
            tables[TimeTable(op.external, *affine)] = None
    return tuple(tables)


def is_of_time(pool: Pool, number: int, definitions: Mapping[int, int]) -> bool:
    """Whether a node is constant, or affine in time with coefficients that depend on parameters only."""
    argument = _of_time(pool, number, definitions)
    return argument is not None and (
        affine_in_time(pool, argument) is not None or pool.time not in pool.reachable([argument])
    )


def _of_time(pool: Pool, number: int, definitions: Mapping[int, int]) -> int | None:
    """A node with its variables replaced by their definitions; None if one of them has none."""
    while variables := pool.variables_in(number):
        if not definitions.keys() >= variables:
            return None
        done: dict[int, int] = {}
        pool.rewrite([number], definitions.__getitem__, done)
        number = done[number]
    return number
