"""One round of the event iteration as a CasADi function, shared by interpreted runs, compiled runs and exported steps.

Semantics: Modelica language specification 3.6, section 8.6 and appendix B. At an event, discrete equations and the
`when` clauses that set discrete variables are *solved together*, with the same `pre`. Then `reset`s of states take
effect, `pre` advances, and this is repeated until nothing changes.

They are solved in the order of their dependence (`Order`): a clause is decided once every variable in its condition has
its new value. Clauses and variables in a cycle see each other's values from before the round; Modelica rejects such
cycles.

A round takes several calls. Between two of them the caller solves for the algebraic variables and flips relations that
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
    # `x`, `m`, `was`, `decided`, `level` are the arguments of the next call. `was` and `decided` are the values of
    # `StateEvents.conditions` in the previous and in this round; `level` is the number of levels of this round that are
    # done, 0 when it is complete.
    x: Any
    m: Any
    was: Any
    decided: Any
    level: Any
    settled: Any  # 1 when a complete round has changed nothing
    clash: Any  # 1 when two acting clauses set different values, or no impulse gives a velocity its new value
    acting: Any  # 1 for each clause that acts in this round; complete when `level` is 0
    applied: Any  # 1 for each action taken by this call, in the order of clauses and their actions
    # `conditions`, `remembered`, `asserts`: values of the conditions, next value of each `pre`, and values of the
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
    # Nodes of the graph: entries of x, algebraic variables, relations, conditions.
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
    index_of = {n: c + k for k, n in enumerate(events.conditions)}
    owners = [(clause, position) for clause in events.clauses for position, _ in clause.actions]
    # Resets of states act at the end of the round, when all discrete variables are known.
    at_end = {a for a, _ in impulses(compiled)}
    setters = [a for a, (_, position) in enumerate(owners) if position >= first_discrete and a not in at_end]
    chosen = ca.Function("values", reactions.sx_in(), [reactions(*reactions.sx_in())[3][setters]])
    follow(chosen, 0, [owners[a][1] for a in setters])
    condition_of_target = [
        (index_of[n], owners[a][1]) for a in setters for n in (*owners[a][0].conditions, *owners[a][0].earlier)
    ]
    pairs = np.array(condition_of_target, dtype=np.int64).reshape(-1, 2)
    edges.append((pairs[:, 0], pairs[:, 1]))
    if nz:  # algebraic variables that share a residual are solved for together
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
    is_setter = np.zeros(c + count, dtype=bool)
    is_setter[[owners[a][1] for a in setters]] = True
    level = levels(source, target, is_setter.tolist())
    set_variables = sorted({owners[a][1] for a in setters})
    levels_found = [int(v) for v in level[[*range(c, len(level)), *set_variables]]]
    rank = {v: k for k, v in enumerate(sorted(set(levels_found)))}
    own_rank = {p: rank[v] for p, v in zip(set_variables, levels_found[count:], strict=True)}
    return Order(tuple(rank[v] for v in levels_found[:count]), own_rank)


def round_of(compiled: Lowered, reactions: Any, s: Symbols) -> Any:
    """Function `(t, x, z, u, p, m, was, decided, level) -> Round`; `reactions` as in `EventFunctions`."""
    events = compiled.state_events
    count = len(events.conditions)
    was, decided, level = ca.SX.sym("was", count), ca.SX.sym("decided", count), ca.SX.sym("level")
    _, assigned, conditions, values, remembered, asserts = reactions(*s.inputs)
    order, index_of = order_of(compiled, reactions), {n: k for k, n in enumerate(events.conditions)}
    actions = [(k, position) for k, clause in enumerate(events.clauses) for position, _ in clause.actions]
    x, decided_now, applied = ca.SX(s.x), ca.SX(decided), ca.SX(len(actions), 1)
    clash, proceeding, levels_done = ca.SX(0), ca.SX(1), level
    found_impulses, hits = impulses_of(compiled, s), {a for a, _ in impulses(compiled)}

    def rises(nodes: Iterable[int]) -> Any:
        """Whether one of these conditions, all of which are decided, has become true."""
        return _any(ca.logic_and(decided_now[index_of[n]] > 0.5, was[index_of[n]] < 0.5) for n in nodes)

    def acts(k: int) -> Any:
        clause = events.clauses[k]
        return ca.logic_and(rises(clause.conditions), ca.logic_not(rises(clause.earlier)))

    def take(positions: Iterable[int], at_this_level: Any) -> Any:
        """Apply the actions on these entries of x if `at_this_level`; return whether a value has changed."""
        nonlocal clash
        changed: Any = ca.SX(0)
        for position in sorted(positions):
            taken: Any = ca.SX(0)
            new = s.x[position]
            for a, (k, target) in enumerate(actions):
                if target == position and a not in hits:
                    act = ca.logic_and(at_this_level, acts(k))
                    clash = ca.logic_or(clash, ca.logic_and(ca.logic_and(act, taken), values[a] != new))
                    new, taken = ca.if_else(act, values[a], new), ca.logic_or(taken, act)
                    applied[a] = act
            x[position] = new
            changed = ca.logic_or(changed, new != s.x[position])
        return changed

    for rank in range(order.count):
        at_this_level = ca.logic_and(proceeding, levels_done <= rank)
        for k in (k for k, level_of in enumerate(order.conditions) if level_of == rank):
            decided_now[k] = ca.if_else(at_this_level, conditions[k] > 0.5, decided_now[k])
        changed = take((p for p, level_of in order.variables.items() if level_of == rank), at_this_level)
        levels_done = ca.if_else(at_this_level, rank + 1, levels_done)
        proceeding = ca.logic_and(proceeding, ca.logic_not(changed))
    take({target for a, (_, target) in enumerate(actions) if a not in hits} - order.variables.keys(), proceeding)
    if found_impulses is not None:
        for a in found_impulses.actions:
            applied[a] = ca.logic_and(proceeding, acts(actions[a][0]))
        x, possible = found_impulses.after(s, x, [applied[a] for a in found_impulses.actions])
        clash = ca.logic_or(clash, ca.logic_not(possible))
    acting = [acts(k) for k in range(len(events.clauses))]
    # Evaluated after the resets: `pre` of a state is its value at the end of the round.
    next_memories = reactions(s.t, x, *s.inputs[2:])[4]
    first = compiled.n_timely + len(events.samples)
    m, memories_settled = ca.SX(s.m), ca.SX(1)
    for k in range(len(events.memories)):
        memories_settled = ca.logic_and(memories_settled, next_memories[k] == s.m[first + k])
        m[first + k] = ca.if_else(proceeding, next_memories[k], s.m[first + k])
    reset = _any(applied[a] for a, (_, position) in enumerate(actions) if a in hits or position < compiled.n_dynamic)
    for flag in _reset_flags(compiled):
        memories_settled = ca.logic_and(memories_settled, reset == s.m[flag])
        m[flag] = ca.if_else(proceeding, reset, s.m[flag])
    result = Round(
        assigned=assigned,
        x=x,
        m=m,
        was=ca.if_else(proceeding, decided_now, was),
        decided=decided_now,
        level=ca.if_else(proceeding, 0, levels_done),
        settled=ca.logic_and(proceeding, ca.logic_and(memories_settled, ca.logic_not(_any(acting)))),
        clash=clash,
        acting=ca.vertcat(ca.SX(0, 1), *acting),
        applied=applied,
        conditions=conditions,
        remembered=remembered,
        asserts=asserts,
    )
    outputs: Any = ca.cse([ca.densify(v) for v in result])
    names = [f"{name}_after" for name in Round._fields]
    return ca.Function("event_round", [*s.inputs, was, decided, level], outputs, _NAMES_IN, names)


def _reset_flags(compiled: Lowered) -> list[int]:
    """The modes that say whether states were reset in the round before."""
    events, nodes = compiled.state_events, compiled.solution.structure.reduced.pool.nodes
    first = compiled.n_timely + len(events.samples) + len(events.memories)
    return [first + k for k, n in enumerate(events.flags) if nodes[n][0] == "after_reset"]


def _any(conditions: Iterable[Any]) -> Any:
    any_true: Any = ca.SX(0)
    for condition in conditions:
        any_true = ca.logic_or(any_true, condition)
    return any_true
