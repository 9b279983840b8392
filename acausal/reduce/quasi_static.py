"""Stiff modes in their quasi-static limit: states that follow others instantaneously, as if their rates were zero.

With `eps x' = f(x, y)` and a stable f, the state x settles at f(x, y) = 0 within a time of order eps. The slow motion
of y remains, with an error of order eps after this initial layer. Here the rate of a named state, and all higher
derivatives, become zero, and its differential equation determines the state itself. The quasi-static limit of a
position includes its velocity; that of a velocity alone neglects the inertia.

Source: A. N. Tikhonov, Systems of differential equations with small parameters, Mat. Sb. 31 (1952) 575-586;
P. Kokotovic, H. Khalil, J. O'Reilly, Singular Perturbation Methods in Control (1986), chapter 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from acausal.analyse.analyse import Structure, reordered
from acausal.analyse.blocks.solve import Solution, solve
from acausal.errors import StructureError, UsageError, meant
from acausal.flatten.pool import Pool
from acausal.flatten.reduced import ReducedSystem
from acausal.reduce.fold import rewritten


def quasi_static(solution: Solution, names: Sequence[str], formulation: str) -> Solution:
    """The solution with the named states in their quasi-static limit.

    Raises UsageError: AC026 for a name that is not a state of the model, or a state without such a limit: one that an
    event sets, or one of a stabilised constraint.
    Raises StructureError: AC211 if the equations without these rates do not determine the states.

    `names` are states, or aliases of states up to sign; a component stands for all its states.
    """
    structure = solution.structure
    fast = states_named(structure, names)
    _check(structure, fast, names)
    pool = structure.reduced.pool
    zero_rates = _rates(pool, fast)
    fast -= zero_rates
    states = tuple(x for x in structure.states if x not in fast and x not in zero_rates)
    zeros = dict.fromkeys(zero_rates, pool.zero)
    images = rewritten(pool, list(structure.residuals), zeros, {})
    residuals = [pool.collected(images[r]) for r in structure.residuals]
    changed = replace(structure, reduced=_without(structure.reduced, zeros, fast))
    try:
        return solve(reordered(changed, residuals, states, zero_rates), formulation)
    except StructureError as error:
        raise StructureError(
            "AC211",
            f"no quasi-static limit for {', '.join(names)}: the rates do not depend on the states themselves",
            evidence=[error.fact, *error.evidence],
            cause="a position without a spring can come to rest anywhere",
            help="name the velocity alone, which neglects the inertia, or the whole stiff component",
        ) from None


def states_named(structure: Structure, names: Sequence[str]) -> set[int]:
    """The states that names stand for.

    Raises UsageError: AC026 for a name that stands for no state.
    """
    reduced = structure.reduced
    states = set(structure.states)
    states_of: dict[str, set[int]] = {}
    for x in structure.states:
        for name in (reduced.name(x), *(reduced.flat.scalar_name(s) for s in reduced.aliases.get(x, ()))):
            states_of.setdefault(name, set()).add(x)
    named: set[int] = set()
    for name in names:
        fitting = states_of.get(name) or {
            x for x in states for state_name in [reduced.name(x)] if state_name.startswith((name + ".", name + "["))
        }
        if not fitting:
            raise UsageError(
                "AC026",
                f"'{name}' is no state of {reduced.flat.name}",
                evidence=meant(name, list(states_of)),
                help="states: " + ", ".join(reduced.name(x) for x in structure.states[:12]),
            )
        named |= fitting
    return named


def _check(structure: Structure, fast: set[int], names: Sequence[str]) -> None:
    reduced = structure.reduced
    pool = reduced.pool
    set_by_events = {s for when in reduced.flat.whens for s, _ in when.actions}
    set_by_events |= {a.scalar for a in reduced.flat.assignments}
    bound = pool.variables_in(*(reduced.image[s] for s in set_by_events))
    constrained = pool.variables_in(*(n for _, n in structure.invariants))
    for x in fast & (bound | constrained):
        why = "an event sets it" if x in bound else "it is part of a stabilised constraint"
        raise UsageError("AC026", f"{reduced.name(x)} cannot be quasi-static: {why}")


def _rates(pool: Pool, states: set[int]) -> frozenset[int]:
    """All derivatives of variables."""
    derivatives = set()
    for x in states:
        while x in pool.derivative_of:
            x = pool.derivative_of[x]
            derivatives.add(x)
    return frozenset(derivatives)


def _without(reduced: ReducedSystem, zeros: dict[int, int], fast: set[int]) -> ReducedSystem:
    """The reduced system without rates that are zero; the starts of quasi-static states become guesses."""
    pool, flat = reduced.pool, reduced.flat
    roots = [*reduced.image, *reduced.initial, *reduced.event_nodes]
    images = rewritten(pool, roots, zeros, {})
    free = {*fast, *zeros}
    # Conditions for the start of a fast state would now contradict its equation.
    kept = [k for k, n in enumerate(reduced.initial) if not pool.variables_in(n) & free]
    starts = {
        s: start._replace(is_fixed=start.is_fixed and not pool.variables_in(reduced.image[s]) & free)
        for s, start in flat.starts.items()
    }
    return replace(
        reduced.with_images(images),
        flat=replace(flat, starts=starts, initial_equations=tuple(flat.initial_equations[k] for k in kept)),
        initial=tuple(images[reduced.initial[k]] for k in kept),
    )
