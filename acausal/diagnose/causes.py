"""The probable cause of a singular model: finders in the order in which causes explain each other."""

from __future__ import annotations

from acausal.diagnose.components import unbalanced_component
from acausal.diagnose.cut_forces import constrained_loop
from acausal.diagnose.inputs import open_inputs
from acausal.diagnose.null_space.combinations import (
    dependent_equations,
    empty_equation,
    open_motion,
    special_defaults,
    special_values,
)
from acausal.diagnose.null_space.pencil import pencil
from acausal.diagnose.null_space.references import flow_twice, potential_twice, without_reference
from acausal.diagnose.words import label, line, made_at
from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation, FlatSystem, span_of


def probable(flat: FlatSystem, *, by_structure: bool = False) -> StructureError | None:
    """The error that names the cause, or None when none of the known ones is found.

    It is asked only when a model has been found singular, so that sound models pay nothing.

    Parameters
    ----------
    by_structure
        The structure alone shows that the model is singular: then the smallest set of equations that proves it says
        more than numbers do, unless a single equation holds no unknown.
    """
    found = open_inputs(flat)
    if found is None and (by_structure or len(flat.equations) != flat.n_scalars - len(flat.inputs)):
        found = unbalanced_component(flat)
    if found is not None:
        return found
    numbers = pencil(flat)
    last = empty_equation if by_structure else dependent_equations
    for finder in (
        constrained_loop,
        potential_twice,
        special_values,
        without_reference,
        flow_twice,
        special_defaults,
        open_motion,
        last,
    ):
        found = finder(numbers)
        if found is not None:
            return found
    return None


def contradiction(flat: FlatSystem, equation: FlatEquation, value: float) -> StructureError:
    """The error for an equation that reads `value == 0` once everything known has been put in: the cause, or AC205."""
    found = probable(flat)
    if found is not None:
        return found
    return StructureError(
        "AC205",
        f"{flat.name}: an equation of {label(flat, equation.component)} contradicts the others",
        where=span_of(equation) or made_at(flat, equation.component),
        evidence=[line(flat, equation), f"with everything known put in it reads 0 == {-value:g}"],
        cause="two components prescribe the same quantity with different values",
        help="remove one of the prescriptions, or put something compliant between them",
    )
