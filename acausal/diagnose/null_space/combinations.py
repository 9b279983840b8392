"""Combinations of equations in which the unknowns cancel, and the unknowns that they leave undetermined."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.diagnose.null_space.pencil import Pencil, Vector, null_vectors, pencil_rows
from acausal.diagnose.null_space.references import demand, touch, verdict
from acausal.diagnose.words import (
    connector_of,
    equations_of,
    hint,
    label,
    lines,
    listed,
    loose,
    made_at,
    names_of,
    places,
)
from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation, FlatSystem

_MOST_PARAMETERS = 40
_MOST_SCALARS = 800


def special_values(numbers: Pencil) -> StructureError | None:
    """AC204 if equations depend on each other only because of values that were given to some parameters."""
    return _special_values(numbers, _at_default(numbers.flat))


def special_defaults(numbers: Pencil) -> StructureError | None:
    """Like `special_values` for default values, such as an effect that is off by default: less plausible causes."""
    return _special_values(numbers, set())


def _at_default(flat: FlatSystem) -> set[int]:
    """Free parameters that have their declared default."""
    at_default = set()
    for p in flat.parameters:
        default = p.declaration.default
        if p.free and isinstance(default, int | float):
            entries = [flat.pool.nodes[node][1] for node in p.nodes]
            at_default |= {k for k in entries if flat.parameter_values[k] == default}
    return at_default


def _special_values(numbers: Pencil, excluded: set[int]) -> StructureError | None:
    flat = numbers.flat
    for y in numbers.dependent():
        if len(y) > 200:
            continue
        decisive = [k for k in _decisive_parameters(flat, sorted(y)) if _cures(numbers, k)]
        if not excluded.issuperset(decisive):
            shown = [f"{flat.parameter_names[k]} = {flat.parameter_values[k]:g}" for k in decisive]
            error = combined(numbers, y)
            error.fact = f"{error.fact} for {listed(shown, 4)}"
            error.cause = "with other values of these parameters the equations would determine their unknowns"
            names = listed((flat.parameter_names[k] for k in decisive), 4)
            error.help = f"change {names}, or model the effect that this value neglects"
            return error
    return None


def _decisive_parameters(flat: FlatSystem, rows: Sequence[int]) -> list[int]:
    """Free parameters of which each, if changed alone, makes the rows independent."""
    equations = [flat.equations[i] for i in rows]
    nodes = flat.pool.reachable([n for e in equations for n in (e.left, e.right)])
    parameters = [flat.pool.nodes[n][1] for n in nodes if flat.pool.nodes[n][0] == "par"]
    if not 0 < len(parameters) <= _MOST_PARAMETERS:
        return []
    decisive = []
    for k in parameters:
        matrix = pencil_rows(flat, rows, _changed(flat, k)).toarray()
        matrix = matrix[:, np.any(matrix != 0.0, axis=0)]
        size = np.linalg.svd(matrix, compute_uv=False)
        if len(size) == len(rows) and size[-1] > 1e-9 * size[0]:
            decisive.append(k)
    return decisive


def _cures(numbers: Pencil, parameter: int) -> bool:
    """True if another value of the parameter reduces the number of dependent combinations in the whole system."""
    flat = numbers.flat
    if flat.n_scalars > _MOST_SCALARS:
        return True
    matrix = pencil_rows(flat, range(len(flat.equations)), _changed(flat, parameter))
    return len(null_vectors(matrix)[0]) < len(numbers.dependent())


def _changed(flat: FlatSystem, parameter: int) -> list[float]:
    values = list(flat.parameter_values)
    values[parameter] = 0.61 if values[parameter] == 0.0 else values[parameter] * 1.37
    return values


def open_motion(numbers: Pencil) -> StructureError | None:
    """AC201 if a variable whose declaration has a hint can move freely."""
    flat = numbers.flat
    for d in numbers.free():
        hinted = [k for k in d if flat.owner[k].declaration.hint and connector_of(flat, flat.owner[k].path) is None]
        if not hinted:
            continue
        hinted.sort(key=lambda k: (flat.declaration(k).prefer_state is not True, k))
        first = flat.owner[hinted[0]]
        path = first.path.rpartition(".")[0]
        cause, advice = hint([first.declaration])
        dependent_rows = [y for y in numbers.dependent() if touch(flat, y, d)]
        evidence = [f"free with it: {listed([n for n in names_of(flat, hinted) if n != first.path], 4)}"]
        for y in dependent_rows[:1]:
            evidence += [
                "because these do not determine it:",
                *lines(flat, [flat.equations[i] for i in sorted(y)], 4),
            ]
        ends = _loose_frames(flat, path)
        if ends:
            cause = f"{listed(ends)} is not connected, so it carries neither force nor torque"
            advice = f"connect {listed(ends)}, for example to a World or a body"
        return StructureError(
            "AC201",
            f"{flat.name}: nothing determines {flat.scalar_name(hinted[0])}"
            + (f": {listed(ends)} is not connected" if ends else ""),
            where=made_at(flat, path),
            evidence=evidence,
            cause=cause,
            help=advice or f"connect {label(flat, path)} to a component that determines it",
        )
    return None


def _loose_frames(flat: FlatSystem, path: str) -> list[str]:
    """Overconstrained connectors of a component to which nothing is connected."""
    frames = [
        name
        for name, c in flat.components.items()
        if c.is_connector
        and name.rpartition(".")[0] == path
        and any(d.overconstrained for d in c.cls._declarations.values())
    ]
    return loose(flat, frames)


def dependent_equations(numbers: Pencil) -> StructureError | None:
    """AC204 if the unknowns cancel in a combination of equations, although all could be matched."""
    for y in numbers.dependent():
        return combined(numbers, y)
    return None


def empty_equation(numbers: Pencil) -> StructureError | None:
    """AC204 if a single equation contains no unknown."""
    for y in numbers.dependent():
        if len(y) == 1:
            return combined(numbers, y)
    return None


def combined(numbers: Pencil, y: Vector) -> StructureError:
    """The error for one combination of equations in which the unknowns cancel."""
    flat = numbers.flat
    equations = [flat.equations[i] for i in sorted(y)]
    stated = [e for e in equations if not isinstance(e.source, str)] or equations
    if len(equations) == 1:
        return _empty(flat, equations[0])
    free = [k for d in numbers.free() if touch(flat, y, d) for k in d]
    open_names = names_of(flat, free)
    remainder = demand(numbers, y)
    verb = "depend on each other"
    if remainder is not None:
        verb = "contradict each other" if abs(remainder) > 1e-9 else "say the same twice"
    cause, advice = hint(flat.declaration(k) for k in free)
    return StructureError(
        "AC204",
        f"{equations_of(flat, [e.component for e in stated])} {verb}",
        where=places(flat, stated),
        evidence=["their unknowns cancel:", *lines(flat, equations, 8), verdict(numbers, y)]
        + ([f"and leave undetermined: {listed(open_names, 4)}"] if open_names else []),
        cause=cause or "two equations state the same about these unknowns, possibly with different numbers",
        help=advice or "replace one of these equations by one for the undetermined unknowns",
    )


def _empty(flat: FlatSystem, equation: FlatEquation) -> StructureError:
    return StructureError(
        "AC204",
        f"{flat.name}: `{flat.text(equation)}` of {label(flat, equation.component)} determines no unknown",
        where=places(flat, [equation]),
        evidence=lines(flat, [equation]),
        cause="its unknowns cancel, or it contains parameters only",
        help="replace it by an equation for an unknown",
    )
