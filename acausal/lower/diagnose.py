"""Structural singularity in the user's terms: which equations, which variables, where, and why."""

from __future__ import annotations

from acausal.errors import Span, StructureError
from acausal.flatten.flat import FlatEquation, span_of
from acausal.lower.reduce import ReducedSystem
from acausal.structure import Incidence, dulmage_mendelsohn, match, minimal_over, minimal_under


def balance(reduced: ReducedSystem) -> None:
    """Refuse systems whose equations cannot determine the unknowns, derivatives counting as their variable.

    Raises
    ------
    StructureError
        AC201 when an unknown has no equation, AC202 when there is an equation too many.
    """
    root = _roots(reduced)
    chains = sorted({root[v] for v in range(reduced.pool.n_variables)} - set(reduced.inputs))
    place = {v: k for k, v in enumerate(chains)}
    rows = [
        sorted({place[root[v]] for v in reduced.pool.variables_in(r) if root[v] in place}) for r in reduced.residuals
    ]
    incidence = Incidence.from_rows(rows, len(chains))
    matched = match(incidence)
    if len(rows) == len(chains) and not (matched < 0).any():
        return
    parts = dulmage_mendelsohn(incidence, matched)
    free_columns = sorted(set(parts.under_columns) - {int(c) for c in matched if c >= 0})
    free_rows = [r for r in parts.over_rows if matched[r] < 0]
    equations = [reduced.flat.equations[k] for k in reduced.equation]
    if free_columns:
        found = [minimal_under(incidence, c, matched) for c in free_columns]
        smallest = min(found, key=lambda s: len(s.columns))
        raise _under(
            reduced,
            [chains[c] for c in smallest.columns],
            [equations[r] for r in smallest.rows],
            len(free_columns),
            [equations[r] for r in free_rows],
        )
    smallest = min((minimal_over(incidence, r, matched) for r in free_rows), key=lambda s: len(s.rows))
    raise _over(reduced, [equations[r] for r in smallest.rows], [chains[c] for c in smallest.columns], len(free_rows))


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
    reduced: ReducedSystem, variables: list[int], equations: list[FlatEquation], missing: int, surplus: list[FlatEquation]
) -> StructureError:
    flat = reduced.flat
    names = [reduced.name(v) for v in variables]
    declarations = [flat.declaration(reduced.scalar[v]) for v in variables if v < len(reduced.scalar)]
    hints = list(dict.fromkeys(d.hint for d in declarations if d.hint))
    evidence = [f"not determined: {_listed(names)}"]
    if equations:
        evidence.append(f"by the {len(equations)} equation(s) they occur in:")
        evidence += [f"  {e.source}   ({e.component or flat.name})" for e in equations[:6]]
    redundant = [flat.equations[k] for k in reduced.redundant] + surplus
    if redundant:
        evidence.append("while these follow from others:")
        evidence += [f"  {e.source}   ({e.component or flat.name})" for e in redundant[:3]]
    inputs = _unconnected_inputs(reduced, variables)
    if inputs:
        return StructureError(
            "AC203" if False else "AC209",
            f"input {inputs[0]} is not connected",
            where=_where_variable(reduced, variables[0]),
            evidence=evidence,
            cause="a signal_input needs a signal",
            help=f"connect it to an output, or bind it: ...({inputs[0].rsplit('.', 1)[-1]}=0.0)",
        )
    n_unknowns = missing
    return StructureError(
        "AC201",
        f"{flat.name} has {n_unknowns} equation(s) too few: {_listed(names, 3)} cannot be determined",
        where=[s for e in equations[:1] for s in span_of(e)] or _where_variable(reduced, variables[0]),
        evidence=evidence,
        cause=hints[0] if hints else "an equation is missing, or a connector is not connected",
        help="state one more equation for these variables, or connect the component to what determines them",
    )


def _over(reduced: ReducedSystem, equations: list[FlatEquation], variables: list[int], surplus: int) -> StructureError:
    flat = reduced.flat
    return StructureError(
        "AC202",
        f"{flat.name} has {surplus} equation(s) too many: "
        f"{len(equations)} equations for {len(variables)} unknown(s) {_listed([reduced.name(v) for v in variables], 3)}",
        where=[s for e in equations[:2] for s in span_of(e)],
        evidence=[f"{e.source}   ({e.component or flat.name})" for e in equations[:8]],
        cause="one quantity is prescribed twice",
        help="remove one of these equations or connections",
    )


def _unconnected_inputs(reduced: ReducedSystem, variables: list[int]) -> list[str]:
    found = []
    for v in variables:
        for scalar in reduced.aliases.get(v, ()):
            declared = reduced.flat.owner.get(scalar)
            if declared is not None and declared.declaration.kind.value == "input":
                found.append(reduced.flat.scalar_name(scalar))
    return found


def _where_variable(reduced: ReducedSystem, variable: int) -> list[Span]:
    return []


def _listed(names: list[str], limit: int = 6) -> str:
    shown = ", ".join(names[:limit])
    return shown + (f" and {len(names) - limit} more" if len(names) > limit else "")
