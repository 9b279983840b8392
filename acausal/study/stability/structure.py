"""What the equations themselves say before any number: constraints, events, kinks, scales."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.flatten.pool import RELATIONS
from acausal.lower.compiled import CompiledModel
from acausal.study.stability.trajectory import Trajectory

_KINKS = frozenset((*RELATIONS, "sign", "min", "max", "fabs", "floor", "ceil"))


@dataclass(frozen=True)
class Facts:
    """Facts about a compiled model.

    Attributes
    ----------
    constraints
        Texts of the constraints that had to be differentiated: the model is a DAE of index 2 or more.
    stabilised
        Number of constraints (of position and of velocity) that are kept by stabilisation and projection.
    by_invariants
        Variables that follow from a linear invariant instead of being integrated.
    relations
        Number of relations of variables that are located as events.
    clauses
        Number of `when` clauses.
    kinks
        Number of branches, signs, minima and maxima of variables that are not located.
    instants
        Times at which sources switch, in the run [s].
    """

    constraints: tuple[str, ...]
    stabilised: int
    by_invariants: tuple[str, ...]
    relations: int
    clauses: int
    kinks: int
    instants: tuple[float, ...]
    algebraic: int


def facts(compiled: CompiledModel, run: Trajectory) -> Facts:
    """Facts about a model and the times of its run."""
    structure = compiled.solution.structure
    flat = compiled.flat
    differentiated = {structure.flat_equation(e) for e in structure.integral}
    texts = [flat.text(flat.equations[e]) for e in sorted(differentiated) if e < len(flat.equations)]
    times = np.array(compiled.instants(run.p)).ravel()
    first, last = float(run.result.time[0]), float(run.result.time[-1])
    inside = np.unique(times[np.isfinite(times) & (times > first) & (times < last)])
    return Facts(
        constraints=tuple(dict.fromkeys(texts)),
        stabilised=len(structure.invariants),
        by_invariants=_by_invariants(compiled),
        relations=len(compiled.state_events.relations),
        clauses=len(compiled.state_events.clauses),
        kinks=_kinks(compiled),
        instants=tuple(map(float, inside)),
        algebraic=len(compiled.algebraic),
    )


def _by_invariants(compiled: CompiledModel) -> tuple[str, ...]:
    """Variables with a derivative in the equations that are not integrated, index reduction not being the reason."""
    structure = compiled.solution.structure
    if structure.integral:
        return ()
    reduced = structure.reduced
    own = reduced.flat.pool.integral_of
    kept = set(compiled.state_variables)
    found = []
    for node in {
        n for e in reduced.flat.equations for n in reduced.flat.pool.variables_in(e.left, e.right) if n in own
    }:
        op, *rest = reduced.pool.nodes[reduced.image[own[node]]]
        if op == "neg":
            op, *rest = reduced.pool.nodes[rest[0]]
        if op == "var" and rest[0] not in kept:
            found.append(reduced.flat.scalar_name(own[node]))
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
