"""Time events: relations that depend on time and parameters only, whose instants are known before the run.

The run is divided there. Within a segment such a relation is a constant mode, and the right-hand side is smooth in time
up to both ends. No solver has to discover a pulse: six of them return 0 for one of 10 ms.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from acausal.analyse.blocks.linear import LinearForm
from acausal.flatten.pool import RELATIONS, Pool

_AS_RELATION = {"min": "lt", "max": "gt"}
_SWITCHED = frozenset((*RELATIONS, "min", "max", "fabs", "sign"))


@dataclass(frozen=True)
class TimeEvents:
    """Relation nodes that switch at known instants.

    `instants[k]` is the node of the time at which `relations[k]` changes, `slopes[k]` that of the rate of its left
    minus its right side; both depend on parameters only. `rewritten` maps min, max, fabs and sign of time to branches
    on such relations.
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
    timely = _timely(pool, pool.reachable(switched))
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


def _timely(pool: Pool, wanted: list[int]) -> set[int]:
    """Nodes that depend on time but on no variable."""
    depends: dict[int, tuple[bool, bool]] = {}
    for number in wanted:
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
    form = LinearForm(pool, (stand_in,)).of(done[number])
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
