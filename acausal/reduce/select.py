"""The smallest model that computes requested outputs: the passes between solving and lowering, and what they omit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from acausal.analyse.blocks.solve import Solution
from acausal.errors import StructureError
from acausal.reduce.cone import restrict
from acausal.reduce.fold import fold, resolved
from acausal.reduce.motionless import Constants, constants
from acausal.reduce.outputs import output_scalars
from acausal.reduce.quasi_static import quasi_static

_MOST_ROUNDS = 4


@dataclass(frozen=True)
class Dropped:
    """Something that is not part of the reduced model; `kind` is one of KINDS."""

    kind: str
    name: str
    why: str


KINDS = ("parameter", "contact", "motionless", "relation", "quasi-static", "state", "unknown", "event", "assert")


@dataclass(frozen=True)
class Selection:
    """The requested outputs, and what was left out of the model."""

    outputs: tuple[str, ...] | None  # full names of the requested outputs; None if all were requested
    constant: tuple[str, ...]  # those of them that depend on parameters only
    dropped: tuple[Dropped, ...]  # parts of the full model that this one lacks, with the reasons


def select(
    solution: Solution, outputs: Sequence[str] | None, at_once: Sequence[str], formulation: str
) -> tuple[Solution, Selection]:
    """Fold constants, then keep everything on which the outputs depend; None keeps everything that varies.

    `at_once` names states that are replaced by their quasi-static limit.

    Raises UsageError: AC010 or AC018, see `acausal.reduce.outputs`; AC026, see `acausal.reduce.quasi_static`.
    """
    flat = solution.structure.reduced.flat
    scalars = output_scalars(flat, outputs) if outputs is not None else None
    dropped = [Dropped("parameter", name, "frozen: a number now") for name in flat.frozen]
    if at_once:
        full = solution
        solution = quasi_static(full, at_once, formulation)
        name = full.structure.reduced.name
        removed = [name(x) for x in full.structure.states if x not in solution.structure.states]
        dropped += [Dropped("quasi-static", x, "follows instantaneously, as requested") for x in removed]
    solution, fixed = _folded(solution, formulation)
    dropped += _constant(solution, fixed)
    solution = fold(solution, fixed)
    if scalars is None:
        return solution, Selection(None, (), tuple(dict.fromkeys(dropped)))
    whole, solution = solution, restrict(solution, tuple(scalars.values()))
    dropped += _without_effect(whole, solution)
    reduced = whole.structure.reduced
    constant = [n for n, s in scalars.items() if not reduced.pool.varies(reduced.image[s])]
    return solution, Selection(tuple(scalars), tuple(constant), tuple(dict.fromkeys(dropped)))


def _folded(solution: Solution, formulation: str) -> tuple[Solution, Constants]:
    """The system solved with all constants that can be found; each new solution may reveal more of them."""
    fixed = constants(solution)
    for _ in range(_MOST_ROUNDS):
        before = fixed
        if not (fixed.relations or any(x in fixed.variables for x in solution.structure.states)):
            break
        try:
            again = resolved(solution, fixed, formulation)
        except StructureError:
            break  # a term that keeps the equations independent is zero in this motion; the general solution holds
        solution, fixed = again, constants(again)
        # Relations that were decided before occur in no equation any more.
        fixed = replace(fixed, relations={**before.relations, **fixed.relations})
        if fixed.variables.keys() == before.variables.keys() and fixed.relations == before.relations:
            break
    return solution, fixed


def _constant(solution: Solution, fixed: Constants) -> list[Dropped]:
    reduced = solution.structure.reduced
    dropped = [
        Dropped("motionless", reduced.name(x), f"stays at {reduced.text(fixed.variables[x])}")
        for x in solution.structure.states
        if x in fixed.variables
    ]
    for number, holds in fixed.relations.items():
        dropped.append(Dropped("relation", reduced.text(number), "always holds" if holds else "never holds"))
    return dropped


def _without_effect(whole: Solution, part: Solution) -> list[Dropped]:
    reduced, kept = whole.structure.reduced, part.structure.reduced
    why = "no output depends on it"
    states, unknowns = set(part.structure.states), set(part.algebraic)
    dropped = [Dropped("state", reduced.name(x), why) for x in whole.structure.states if x not in states]
    dropped += [Dropped("unknown", reduced.name(z), why) for z in whole.algebraic if z not in unknowns]
    sources = [w.source for w in kept.flat.whens]
    lost = [w.source for w in reduced.flat.whens if not any(w.source is s for s in sources)]
    dropped += [Dropped("event", str(source), why) for source in lost]
    messages = [a.source for a in kept.flat.asserts]
    dropped += [
        Dropped("assert", a.message, "its variables were left out")
        for a in reduced.flat.asserts
        if not any(a.source is m for m in messages)
    ]
    return dropped
