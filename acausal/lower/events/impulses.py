"""Impulses: what jumps when a force acts for an instant, as large as it takes for a velocity to have a new value.

`reset(v, value, by=hit)` says that for an instant dt the discrete variable `hit` is P / dt. The equations of motion,
integrated over that instant, lose all that is finite in it; what is left is linear, M dv = J^T p + b P with J v+ = 0
(F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996, chapter 8). Its solution need not be made
anew: the rates of the states, with all constraint forces solved for, are what they are for any value of `hit`, and
their slope by it is dv / P. So x+ = x- + B P with B = d(rates)/d(hit), and P from v(x+) = value. Springs, dampers and
gravity fall out by themselves, and constraints hold behind the impact as they did before, whether they are solved or
stabilised: B leaves them alone.

This holds where B is the same before, during and after the impact. That is asked of the structure: B must not depend
on anything that jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from acausal.analyse.events.state_events import Clause
from acausal.errors import StructureError
from acausal.flatten.pool import IMPULSE
from acausal.lower.lowered import Lowered
from acausal.lower.symbols import Symbols
from acausal.reduce.cone import loops

_NOTHING = 1e-11
"""A velocity that an impulse moves by so little of what its parts move by is not moved by it."""

_MOST = 1e300


def impulses(compiled: Lowered) -> list[tuple[int, int]]:
    """Actions that are impulses: their number among all actions, and the number of their clause."""
    nodes = compiled.solution.structure.reduced.pool.nodes
    actions = [(k, node) for k, clause in enumerate(compiled.state_events.clauses) for _, node in clause.actions]
    return [(a, k) for a, (k, node) in enumerate(actions) if nodes[node][0] == IMPULSE]


@dataclass(frozen=True, eq=False)
class Impulses:
    """The impulses of a model as expressions of the symbols `s`.

    `actions` are their numbers among all actions; `effect` is B, a column for each; `moved` what that moves the
    velocities by, `sizes` the same without cancellation, and `missing` what they lack of their new values.
    """

    actions: tuple[int, ...]
    effect: Any
    moved: Any
    sizes: Any
    missing: Any
    follow: Callable[[Any], Any]
    """What velocities change by when states do."""

    def after(self, s: Symbols, x: Any, acting: Sequence[Any]) -> tuple[Any, Any]:
        """States behind the impulses that act, from the states `x` that `reset`s have set; and whether there are such.

        Those that act at once are solved for together.
        """
        act: Any = ca.vertcat(*acting)
        count = act.numel()
        missing = act * (self.missing - self.follow(ca.sparsify(x - s.x)))
        among = act @ act.T
        matrix = among * self.moved + ca.diag(1 - act)
        found = missing / matrix if count == 1 else ca.solve(ca.densify(matrix), missing)
        size = ca.if_else(act, ca.fabs(ca.diag(self.moved)) - _NOTHING * self.sizes, 1)
        possible = ca.mmin(size) > 0
        for k in range(count):  # which a nan is not
            possible = ca.logic_and(possible, ca.fabs(found[k]) < _MOST)
        found = ca.if_else(ca.mmax(act), ca.if_else(possible, found, float("nan")), 0)
        return x + self.effect @ found, possible


def impulses_of(compiled: Lowered, s: Symbols) -> Impulses | None:
    """The impulses of a model; None without any.

    Raises StructureError: AC210 for a force that moves nothing of what it is to reset, or does so in ways that change
    with what jumps.
    """
    found = impulses(compiled)
    if not found:
        return None
    pool, clauses = compiled.solution.structure.reduced.pool, compiled.state_events.clauses
    actions = [action for clause in clauses for action in clause.actions]
    builder = s.defined(compiled)
    before = ca.SX(s.x)  # a string that is slack until now does not yet hold
    memory = dict(zip(compiled.mode_nodes, compiled.mode_places, strict=True))
    for k in range(compiled.n_dynamic + compiled.quadratures, len(compiled.states)):
        place = memory.get(pool.make("pre", pool.var(compiled.state_variables[k])))
        before[k] = s.x[k] if place is None else s.m[place]
    ends = [pool.nodes[builder.replaced(actions[a][1])] for a, _ in found]
    speeds = ca.vertcat(*builder.lower([node[1] for node in ends]))
    values = ca.vertcat(*builder.lower([node[2] for node in ends]))
    ode, alg = compiled.rhs(s.t, before, *s.inputs[2:])
    solver = _Response(compiled, s, alg)
    effects = []
    for a, _ in found:
        own = ca.SX(s.x.numel(), 1)
        own[actions[a][0]] = 1
        effects.append(ca.jacobian(ode, s.x) @ own + ca.jacobian(ode, s.z) @ solver.of(own))
    by_x, by_z = ca.jacobian(speeds, s.x), ca.jacobian(speeds, s.z)

    def follow(direction: Any) -> Any:
        return by_x @ direction + by_z @ solver.of(direction)

    moved = ca.horzcat(*map(follow, effects))
    sizes = ca.vertcat(
        *(ca.fabs(by_x[k, :]) @ ca.fabs(e) + ca.fabs(by_z[k, :]) @ ca.fabs(solver.of(e)) for k, e in enumerate(effects))
    )
    # in a regime that holds the velocity no impulse moves it: the event is unusual, and passed by the free equations
    for k, (a, clause) in enumerate(found if not compiled.varied else []):
        _check(compiled, s, clauses[clause], actions[a][0], effects[k], speeds[k], moved[k, :], solver)
    return Impulses(tuple(a for a, _ in found), ca.horzcat(*effects), moved, sizes, values - speeds, follow)


def struck(compiled: Lowered, acting: Collection[int]) -> Any:
    """`(t, x, z, u, p, m) -> dx[nx]`: what jumps when those of the actions `acting` that are impulses act at once."""
    s = Symbols(compiled)
    found = impulses_of(compiled, s)
    jump = ca.SX(s.x.numel(), 1)
    if found is not None:
        jump = found.after(s, s.x, [ca.SX(a in acting) for a in found.actions])[0] - s.x
    return ca.Function("struck", s.inputs, [ca.densify(jump)])


class _Response:
    """How algebraic variables follow the states, block by block, so that what does not move is known not to."""

    def __init__(self, compiled: Lowered, s: Symbols, alg: Any) -> None:
        self.s = s
        self.by_x, self.by_z = ca.jacobian(alg, s.x), ca.jacobian(alg, s.z)
        place = {v: k for k, v in enumerate(compiled.solution.algebraic)}
        self.blocks: list[tuple[list[int], list[int]]] = []
        first = 0
        for iterated, residuals in loops(compiled.solution):
            rows = list(range(first, first + len(residuals)))
            self.blocks.append(([place[v] for v in iterated], rows))
            first += len(residuals)

    def of(self, direction: Any) -> Any:
        """dz for states that go in a direction."""
        found = ca.SX(self.s.z.numel(), 1)
        right = ca.SX(self.by_x @ direction)
        for columns, rows in self.blocks:
            load = right[rows] + self.by_z[rows, :] @ found
            load = ca.sparsify(load)
            if not load.nnz():
                continue
            own = self.by_z[rows, columns]
            step = -load / own if len(rows) == 1 else -ca.solve(own, ca.densify(load))
            for k, column in enumerate(columns):
                found[column] = step[k]
        return ca.sparsify(found)


def _check(
    compiled: Lowered, s: Symbols, clause: Clause, hit: int, effect: Any, speed: Any, moved: Any, solver: _Response
) -> None:
    """Refuse an impulse that does not do what it is to do."""
    name = compiled.states[hit]
    own = ca.SX(s.x.numel(), 1)
    own[hit] = 1
    forced = solver.of(own)
    at_once = ca.jacobian(speed, s.x[hit]).nnz() or (ca.jacobian(speed, s.z) @ forced).nnz()
    jumping = [s.x[k] for k in ca.sparsify(effect).sparsity().row()]
    jumping += [s.z[k] for k in {*forced.sparsity().row(), *solver.of(effect).sparsity().row()}]
    changes = jumping and ca.depends_on(ca.vertcat(effect, moved.T), ca.vertcat(*jumping))
    if not at_once and moved.nnz() and not changes:
        return
    if at_once:
        fact, cause = (
            f"what {name} is to reset is no velocity",
            "it follows that force at once, as an acceleration does",
        )
        help_ = "reset a velocity, der(...) of a position, to what it is after the impact"
    elif changes:
        fact = f"the impulse of {name} changes what its own effect depends on"
        cause = "while it acts nothing may jump but what is moved in proportion to it, by positions and masses"
        help_ = "let the force enter a balance of forces, with a factor that only positions change"
    else:
        fact, cause = f"the impulse of {name} moves nothing of that", "no equation leads from one to the other"
        help_ = f"add {name} to the forces of the equation of motion: it is zero between impacts"
    raise StructureError(
        "AC210", f"{compiled.name}: {fact}", where=(clause.where,), evidence=[clause.text], cause=cause, help=help_
    )
