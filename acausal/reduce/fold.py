"""Substitution of constants into a solution: constant variables are removed, and expressions become shorter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from acausal.analyse.analyse import reordered
from acausal.analyse.blocks.solve import BlockReport, Solution, needed, solve
from acausal.analyse.start import imported
from acausal.flatten.pool import LEAVES, Pool
from acausal.flatten.reduced import ReducedSystem
from acausal.reduce.motionless import Constants


def fold(solution: Solution, constants: Constants) -> Solution:
    """The solution without constant variables, whose images become nodes of parameters."""
    structure = solution.structure
    reduced = structure.reduced
    images = _images(solution, constants)
    states = tuple(x for x in structure.states if x not in constants.variables)
    rates = dict.fromkeys(structure.derivative(x) for x in states)
    definitions = (
        *((dx, constants.variables[dx]) for dx in rates if dx in constants.variables),
        *((v, images[n]) for v, n in solution.definitions if v not in constants.variables),
    )
    residuals = tuple(images[r] for r in solution.residuals)
    invariants = tuple((e, images[n]) for e, n in structure.invariants if images[n] != reduced.pool.zero)
    structure = replace(structure, states=states, invariants=invariants, reduced=_folded(reduced, images))
    return Solution(
        structure=structure,
        definitions=definitions,
        algebraic=solution.algebraic,
        residuals=residuals,
        needed=needed(structure, definitions, residuals),
        blocks=_blocks(solution, constants.variables),
        formulation=solution.formulation,
        divisors=tuple(images[d] for d in solution.divisors if d in images),
    )


def resolved(solution: Solution, constants: Constants, formulation: str) -> Solution:
    """The same system solved again with constants for the states that never move, and with decided branches.

    Blocks may fall apart, and divisors may become safe: a body that turns about one axis only has a constant matrix of
    inertia. The states remain; `fold` removes them.
    """
    structure = solution.structure
    pool = structure.reduced.pool
    resting = {x: constants.variables[x] for x in structure.states if x in constants.variables}
    decided = {n: pool.one if holds else pool.zero for n, holds in constants.relations.items()}
    images = rewritten(pool, list(structure.residuals), resting, {**constants.branches, **decided})
    return solve(reordered(structure, [pool.collected(images[r]) for r in structure.residuals]), formulation)


def _images(solution: Solution, constants: Constants) -> dict[int, int]:
    """The image of every node of a solution."""
    reduced = solution.structure.reduced
    roots = [n for _, n in solution.definitions] + [*solution.residuals, *reduced.image, *reduced.initial]
    roots += [*reduced.event_nodes, *(n for _, n in solution.structure.invariants)]
    return rewritten(reduced.pool, roots, constants.variables, {**constants.branches, **constants.equal})


def rewritten(pool: Pool, roots: list[int], variables: Mapping[int, int], nodes: Mapping[int, int]) -> dict[int, int]:
    """Images of all nodes below `roots`; `variables` and `nodes` map variables and nodes to their replacements."""
    done: dict[int, int] = {}
    for number in pool.reachable(roots):
        node = pool.nodes[number]
        if number in nodes:
            equal = nodes[number]
            done[number] = done.get(equal, equal)
        elif node[0] == "var":
            done[number] = variables.get(node[1], number)
        elif node[0] in LEAVES:
            done[number] = number
        else:
            image = tuple(done[c] for c in node[1:])
            done[number] = number if image == node[1:] else pool.make(node[0], *image)
    return done


def _folded(reduced: ReducedSystem, images: Mapping[int, int]) -> ReducedSystem:
    """The reduced system with new images, without the initial equations and starts that have become trivial."""
    pool, flat = reduced.pool, reduced.flat
    image = tuple(images[n] for n in reduced.image)
    kept = [k for k, n in enumerate(reduced.initial) if images[n] != pool.zero]
    starts = {
        s: start
        for s, start in flat.starts.items()
        if pool.variables_in(image[s]) or (start.is_fixed and imported(reduced, start.node) != image[s])
    }
    return replace(
        reduced.with_images(images),
        flat=replace(flat, starts=starts, initial_equations=tuple(flat.initial_equations[k] for k in kept)),
        initial=tuple(images[reduced.initial[k]] for k in kept),
    )


def _blocks(solution: Solution, constant_variables: Mapping[int, int]) -> tuple[BlockReport, ...]:
    """Blocks without the unknowns that are constant."""
    remaining = (
        b._replace(unknowns=tuple(v for v in b.unknowns if v not in constant_variables)) for b in solution.blocks
    )
    return tuple(b for b in remaining if b.unknowns)
