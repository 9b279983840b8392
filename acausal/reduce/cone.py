"""Dependences of outputs: through definitions, blocks, rates of states, events and start conditions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from acausal.analyse.blocks.solve import Solution, needed
from acausal.analyse.start import start_problem
from acausal.flatten.flat import FlatWhen
from acausal.flatten.pool import closure
from acausal.flatten.reduced import ReducedSystem
from acausal.structure import Incidence, match


@dataclass(frozen=True, eq=False)
class Dependence:
    """Direct dependences between the variables of a solution."""

    nodes: dict[int, tuple[int, ...]]  # variable -> nodes, on all variables of which it depends
    at_start: dict[int, frozenset[int]]  # variable -> variables on which its start value depends

    def closure(self, solution: Solution, variables: Iterable[int]) -> frozenset[int]:
        """`variables` and all variables on which they depend, inputs included."""
        pool = solution.structure.reduced.pool
        return frozenset(
            closure(variables, lambda v: pool.variables_in(*self.nodes.get(v, ())) | self.at_start.get(v, frozenset()))
        )


def dependence(solution: Solution) -> Dependence:
    """Direct dependences of all variables of a solution."""
    structure = solution.structure
    reduced = structure.reduced
    nodes: dict[int, list[int]] = {v: [n] for v, n in solution.definitions}
    for iterated, residuals in loops(solution):
        for z in iterated:
            nodes[z] = list(residuals)
    for x in structure.states:
        nodes.setdefault(x, []).append(reduced.pool.var(structure.derivative(x)))
    for _, node in structure.invariants:
        for x in reduced.pool.variables_in(node):
            nodes.setdefault(x, []).append(node)
    for when, when_nodes in zip(reduced.flat.whens, reduced.whens, strict=True):
        for (scalar, _), value in zip(when.actions, when_nodes.values, strict=True):
            for x in reduced.pool.variables_in(reduced.image[scalar]):
                nodes.setdefault(x, []).extend((*when_nodes.guards, value))
    for assignment, value in zip(reduced.flat.assignments, reduced.assignments, strict=True):
        for x in reduced.pool.variables_in(reduced.image[assignment.scalar]):
            nodes.setdefault(x, []).append(value)
    return Dependence({v: tuple(n) for v, n in nodes.items()}, _at_start(solution, nodes))


def _at_start(solution: Solution, nodes: dict[int, list[int]]) -> dict[int, frozenset[int]]:
    """For each state or unknown that a start condition determines, all variables of that condition."""
    start = start_problem(solution)
    if not start.conditions:
        return {}
    given = {*start.direct, *start.defaulted}
    order = [*solution.algebraic, *(x for x in solution.structure.states if x not in given)]
    column_of = {v: k for k, v in enumerate(order)}
    rows = [_variables_at_instant(solution, nodes, c.node) for c in start.conditions]
    rows += [_variables_at_instant(solution, nodes, r) for r in solution.residuals]
    incidence = Incidence.from_rows([sorted(column_of[v] for v in row if v in column_of) for row in rows], len(order))
    return {order[int(c)]: frozenset(row) for c, row in zip(match(incidence), rows, strict=True) if c >= 0}


def _variables_at_instant(solution: Solution, nodes: dict[int, list[int]], node: int) -> set[int]:
    """Variables on which a node depends at one instant: through definitions, but not through rates or blocks."""
    pool = solution.structure.reduced.pool
    ends = {*solution.structure.states, *solution.algebraic}
    return closure(
        pool.variables_in(node), lambda v: frozenset() if v in ends else pool.variables_in(*nodes.get(v, ()))
    )


def loops(solution: Solution) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Iterated unknowns and their residuals, block by block."""
    pairs = []
    first = 0
    for block in solution.blocks:
        if block.iterated:
            last = first + len(block.iterated)
            pairs.append((block.iterated, solution.residuals[first:last]))
            first = last
    assert first == len(solution.residuals), "every residual belongs to a block"
    return pairs


def restrict(solution: Solution, scalars: Sequence[int]) -> Solution:
    """The part of a solution that determines flat scalars.

    Everything else is also left out of results: `left_out` of the reduced system.
    """
    structure = solution.structure
    reduced = structure.reduced
    pool = reduced.pool
    roots = pool.variables_in(*(reduced.image[s] for s in scalars))
    roots |= pool.variables_in(
        *(n for w, found in zip(reduced.flat.whens, reduced.whens, strict=True) if _ends_runs(w) for n in found.guards)
    )
    kept = dependence(solution).closure(solution, roots)
    states = tuple(x for x in structure.states if x in kept)
    structure = replace(
        structure,
        states=states,
        invariants=tuple((e, n) for e, n in structure.invariants if pool.variables_in(n) <= kept),
        reduced=_restricted(reduced, kept, scalars),
    )
    definitions = tuple(d for d in solution.definitions if d[0] in kept)
    kept_loops = [(iterated, residuals) for iterated, residuals in loops(solution) if iterated[0] in kept]
    residuals = tuple(r for _, rows in kept_loops for r in rows)
    blocks = (b._replace(unknowns=tuple(v for v in b.unknowns if v in kept)) for b in solution.blocks)
    return Solution(
        structure=structure,
        definitions=definitions,
        algebraic=tuple(z for iterated, _ in kept_loops for z in iterated),
        residuals=residuals,
        needed=needed(structure, definitions, residuals),
        blocks=tuple(b for b in blocks if b.unknowns),
        formulation=solution.formulation,
        monotone=tuple(m for m in solution.monotone if m.variable in kept),
        divisors=solution.divisors,
    )


def _ends_runs(when: FlatWhen) -> bool:
    """Whether a clause acts on the run as a whole, because it terminates it or has no actions."""
    return when.terminate is not None or not when.actions


def _restricted(reduced: ReducedSystem, kept: frozenset[int], scalars: Sequence[int]) -> ReducedSystem:
    """The reduced system without starts, initial equations, actions and names of variables that are not kept."""
    pool, flat = reduced.pool, reduced.flat

    def is_kept(node: int) -> bool:
        return pool.variables_in(node) <= kept

    initial = [k for k, n in enumerate(reduced.initial) if is_kept(n)]
    asserts = [k for k, n in enumerate(reduced.asserts) if is_kept(n)]
    unchecked = [a.message for k, a in enumerate(flat.asserts) if k not in asserts]
    note = f"not checked, because no output depends on its variables: {'; '.join(unchecked)}"
    assigned = [k for k, a in enumerate(flat.assignments) if is_kept(reduced.image[a.scalar])]
    whens, when_nodes = [], []
    for when, nodes in zip(flat.whens, reduced.whens, strict=True):
        kept_actions = [k for k, (s, _) in enumerate(when.actions) if pool.variables_in(reduced.image[s]) & kept]
        if kept_actions or _ends_runs(when):
            whens.append(when._replace(actions=tuple(when.actions[k] for k in kept_actions)))
            when_nodes.append(nodes._replace(values=tuple(nodes.values[k] for k in kept_actions)))
    return replace(
        reduced,
        flat=replace(
            flat,
            # An input on which nothing depends any more still has its declared value.
            starts={s: start for s, start in flat.starts.items() if s in flat.inputs or is_kept(reduced.image[s])},
            initial_equations=tuple(flat.initial_equations[k] for k in initial),
            whens=tuple(whens),
            assignments=tuple(flat.assignments[k] for k in assigned),
            asserts=tuple(flat.asserts[k] for k in asserts),
            notes=(*flat.notes, note) if unchecked else flat.notes,
        ),
        initial=tuple(reduced.initial[k] for k in initial),
        whens=tuple(when_nodes),
        assignments=tuple(reduced.assignments[k] for k in assigned),
        asserts=tuple(reduced.asserts[k] for k in asserts),
        left_out=_left_out(reduced, kept, scalars),
    )


def _left_out(reduced: ReducedSystem, kept: frozenset[int], scalars: Sequence[int]) -> frozenset[int]:
    """Scalars without a trajectory in results: neither requested nor available without further computation."""
    requested = set(scalars)
    pool = reduced.pool

    def is_available(node: int) -> bool:
        inner = pool.nodes[node][1] if pool.nodes[node][0] == "neg" else node
        return pool.nodes[inner][1] in kept if pool.nodes[inner][0] == "var" else not pool.variables_in(node)

    return frozenset(s for s, node in enumerate(reduced.image) if s not in requested and not is_available(node))
