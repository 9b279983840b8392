"""Assertions of a model: when each is checked.

A run ends, or makes a note, at the instant at which a relation of an assertion changes. An assertion on single instants
(`~initial() | c`) needs no such event: all instants have their event iteration anyway. Nothing locates what is below a
`no_event`, so rows of the run show whether it holds (`acausal.simulate.record.violations`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from acausal.analyse.events.between_events import BetweenEvents
from acausal.errors import DeclarationError, Span
from acausal.flatten.pool import RELATIONS, Pool
from acausal.flatten.reduced import ReducedSystem
from acausal.numeric.evaluate import values

_EVALUATED = frozenset(("const", "neg", "add", "sub", "mul", "div", "pow", *RELATIONS, "and", "or", "not"))

_AT_INSTANTS = frozenset(("initial", "terminal", "sample"))
"""What is true until the event iteration of an instant has ended."""


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
    """Assertions, except those that always hold, such as one on a torque that is zero without a connection.

    Raises DeclarationError: AC146 for one that is false only while an event iteration goes on.
    """
    pool = reduced.pool
    for flat, node in zip(reduced.flat.asserts, reduced.asserts, strict=True):
        is_constant = all(pool.nodes[n][0] in _EVALUATED for n in pool.reachable([node]))
        if is_constant and values(pool, [node], {})[node]:
            continue
        holds = between.holds(node)
        if holds and not _holds_but_at_instants(pool, node):
            raise DeclarationError(
                "AC146",
                "an assertion on an edge or a change is checked behind it, where it always holds",
                where=(flat.origin.span(),),
                evidence=[str(flat.source)],
                help="assert what must hold as long as the condition does; or end the run by "
                'when(a & ~b, terminate("why")), which acts at the instant at which a becomes true',
            )
        condition = pool.make("noevent", node) if holds else node
        in_rows = between.varying(node) is not None
        yield Assert(condition, flat.message, flat.level, flat.component, flat.origin.span(), in_rows)


def _holds_but_at_instants(pool: Pool, node: int) -> bool:
    """Whether a condition holds by itself except at the start, the end, or a tick."""
    op, *operands = pool.nodes[node]
    if op == "not":
        return pool.nodes[operands[0]][0] in _AT_INSTANTS
    if op == "or":
        return any(_holds_but_at_instants(pool, n) for n in operands)
    return op in ("and", "noevent") and all(_holds_but_at_instants(pool, n) for n in operands)
