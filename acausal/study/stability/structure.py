"""Structural facts about a model: constraints, index, events, kinks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.flatten.pool import RELATIONS
from acausal.lower.compiled import CompiledModel
from acausal.study.stability.trajectory import Trajectory

_KINKS = frozenset((*RELATIONS, "sign", "min", "max", "fabs", "floor", "ceil"))


@dataclass(frozen=True)
class Facts:
    """Facts about a compiled model."""

    constraints: tuple[str, ...]  # texts of the constraints that had to be differentiated
    # Structural index: how often an equation must be differentiated until all derivatives are determined, including
    # those of algebraic variables. 0 for an ODE, 1 for algebraic variables determined by undifferentiated equations, or
    # for a constraint that is differentiated once and affects rates only.
    index: int
    stabilised: int  # number of constraints (position and velocity level) that are stabilised and projected
    by_invariants: tuple[str, ...]  # variables computed from a linear invariant instead of being integrated
    relations: int  # number of relations of variables that are located as events
    clauses: int  # number of `when` clauses
    kinks: int  # number of branches, signs, minima and maxima of variables that are not located
    instants: tuple[float, ...]  # times at which sources switch, in the run [s]
    algebraic: int


def facts(compiled: CompiledModel, run: Trajectory) -> Facts:
    """Structural facts about a model, and the switching times of its run."""
    structure = compiled.solution.structure
    flat = compiled.flat
    differentiated = {structure.flat_equation(e) for e in structure.integral}
    texts = [flat.text(flat.equations[e]) for e in sorted(differentiated) if e < len(flat.equations)]
    times = np.array(compiled.instants(run.p)).ravel()
    first, last = float(run.result.time[0]), float(run.result.time[-1])
    inside = np.unique(times[np.isfinite(times) & (times > first) & (times < last)])
    return Facts(
        constraints=tuple(dict.fromkeys(texts)),
        index=_index(compiled),
        stabilised=len(structure.invariants),
        by_invariants=_by_invariants(compiled),
        relations=len(compiled.state_events.relations),
        clauses=len(compiled.state_events.clauses),
        kinks=_kinks(compiled),
        instants=tuple(map(float, inside)),
        algebraic=len(compiled.algebraic),
    )


def _index(compiled: CompiledModel) -> int:
    """Structural index of the model.

    Source: J. D. Pryce, A simple structural analysis method for DAEs, BIT 41 (2001) 364: the largest number of
    differentiations of an equation, plus one if there is a variable of which no derivative is solved for. Here that
    variable has to depend, through the blocks, on an equation differentiated so often; otherwise it does not raise the
    index.
    """
    structure = compiled.solution.structure
    pool = structure.reduced.pool
    level: dict[int, int] = {}
    for equation in range(len(structure.residuals)):
        here, count = equation, 0
        while here in structure.integral:
            here, count = structure.integral[here], count + 1
        level[equation] = count
    needs: dict[int, int] = {}
    index = max(level.values(), default=0)
    for block in structure.blocks:
        used = pool.variables_in(*(structure.residuals[row] for row in block.rows))
        most = max([level[row] for row in block.rows] + [needs.get(v, 0) for v in used])
        needs |= dict.fromkeys(block.columns, most)
        is_algebraic = any(v not in pool.integral_of for v in block.columns)
        index = max(index, most + 1 if is_algebraic else most)
    return index


def _by_invariants(compiled: CompiledModel) -> tuple[str, ...]:
    """Variables with a derivative in the equations that are computed from an invariant instead of being integrated."""
    structure = compiled.solution.structure
    if structure.integral:
        return ()
    reduced = structure.reduced
    integral_of = reduced.flat.pool.integral_of
    states = set(compiled.state_variables)
    found = []
    for node in {
        n for e in reduced.flat.equations for n in reduced.flat.pool.variables_in(e.left, e.right) if n in integral_of
    }:
        op, *rest = reduced.pool.nodes[reduced.image[integral_of[node]]]
        if op == "neg":
            op, *rest = reduced.pool.nodes[rest[0]]
        if op == "var" and rest[0] not in states:
            found.append(reduced.flat.scalar_name(integral_of[node]))
    return tuple(sorted(found))


def _kinks(compiled: CompiledModel) -> int:
    solution = compiled.solution
    pool = solution.structure.reduced.pool
    needed = [node for v, node in solution.definitions if v in solution.needed]
    known = {*compiled.time_events.relations, *compiled.state_events.relations}
    found = 0
    for number in pool.reachable([*needed, *solution.residuals]):
        op = pool.nodes[number][0]
        if op in _KINKS and number not in known and pool.variables_in(number):
            found += 1
    return found
