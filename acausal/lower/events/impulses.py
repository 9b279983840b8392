"""Impulses: jumps of velocities caused by a force that acts for an instant.

`reset(v, value, by=hit)` means that for an instant dt the discrete variable `hit` is P / dt, with P such that the
velocity v becomes `value`. When the equations of motion are integrated over that instant, all finite forces vanish, and
a linear system remains: M dv = J^T p + b P with J v+ = 0 (F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral
Contacts, 1996, chapter 8). It need not be assembled: the compiled rates of the states, with all constraint forces
eliminated, hold for any value of `hit`, and their derivative by it is dv / P. Therefore x+ = x- + B P with B =
d(rates)/d(hit), and P follows from v(x+) = value. Springs, dampers and gravity drop out. Constraints hold after the
impact as they did before, whether they are solved or stabilised, because B satisfies them.

This requires that B is the same before, during and after the impact: structurally, B must not depend on any variable
that jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from acausal.analyse.events.state_events import Clause
from acausal.errors import StructureError
from acausal.flatten.pool import IMPULSE
from acausal.lower.build import Symbols
from acausal.lower.lowered import Lowered
from acausal.reduce.cone import loops

_NEGLIGIBLE = 1e-11
"""A change of velocity counts as zero if it is smaller than this fraction of the summed magnitudes of its terms."""

_LARGEST_IMPULSE = 1e300

_CREEP = 1e30
"""The creep of stuck elements under an impulse; rounding errors of their loads are this much smaller."""


def impulses(compiled: Lowered) -> list[tuple[int, int]]:
    """Actions that are impulses: (index among all actions, index of their clause)."""
    nodes = compiled.solution.structure.reduced.pool.nodes
    actions = [(k, node) for k, clause in enumerate(compiled.state_events.clauses) for _, node in clause.actions]
    return [(a, k) for a, (k, node) in enumerate(actions) if nodes[node][0] == IMPULSE]


@dataclass(frozen=True, eq=False)
class Impulses:
    """The impulses of a model as expressions of the symbols `s`.

    `actions` are their indices among all actions. For k impulses and nx states, `effect` is B, shape (nx, k).
    `velocity_changes` is the change of the k velocities by each impulse, shape (k, k), and `sizes` bounds its diagonal
    without cancellation, shape (k,). `required` is the difference of the new values from the velocities, shape (k,).
    """

    actions: tuple[int, ...]
    effect: Any
    velocity_changes: Any
    sizes: Any
    required: Any
    follow: Callable[[Any], Any]
    """Maps a change of the states to the change of the velocities."""

    def after(self, s: Symbols, x: Any, acting: Sequence[Any]) -> tuple[Any, Any]:
        """(States after the impulses that act, whether a solution exists); `x` are the states after other `reset`s.

        Simultaneous impulses are determined together.
        """
        active: Any = ca.vertcat(*acting)
        count = active.numel()
        required = active * (self.required - self.follow(ca.sparsify(x - s.x)))
        both_active = active @ active.T
        matrix = both_active * self.velocity_changes + ca.diag(1 - active)
        impulse = required / matrix if count == 1 else ca.solve(ca.densify(matrix), required)
        size = ca.if_else(active, ca.fabs(ca.diag(self.velocity_changes)) - _NEGLIGIBLE * self.sizes, 1)
        possible = ca.mmin(size) > 0
        for k in range(count):  # the comparison is false for nan
            possible = ca.logic_and(possible, ca.fabs(impulse[k]) < _LARGEST_IMPULSE)
        any_active = ca.mmax(active)
        jump = ca.if_else(any_active, self.effect @ ca.if_else(possible, impulse, float("nan")), 0)
        return x + jump, ca.logic_or(possible, ca.logic_not(any_active))


def impulses_of(compiled: Lowered, s: Symbols) -> Impulses | None:
    """The impulses of a model; None if it has none.

    Raises StructureError: AC210 for a force that does not act on the velocity that it resets, or whose effect depends
    on variables that jump.
    """
    model_impulses = impulses(compiled)
    if not model_impulses:
        return None
    pool, clauses = compiled.solution.structure.reduced.pool, compiled.state_events.clauses
    actions = [action for clause in clauses for action in clause.actions]
    builder = s.defined(compiled)
    # Discrete variables have their values from before the event: a string that is slack does not yet transmit a force.
    before = ca.SX(s.x)
    memory = dict(zip(compiled.mode_nodes, compiled.mode_places, strict=True))
    for k in range(compiled.n_dynamic + compiled.quadratures, len(compiled.states)):
        index = memory.get(pool.make("pre", pool.var(compiled.state_variables[k])))
        before[k] = s.x[k] if index is None else s.m[index]
    impulse_nodes = [pool.nodes[n] for n in builder.replaced(actions[a][1] for a, _ in model_impulses)]
    speeds = ca.vertcat(*builder.lower([node[1] for node in impulse_nodes]))
    values = ca.vertcat(*builder.lower([node[2] for node in impulse_nodes]))
    ode, alg = compiled.rhs(s.t, before, *s.inputs[2:-1], _yielding(compiled, s))
    solver = _Response(compiled, s, alg)
    effects = []
    for a, _ in model_impulses:
        unit = ca.SX(s.x.numel(), 1)
        unit[actions[a][0]] = 1
        effects.append(ca.jacobian(ode, s.x) @ unit + ca.jacobian(ode, s.z) @ solver.of(unit))
    by_x, by_z = ca.jacobian(speeds, s.x), ca.jacobian(speeds, s.z)

    def follow(direction: Any) -> Any:
        return by_x @ direction + by_z @ solver.of(direction)

    velocity_changes = ca.horzcat(*map(follow, effects))
    sizes = ca.vertcat(
        *(ca.fabs(by_x[k, :]) @ ca.fabs(e) + ca.fabs(by_z[k, :]) @ ca.fabs(solver.of(e)) for k, e in enumerate(effects))
    )
    # No check in a regime that fixes the velocity: the event is then handled with the equations of free motion.
    for k, (a, clause) in enumerate(model_impulses if not compiled.varied else []):
        _check(compiled, s, clauses[clause], actions[a][0], effects[k], speeds[k], velocity_changes[k, :], solver)
    return Impulses(
        tuple(a for a, _ in model_impulses), ca.horzcat(*effects), velocity_changes, sizes, values - speeds, follow
    )


def _yielding(compiled: Lowered, s: Symbols) -> Any:
    """The modes, with stuck elements that creep so fast that none of them bears an impulse: their loads are bounded."""
    modes, nodes = ca.SX(s.m), compiled.solution.structure.reduced.pool.nodes
    for place, node in zip(compiled.mode_places, compiled.mode_nodes, strict=True):
        if nodes[node][0] == "infinitesimal":
            modes[place] = _CREEP
    return modes


def struck(compiled: Lowered, acting: Collection[int]) -> Any:
    """`(t, x, z, u, p, m) -> dx[nx]`: jump of the states when the impulses among the actions `acting` act together."""
    s = Symbols(compiled)
    model_impulses = impulses_of(compiled, s)
    jump = ca.SX(s.x.numel(), 1)
    if model_impulses is not None:
        jump = model_impulses.after(s, s.x, [ca.SX(a in acting) for a in model_impulses.actions])[0] - s.x
    return ca.Function("struck", s.inputs, [ca.densify(jump)])


class _Response:
    """Response of the algebraic variables to a change of states, block by block in order to keep structural zeros."""

    def __init__(self, compiled: Lowered, s: Symbols, alg: Any) -> None:
        self.s = s
        self.by_x, self.by_z = ca.jacobian(alg, s.x), ca.jacobian(alg, s.z)
        index_of = {v: k for k, v in enumerate(compiled.solution.algebraic)}
        self.blocks: list[tuple[list[int], list[int]]] = []
        first = 0
        for iterated, residuals in loops(compiled.solution):
            rows = list(range(first, first + len(residuals)))
            self.blocks.append(([index_of[v] for v in iterated], rows))
            first += len(residuals)

    def of(self, direction: Any) -> Any:
        """dz, shape (nz, 1), for a change of states `direction`, shape (nx, 1)."""
        dz = ca.SX(self.s.z.numel(), 1)
        right = ca.SX(self.by_x @ direction)
        for columns, rows in self.blocks:
            rhs = right[rows] + self.by_z[rows, :] @ dz
            rhs = ca.sparsify(rhs)
            if not rhs.nnz():
                continue
            block = self.by_z[rows, columns]
            step = -rhs / block if len(rows) == 1 else -ca.solve(block, ca.densify(rhs))
            for k, column in enumerate(columns):
                dz[column] = step[k]
        return ca.sparsify(dz)


def _check(
    compiled: Lowered,
    s: Symbols,
    clause: Clause,
    force: int,
    effect: Any,
    speed: Any,
    velocity_changes: Any,
    solver: _Response,
) -> None:
    """Raise StructureError AC210 for an impulse that cannot reset its velocity."""
    name = compiled.states[force]
    unit = ca.SX(s.x.numel(), 1)
    unit[force] = 1
    response = solver.of(unit)
    at_once = ca.jacobian(speed, s.x[force]).nnz() or (ca.jacobian(speed, s.z) @ response).nnz()
    jumping = [s.x[k] for k in ca.sparsify(effect).sparsity().row()]
    jumping += [s.z[k] for k in {*response.sparsity().row(), *solver.of(effect).sparsity().row()}]
    changes = jumping and ca.depends_on(ca.vertcat(effect, velocity_changes.T), ca.vertcat(*jumping))
    if not at_once and velocity_changes.nnz() and not changes:
        return
    if at_once:
        fact = f"the variable that {name} is to reset is no velocity"
        cause = "it depends directly on that force, as an acceleration does"
        help_ = "reset a velocity, der(...) of a position, to its value after the impact"
    elif changes:
        fact = f"the impulse of {name} changes what its own effect depends on"
        cause = "the jumps that an impulse causes must be proportional to it, with factors that do not jump themselves"
        help_ = "let the force enter a balance of forces, with a factor that depends on positions only"
    else:
        fact = f"the impulse of {name} moves nothing that determines the velocity it is to reset"
        cause = "no equation leads from the force to the velocity"
        help_ = f"add {name} to the forces of the equation of motion: it is zero between impacts"
    raise StructureError(
        "AC210", f"{compiled.name}: {fact}", where=(clause.where,), evidence=[clause.text], cause=cause, help=help_
    )
