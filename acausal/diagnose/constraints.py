"""Defects of constraints: those that appear only when constraints are differentiated, and overconstrained loops."""

from __future__ import annotations

from collections.abc import Sequence

from acausal.diagnose.causes import probable
from acausal.diagnose.cut_forces import is_cut_force, loop_error
from acausal.diagnose.words import component_of, connector_of, label, lines, listed, made_at, names_of
from acausal.errors import StructureError, counted
from acausal.flatten.flat import FlatEquation, span_of
from acausal.flatten.reduced import ReducedSystem


def differentiated_input(reduced: ReducedSystem, variable: int) -> StructureError:
    """AC207: an input of the model is prescribed where its derivative is needed."""
    flat = reduced.flat
    name = reduced.name(variable)
    names = names_of(flat, [reduced.scalar[variable]])
    users = [
        e
        for e in flat.equations
        if not isinstance(e.source, str) and reduced.scalar[variable] in flat.pool.variables_in(e.left, e.right)
    ]
    owners = listed((label(flat, e.component) for e in users), 2)
    return StructureError(
        "AC207",
        f"{flat.name}: the time derivative of input {name} is needed, which {owners} prescribes as a motion",
        where=[s for e in users[:1] for s in made_at(flat, e.component)] or made_at(flat, ""),
        evidence=[f"the signal reaches: {listed(names)}", *lines(flat, users, 4)],
        cause="only the values of an input are known during a run, not its derivative",
        help="prescribe its highest derivative (Speed or Accelerate instead of Position), or filter it in the model",
    )


def undetermined(reduced: ReducedSystem, left: Sequence[int], open_ones: Sequence[int]) -> StructureError:
    """The error for a system that is balanced, but no longer so after constraints have been differentiated.

    `left` are flat equations that determine nothing, `open_ones` reduced variables without an equation.
    """
    flat = reduced.flat
    error = probable(flat)
    if error is not None:
        return error
    names = [reduced.name(v) for v in open_ones]
    equations = [flat.equations[k] for k in left]
    owners = listed((label(flat, e.component) for e in equations), 3) or flat.name
    return StructureError(
        "AC208",
        f"{flat.name}: once the constraints of {owners} are differentiated, nothing determines {listed(names, 3)}",
        where=[s for e in equations[:2] for s in span_of(e)] or made_at(flat, ""),
        evidence=[f"not determined: {listed(names)}"]
        + (["these equations are left over:", *lines(flat, equations)] if equations else []),
        cause="a constraint follows from the others, possibly only for these values of the parameters",
        help="remove one of the constraints, or change the values that make them equal",
    )


def refuse_if_singular(reduced: ReducedSystem, equation: int, at_last: bool) -> None:
    """Stop an index reduction that does not end because the equations are numerically singular.

    Pantelides' algorithm terminates for structurally regular systems. If coefficients cancel, however, it takes as many
    differentiations as there are equations, and each of them multiplies the size of a nonlinear expression.

    `equation` is the flat equation that is about to be differentiated once more; `at_last` refuses in any case.
    """
    flat = reduced.flat
    error = probable(flat)
    if error is None and at_last:
        e = flat.equations[equation]
        error = StructureError(
            "AC208",
            f"{flat.name}: an equation of {label(flat, e.component)} would have to be differentiated forever",
            where=span_of(e) or made_at(flat, e.component),
            evidence=lines(flat, [e]),
            cause="this constraint follows from the others, or contradicts them",
            help="remove it, or replace a rigid component by a compliant one",
        )
    if error is not None:
        raise error


def overconstrained_loop(reduced: ReducedSystem, undetermined: Sequence[int]) -> StructureError | None:
    """AC206 if the undetermined variables are cut forces around a closed loop of frames.

    `undetermined` are the reduced variables of the under-determined part.
    """
    flat = reduced.flat
    if not flat.loops:
        return None
    scalars = [s for v in undetermined for s in reduced.aliases.get(v, ()) if is_cut_force(flat, s)]
    loop_components = {c for loop in flat.loops for c in loop.components}
    if not any(component_of(flat, flat.owner[s].path) in loop_components for s in scalars):
        return None
    forces = [flat.scalar_name(s) for s in scalars if connector_of(flat, flat.owner[s].path)]
    return loop_error(flat, forces, [])


def redundant_constraints(reduced: ReducedSystem, equations: Sequence[FlatEquation]) -> StructureError:
    """AC206 for constraints, given by their equations, that follow from others in every position of the model."""
    flat = reduced.flat
    if flat.loops:
        return loop_error(flat, [], equations)
    error = probable(flat)
    if error is not None:
        return error
    owners = list(dict.fromkeys(e.component or flat.name for e in equations))
    return StructureError(
        "AC206",
        f"{flat.name}: {counted(len(equations), 'constraint')} of {listed(owners, 3)} cannot be told from the others",
        where=[s for e in equations[:2] for s in span_of(e)] or made_at(flat, ""),
        evidence=lines(flat, equations, 4),
        cause="these constraints follow from the others, or contradict them, in every position of the model",
        help="remove one of them, or replace a rigid component by a compliant one",
    )
