"""Equations in whose combination the unknowns cancel, and unknowns that are left open by it."""

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
_LARGEST = 800


def special_values(numbers: Pencil) -> StructureError | None:
    """AC204 when equations depend on each other only because of the values that some parameters were given."""
    return _special_values(numbers, _at_default(numbers.flat))


def special_defaults(numbers: Pencil) -> StructureError | None:
    """The same for values that nobody has given: an effect that is off by default explains less than all else."""
    return _special_values(numbers, set())


def _at_default(flat: FlatSystem) -> set[int]:
    """Free parameters that have the number declared for them."""
    found = set()
    for p in flat.parameters:
        default = p.declaration.default
        if p.free and isinstance(default, int | float):
            entries = [flat.pool.nodes[node][1] for node in p.nodes]
            found |= {k for k in entries if flat.parameter_values[k] == default}
    return found


def _special_values(numbers: Pencil, innocent: set[int]) -> StructureError | None:
    flat = numbers.flat
    for y in numbers.dependent():
        if len(y) > 200:
            continue
        guilty = [k for k in _decisive_parameters(flat, sorted(y)) if _cures(numbers, k)]
        if not innocent.issuperset(guilty):
            shown = [f"{flat.parameter_names[k]} = {flat.parameter_values[k]:g}" for k in guilty]
            error = combined(numbers, y)
            error.fact = f"{error.fact} for {listed(shown, 4)}"
            error.cause = "with other values of these parameters the equations would determine their unknowns"
            names = listed((flat.parameter_names[k] for k in guilty), 4)
            error.help = f"change {names}, or model what is idealised away"
            return error
    return None


def _decisive_parameters(flat: FlatSystem, rows: Sequence[int]) -> list[int]:
    """Free parameters any one of which, changed alone, makes the rows independent."""
    equations = [flat.equations[i] for i in rows]
    nodes = flat.pool.reachable([n for e in equations for n in (e.left, e.right)])
    parameters = [flat.pool.nodes[n][1] for n in nodes if flat.pool.nodes[n][0] == "par"]
    if not 0 < len(parameters) <= _MOST_PARAMETERS:
        return []
    found = []
    for k in parameters:
        matrix = pencil_rows(flat, rows, _changed(flat, k)).toarray()
        matrix = matrix[:, np.any(matrix != 0.0, axis=0)]
        size = np.linalg.svd(matrix, compute_uv=False)
        if len(size) == len(rows) and size[-1] > 1e-9 * size[0]:
            found.append(k)
    return found


def _cures(numbers: Pencil, parameter: int) -> bool:
    """True when another value of the parameter leaves fewer dependent combinations in the whole system."""
    flat = numbers.flat
    if flat.n_scalars > _LARGEST:
        return True
    matrix = pencil_rows(flat, range(len(flat.equations)), _changed(flat, parameter))
    return len(null_vectors(matrix)[0]) < len(numbers.dependent())


def _changed(flat: FlatSystem, parameter: int) -> list[float]:
    values = list(flat.parameter_values)
    values[parameter] = 0.61 if values[parameter] == 0.0 else values[parameter] * 1.37
    return values


def open_motion(numbers: Pencil) -> StructureError | None:
    """AC201 when a free direction moves a variable beside which its author has written what it needs."""
    flat = numbers.flat
    for d in numbers.free():
        hinted = [k for k in d if flat.owner[k].declaration.hint and connector_of(flat, flat.owner[k].path) is None]
        if not hinted:
            continue
        hinted.sort(key=lambda k: (flat.declaration(k).prefer_state is not True, k))
        first = flat.owner[hinted[0]]
        path = first.path.rpartition(".")[0]
        cause, advice = hint([first.declaration])
        twice = [y for y in numbers.dependent() if touch(flat, y, d)]
        evidence = [f"free with it: {listed([n for n in names_of(flat, hinted) if n != first.path], 4)}"]
        for y in twice[:1]:
            evidence += ["because these do not hold it:", *lines(flat, [flat.equations[i] for i in sorted(y)], 4)]
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
            help=advice or f"connect {label(flat, path)} to what determines it",
        )
    return None


def _loose_frames(flat: FlatSystem, path: str) -> list[str]:
    """Overconstrained connectors of a component that nothing is connected to."""
    frames = [
        name
        for name, c in flat.components.items()
        if c.is_connector
        and name.rpartition(".")[0] == path
        and any(d.overconstrained for d in c.cls._declarations.values())
    ]
    return loose(flat, frames)


def dependent_equations(numbers: Pencil) -> StructureError | None:
    """AC204 when the unknowns cancel in a combination of equations, though every one could be matched."""
    for y in numbers.dependent():
        return combined(numbers, y)
    return None


def empty_equation(numbers: Pencil) -> StructureError | None:
    """AC204 when a single equation holds no unknown."""
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
    rest = demand(numbers, y)
    verb = "depend on each other"
    if rest is not None:
        verb = "contradict each other" if abs(rest) > 1e-9 else "say the same twice"
    cause, advice = hint(flat.declaration(k) for k in free)
    return StructureError(
        "AC204",
        f"{equations_of(flat, [e.component for e in stated])} {verb}",
        where=places(flat, stated),
        evidence=["their unknowns cancel:", *lines(flat, equations, 8), verdict(numbers, y)]
        + ([f"and leave open: {listed(open_names, 4)}"] if open_names else []),
        cause=cause or "two equations state the same about these unknowns, perhaps with different numbers",
        help=advice or "replace one of these equations by one that fixes what is left open",
    )


def _empty(flat: FlatSystem, equation: FlatEquation) -> StructureError:
    return StructureError(
        "AC204",
        f"{flat.name}: `{flat.text(equation)}` of {label(flat, equation.component)} determines no unknown",
        where=places(flat, [equation]),
        evidence=lines(flat, [equation]),
        cause="its unknowns cancel, or it holds parameters only",
        help="replace it by an equation for an unknown",
    )
