"""Relations of variables, samples and `when` clauses: what makes an instant an event.

In a model with `when` clauses every relation on which an integrated quantity depends is a mode, constant between
events, so that the right-hand side is smooth in each mode; `no_event` and `where(..., smooth=True)` exempt a relation.
Relations of time only are known in advance and live in `time_events`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from acausal.errors import Span, StructureError
from acausal.flatten.pool import LEAVES, RELATIONS, Pool
from acausal.lower.solve import Solution
from acausal.lower.time_events import TimeEvents


@dataclass(frozen=True)
class Clause:
    """One `when`: node of its condition, new values as `(position in the state vector, node)`, words and place."""

    condition: int
    actions: tuple[tuple[int, int], ...]
    text: str
    component: str
    where: Span


@dataclass(frozen=True)
class StateEvents:
    """Samples, relations and clauses of a model, as nodes of the reduced pool."""

    samples: tuple[int, ...] = ()
    relations: tuple[int, ...] = ()
    clauses: tuple[Clause, ...] = ()


def find_state_events(solution: Solution, states: tuple[int, ...], time_events: TimeEvents) -> StateEvents:
    """Everything that can happen between the time events.

    Raises
    ------
    StructureError
        AC210 when a variable is reset that is neither integrated nor discrete.
    """
    reduced = solution.structure.reduced
    pool = reduced.pool
    clauses = tuple(_clauses(solution, states))
    if not clauses:
        # Locating kinks of contact forces in DAEs costs more than it gains as yet: see docs/known-gaps.md
        return StateEvents()
    own = [n for c in clauses for n in (c.condition, *(v for _, v in c.actions))]
    roots = [*own, *solution.residuals, *_definitions(solution, own)]
    done = dict(time_events.rewritten)
    pool.rewrite(roots, pool.var, done)
    samples, relations = _conditions(pool, [done[r] for r in roots], set(time_events.relations))
    return StateEvents(samples, relations, clauses)


def _definitions(solution: Solution, roots: Iterable[int]) -> list[int]:
    """Nodes of all definitions that the integration or the clauses need."""
    pool = solution.structure.reduced.pool
    definition = dict(solution.definitions)
    needed = set(solution.needed)
    stack = [v for r in roots for v in pool.variables_in(r)]
    seen: set[int] = set()
    while stack:
        v = stack.pop()
        if v not in seen:
            seen.add(v)
            if v in definition:
                needed.add(v)
                stack.extend(pool.variables_in(definition[v]))
    return [node for v, node in solution.definitions if v in needed]


def _conditions(pool: Pool, roots: Iterable[int], timely: set[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    samples: set[int] = set()
    relations: set[int] = set()
    seen: set[int] = set()
    stack = list(roots)
    while stack:
        number = stack.pop()
        if number in seen or number in timely:
            continue
        seen.add(number)
        node = pool.nodes[number]
        if node[0] == "sample":
            samples.add(number)
        elif node[0] not in LEAVES and node[0] != "noevent":
            if node[0] in RELATIONS and any(pool.nodes[n][0] in ("var", "time") for n in pool.reachable([number])):
                relations.add(number)
            stack.extend(node[1:])
    return tuple(sorted(samples)), tuple(sorted(relations))


def _clauses(solution: Solution, states: tuple[int, ...]) -> Iterable[Clause]:
    reduced = solution.structure.reduced
    pool = reduced.pool
    place = {v: k for k, v in enumerate(states)}
    for when, (condition, values) in zip(reduced.flat.whens, reduced.whens, strict=True):
        actions = []
        for (scalar, _), value in zip(when.actions, values, strict=True):
            op, *rest = pool.nodes[reduced.image[scalar]]
            negative = op == "neg"
            if negative:
                op, *rest = pool.nodes[rest[0]]
            if op != "var" or rest[0] not in place:
                raise StructureError(
                    "AC210",
                    f"{reduced.flat.scalar_name(scalar)} cannot be reset: it is not a state of {reduced.flat.name}",
                    where=(when.origin.span(),),
                    evidence=[f"states: {', '.join(reduced.name(x) for x in states[:8])}"],
                    cause="it follows from other variables, so a new value would contradict them",
                    help="reset the state it follows from, or declare it prefer_state=True or discrete()",
                )
            actions.append((place[rest[0]], pool.neg(value) if negative else value))
        yield Clause(condition, tuple(actions), str(when.source), when.component, when.origin.span())
