"""Closed loops of frames that are constrained more than they can move."""

from __future__ import annotations

from collections.abc import Sequence

from acausal.diagnose.causes import probable
from acausal.diagnose.cut_forces import is_cut_force, loop_error
from acausal.diagnose.words import component_of, connector_of, counted, lines, listed, made_at
from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation, span_of
from acausal.flatten.reduced import ReducedSystem


def overconstrained_loop(reduced: ReducedSystem, undetermined: Sequence[int]) -> StructureError | None:
    """AC206 when cut forces around a closed loop of frames are what cannot be determined.

    `undetermined`: Reduced variables of the under-determined part.
    """
    flat = reduced.flat
    if not flat.loops:
        return None
    scalars = [s for v in undetermined for s in reduced.aliases.get(v, ()) if is_cut_force(flat, s)]
    around = {c for loop in flat.loops for c in loop.components}
    if not any(component_of(flat, flat.owner[s].path) in around for s in scalars):
        return None
    forces = [flat.scalar_name(s) for s in scalars if connector_of(flat, flat.owner[s].path)]
    return loop_error(flat, forces, [])


def redundant_constraints(reduced: ReducedSystem, equations: Sequence[FlatEquation]) -> StructureError:
    """AC206 for constraints, by their equations, that follow from others wherever the model can be."""
    flat = reduced.flat
    if flat.loops:
        return loop_error(flat, [], equations)
    found = probable(flat)
    if found is not None:
        return found
    owners = list(dict.fromkeys(e.component or flat.name for e in equations))
    return StructureError(
        "AC206",
        f"{flat.name}: {counted(len(equations), 'constraint')} of {listed(owners, 3)} cannot be told from the others",
        where=[s for e in equations[:2] for s in span_of(e)] or made_at(flat, ""),
        evidence=lines(flat, equations, 4),
        cause="these constraints follow from the others, or contradict them, wherever the model can be",
        help="remove one of them, or replace a rigid component by one that can give way",
    )
