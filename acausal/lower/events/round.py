"""One round of the event iteration as a CasADi function, shared by interpreted runs, compiled runs and exported steps.

Semantics: Modelica language specification 3.6, section 8.6 and appendix B. At an event, discrete equations and the
`when` clauses that set discrete variables are *solved together*, with one `pre`; then `reset`s of states take effect,
`pre` advances, and this is repeated until nothing changes.

They are solved in the order of their dependence (`Order`): a clause is decided once every variable that its condition
reads has its new value. Clauses and variables in a cycle see each other's values from before the round; Modelica
rejects such cycles.

A round takes several calls: between two of them the caller solves for the algebraic variables and flips relations that
do not hold, because both depend on the discrete variables that a call sets. Each call therefore continues from `level`
only until one of its assignments changes a value.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.lower.build import Symbols
from acausal.lower.events.impulses import impulses, impulses_of
from acausal.lower.lowered import Lowered
from acausal.structure.blt import levels

_NAMES_IN = ["t", "x", "z", "u", "p", "m", "was", "decided", "level"]


class Round(NamedTuple):
    """Outputs of a call of the round; vectors are dense columns."""

    # Values of the discrete equations, shape (assignments,). If they differ from x, the caller enters them in x and
    # ignores all other outputs of this call.
    assigned: Any
    # `x`, `m`, `was`, `decided`, `level`: the arguments of the next call. `was` and `decided` hold, for each of
    # `StateEvents.conditions`, its truth in the previous and in this round; `level` is the number of levels of this
    # round that are done, 0 when it is complete.
    x: Any
    m: Any
    was: Any
    decided: Any
    level: Any
    settled: Any  # 1 when a complete round has changed nothing
    clash: Any  # 1 when two acting clauses set different values, or no impulse gives a velocity its new value
    acting: Any  # 1 for each clause that acts in this round; complete when `level` is 0
    applied: Any  # 1 for each action taken by this call, in the order of clauses and their actions
    # `conditions`, `remembered`, `asserts`: truth of the conditions, next value of each `pre`, and truth of the
    # assertions, all at the arguments of the call.
    conditions: Any
    remembered: Any
    asserts: Any


@dataclass(frozen=True, eq=False)
class Order:
    """Level of each condition, and of each discrete variable set by clauses, by its index in x."""

    conditions: tuple[int, ...]
    variables: dict[int, int]

    @property
    def count(self) -> int:
        """Number of levels."""
        return 1 + max((*self.conditions, *self.variables.values()), default=-1)


def order_of(compiled: Lowered, reactions: Any) -> Order:
    """Order in which conditions and discrete variables are decided within one round.

    A condition depends on a discrete variable directly, or through discrete equations, relations, and algebraic
    variables; not through `pre`, which is constant in a round, and not through states, which change at its end.
    """
    events = compiled.state_events
    first_discrete = len(compiled.states) - compiled.discretes
    nx, nz, nr = len(compiled.states), len(compiled.algebraic), len(events.relations)
    # nodes of the graph: entries of x, algebraic variables, relations, conditions
    z, r, c = nx, nx + nz, nx + nz + nr
    edges: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []

    def follow(function: Any, output: int, targets: list[int]) -> None:
        for argument, first, skip in ((1, 0, 0), (2, z, 0), (5, r, compiled.n_modes - nr)):
            rows, columns = function.jac_sparsity(output, argument).get_triplet()
            source, target = np.array(columns, dtype=np.int64) - skip, np.array(targets, dtype=np.int64)[rows]
            inside = (source >= 0) & ((argument != 1) | (source >= first_discrete))
            edges.append((source[inside] + first, target[inside]))

    follow(reactions, 0, [r + k for k in range(nr)])
    follow(reactions, 1, [a.position for a in events.assignments])
    count = len(events.conditions)
    follow(reactions, 2, [c + k for k in range(count)])
    place = {n: c + k for k, n in enumerate(events.conditions)}
    owners = [(clause, position) for clause in events.clauses for position, _ in clause.actions]
    # resets of states act at the end of the round, when all discrete variables are known
    at_end = {a for a, _ in impulses(compiled)}
    setters = [a for a, (_, position) in enumerate(owners) if position >= first_discrete and a not in at_end]
    chosen = ca.Function("values", reactions.sx_in(), [reactions(*reactions.sx_in())[3][setters]])
    follow(chosen, 0, [owners[a][1] for a in setters])
    condition_of_target = [
        (place[n], owners[a][1]) for a in setters for n in (*owners[a][0].conditions, *owners[a][0].earlier)
    ]
    pairs = np.array(condition_of_target, dtype=np.int64).reshape(-1, 2)
    edges.append((pairs[:, 0], pairs[:, 1]))
    if nz:  # algebraic variables in one residual are solved for together
        rows, columns = compiled.rhs.jac_sparsity(1, 2).get_triplet()
        of_row = np.full(compiled.rhs.numel_out(1), -1)
        for row, column in zip(rows, columns, strict=True):
            if of_row[row] < 0:
                of_row[row] = column
            pair = np.array([of_row[row], column]) + z
            edges += [(pair, pair[::-1])]
        follow(compiled.rhs, 1, [z + max(int(k), 0) for k in of_row])
    source = np.concatenate([s for s, _ in edges]).astype(np.int64)
    target = np.concatenate([t for _, t in edges]).astype(np.int64)
    late = np.zeros(c + count, dtype=bool)
    late[[owners[a][1] for a in setters]] = True
    level = levels(source, target, late.tolist())
    places = sorted({owners[a][1] for a in setters})
    levels_found = [int(v) for v in level[[*range(c, len(level)), *places]]]
    rank = {v: k for k, v in enumerate(sorted(set(levels_found)))}
    own_rank = {p: rank[v] for p, v in zip(places, levels_found[count:], strict=True)}
    return Order(tuple(rank[v] for v in levels_found[:count]), own_rank)


def round_of(compiled: Lowered, reactions: Any, s: Symbols) -> Any:
    """Function `(t, x, z, u, p, m, was, decided, level) -> Round`; `reactions` as in `EventFunctions`."""
    events = compiled.state_events
    count = len(events.conditions)
    was, decided, level = ca.SX.sym("was", count), ca.SX.sym("decided", count), ca.SX.sym("level")
    _, assigned, conditions, values, remembered, asserts = reactions(*s.inputs)
    order, place = order_of(compiled, reactions), {n: k for k, n in enumerate(events.conditions)}
    actions = [(k, position) for k, clause in enumerate(events.clauses) for position, _ in clause.actions]
    x, known, applied = ca.SX(s.x), ca.SX(decided), ca.SX(len(actions), 1)
    clash, here, reached = ca.SX(0), ca.SX(1), level
    found_impulses = impulses_of(compiled, s)
    hits = {a for a, _ in impulses(compiled)}

    def rises(nodes: Iterable[int]) -> Any:
        """Whether one of these conditions, all decided, has become true."""
        return _any(ca.logic_and(known[place[n]] > 0.5, was[place[n]] < 0.5) for n in nodes)

    def acts(k: int) -> Any:
        clause = events.clauses[k]
        return ca.logic_and(rises(clause.conditions), ca.logic_not(rises(clause.earlier)))

    def take(positions: Iterable[int], now: Any) -> Any:
        """Apply the actions on these entries of x if `now`; returns whether a value has changed."""
        nonlocal clash
        changed: Any = ca.SX(0)
        for position in sorted(positions):
            taken: Any = ca.SX(0)
            new = s.x[position]
            for a, (k, target) in enumerate(actions):
                if target == position and a not in hits:
                    act = ca.logic_and(now, acts(k))
                    clash = ca.logic_or(clash, ca.logic_and(ca.logic_and(act, taken), values[a] != new))
                    new, taken = ca.if_else(act, values[a], new), ca.logic_or(taken, act)
                    applied[a] = act
            x[position] = new
            changed = ca.logic_or(changed, new != s.x[position])
        return changed

    for rank in range(order.count):
        now = ca.logic_and(here, reached <= rank)
        for k in (k for k, own in enumerate(order.conditions) if own == rank):
            known[k] = ca.if_else(now, conditions[k] > 0.5, known[k])
        changed = take((p for p, own in order.variables.items() if own == rank), now)
        reached = ca.if_else(now, rank + 1, reached)
        here = ca.logic_and(here, ca.logic_not(changed))
    take({target for a, (_, target) in enumerate(actions) if a not in hits} - order.variables.keys(), here)
    if found_impulses is not None:
        for a in found_impulses.actions:
            applied[a] = ca.logic_and(here, acts(actions[a][0]))
        struck, possible = found_impulses.after(s, x, [applied[a] for a in found_impulses.actions])
        x, clash = struck, ca.logic_or(clash, ca.logic_not(possible))
    acting = [acts(k) for k in range(len(events.clauses))]
    # evaluated after the resets: `pre` of a state is its value at the end of the round
    later = reactions(s.t, x, *s.inputs[2:])[4]
    first = compiled.n_timely + len(events.samples)
    m, fresh = ca.SX(s.m), ca.SX(1)
    for k in range(len(events.memories)):
        fresh = ca.logic_and(fresh, later[k] == s.m[first + k])
        m[first + k] = ca.if_else(here, later[k], s.m[first + k])
    result = Round(
        assigned=assigned,
        x=x,
        m=m,
        was=ca.if_else(here, known, was),
        decided=known,
        level=ca.if_else(here, 0, reached),
        settled=ca.logic_and(here, ca.logic_and(fresh, ca.logic_not(_any(acting)))),
        clash=clash,
        acting=ca.vertcat(ca.SX(0, 1), *acting),
        applied=applied,
        conditions=conditions,
        remembered=remembered,
        asserts=asserts,
    )
    outputs: Any = ca.cse([ca.densify(v) for v in result])
    return ca.Function(
        "event_round", [*s.inputs, was, decided, level], outputs, _NAMES_IN, [f"{name}_after" for name in Round._fields]
    )


def _any(conditions: Iterable[Any]) -> Any:
    any_true: Any = ca.SX(0)
    for condition in conditions:
        any_true = ca.logic_or(any_true, condition)
    return any_true
