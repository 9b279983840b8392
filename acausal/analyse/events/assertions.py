"""Assertions of a model: when each is checked.

A run ends, or makes a note, at the instant at which a relation of an assertion changes. An assertion on single instants
(`~initial() | c`) needs no such event: all instants have their event iteration anyway. Nothing locates what is below a
`no_event`, so rows of the run show whether it holds (`acausal.simulate.record.violations`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from acausal.analyse.events.between_events import BetweenEvents
from acausal.errors import Span
from acausal.flatten.pool import RELATIONS
from acausal.flatten.reduced import ReducedSystem
from acausal.numeric.evaluate import values

_EVALUATED = frozenset(("const", "neg", "add", "sub", "mul", "div", "pow", *RELATIONS, "and", "or", "not"))


@dataclass(frozen=True)
class Assert:
    """A condition that must hold, and the message if it does not; `in_rows`: whether no event shows that."""

    condition: int
    message: str
    level: str
    component: str
    where: Span
    in_rows: bool


def assertions(reduced: ReducedSystem, between: BetweenEvents) -> Iterable[Assert]:
    """Assertions, except those that always hold, such as one on a torque that is zero without a connection."""
    pool = reduced.pool
    for flat, node in zip(reduced.flat.asserts, reduced.asserts, strict=True):
        is_constant = all(pool.nodes[n][0] in _EVALUATED for n in pool.reachable([node]))
        if is_constant and values(pool, [node], {})[node]:
            continue
        condition = pool.make("noevent", node) if between.holds(node) else node
        in_rows = between.varying(node) is not None
        yield Assert(condition, flat.message, flat.level, flat.component, flat.origin.span(), in_rows)
