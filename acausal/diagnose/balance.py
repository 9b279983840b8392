"""Structural balance of the reduced system, by the decomposition of Dulmage and Mendelsohn."""

from __future__ import annotations

from collections.abc import Sequence

from acausal.diagnose.causes import probable
from acausal.diagnose.components import unbalanced_component
from acausal.diagnose.constraints import overconstrained_loop
from acausal.diagnose.words import component_of, hint, label, lines, listed, made_at, names_of, places
from acausal.errors import StructureError, counted
from acausal.flatten.flat import FlatEquation, span_of
from acausal.flatten.reduced import ReducedSystem
from acausal.structure import Incidence, dulmage_mendelsohn, match, minimal_over, minimal_under


def balance(reduced: ReducedSystem) -> None:
    """Refuse systems whose equations cannot determine the unknowns; a derivative counts as its variable.

    Raises StructureError with the probable cause (AC203 ... AC209) if one is found; else AC201 if an unknown has no
    equation, AC202 if there is an equation too many, with the smallest set of equations and unknowns that proves it.
    """
    root = _roots(reduced)
    chains = sorted({root[v] for v in range(reduced.pool.n_variables)} - set(reduced.inputs))
    column_of = {v: k for k, v in enumerate(chains)}
    rows = [
        sorted({column_of[root[v]] for v in reduced.pool.variables_in(r) if root[v] in column_of})
        for r in reduced.residuals
    ]
    incidence = Incidence.from_rows(rows, len(chains))
    matched = match(incidence)
    if len(rows) == len(chains) and not (matched < 0).any():
        refuse_superfluous(reduced)
        return
    parts = dulmage_mendelsohn(incidence, matched)
    loop = overconstrained_loop(reduced, [chains[c] for c in parts.under_columns])
    cause = loop or probable(reduced.flat, by_structure=True)
    if cause is not None:
        raise cause
    equations = [reduced.flat.equations[k] for k in reduced.equation]
    free_columns = sorted(set(parts.under_columns) - {int(c) for c in matched if c >= 0})
    free_rows = [r for r in parts.over_rows if matched[r] < 0]
    over = min((minimal_over(incidence, r, matched) for r in free_rows), key=lambda s: len(s.rows), default=None)
    surplus = [equations[r] for r in over.rows] if over is not None else []
    if free_columns:
        subsets = [minimal_under(incidence, c, matched) for c in free_columns]
        smallest = min(subsets, key=lambda s: len(s.columns))
        variables = [chains[c] for c in smallest.columns]
        raise _under(reduced, variables, [equations[r] for r in smallest.rows], len(free_columns), surplus)
    raise _over(reduced, surplus, [chains[c] for c in over.columns] if over else [], len(free_rows))


def refuse_superfluous(reduced: ReducedSystem) -> None:
    """Refuse a model with too many equations although the system is balanced, as redundant ones have been left out."""
    flat = reduced.flat
    if len(flat.equations) <= flat.n_scalars - len(flat.inputs):
        return
    error = unbalanced_component(flat)
    if error is None:
        error = _over(reduced, [flat.equations[k] for k in reduced.redundant if k >= 0], [], 1)
    raise error


def _roots(reduced: ReducedSystem) -> list[int]:
    integral = reduced.pool.integral_of
    root = list(range(reduced.pool.n_variables))
    for v in range(reduced.pool.n_variables):
        r = v
        while r in integral:
            r = integral[r]
        root[v] = r
    return root


def _under(
    reduced: ReducedSystem,
    variables: Sequence[int],
    equations: list[FlatEquation],
    missing: int,
    surplus: list[FlatEquation],
) -> StructureError:
    flat = reduced.flat
    scalars = [reduced.scalar[v] for v in variables if v < len(reduced.scalar)]
    names = names_of(flat, (s for v in variables for s in reduced.aliases.get(v, ())))
    components = list(dict.fromkeys(component_of(flat, n) for n in names))
    evidence = [f"under-determined part ({counted(len(equations), 'equation')}, {counted(len(variables), 'unknown')}):"]
    evidence += [f"  unknowns: {listed(names, 8)}", *lines(flat, equations)]
    if surplus:
        evidence += ["while these are too many for their unknowns:", *lines(flat, surplus, 4)]
    redundant = [flat.equations[k] for k in reduced.redundant if k >= 0]
    if redundant:
        evidence += ["while this follows from other equations:", *lines(flat, redundant, 3)]
    cause, advice = hint(flat.declaration(s) for s in scalars)
    return StructureError(
        "AC201",
        f"{flat.name}: {counted(missing, 'equation')} too few: {listed(names, 3)} cannot be determined",
        where=[s for c in components[:2] for s in made_at(flat, c)] or [s for e in equations[:1] for s in span_of(e)],
        evidence=evidence,
        cause=cause or "an equation is missing, or a connector is not connected",
        help=advice or "state one more equation for these variables, or connect a component that determines them",
    )


def _over(
    reduced: ReducedSystem, equations: list[FlatEquation], variables: Sequence[int], surplus: int
) -> StructureError:
    flat = reduced.flat
    components = listed((label(flat, e.component) for e in equations), 3)
    names = [reduced.name(v) for v in variables]
    unknowns = f"for {counted(len(names), 'unknown')}: {listed(names, 3)}" if names else "in which no unknown is left"
    return StructureError(
        "AC202",
        f"{flat.name}: {counted(surplus, 'equation')} too many: {components} "
        f"state {counted(len(equations), 'equation')} {unknowns}",
        where=places(flat, equations) or made_at(flat, ""),
        evidence=lines(flat, equations, 8),
        cause="one quantity is prescribed twice",
        help="remove one of these equations or connections",
    )
