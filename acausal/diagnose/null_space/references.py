"""Potentials that nothing fixes, and quantities that are fixed twice, found by null vectors of the flat system."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from acausal.diagnose.null_space.pencil import Pencil, Vector, pencil_rows
from acausal.diagnose.words import (
    component_of,
    connector_of,
    hint,
    label,
    lines,
    listed,
    loose,
    made_at,
    names_of,
    unconnected,
)
from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation, FlatSystem
from acausal.language.declarations.declaration import Kind


def without_reference(numbers: Pencil) -> StructureError | None:
    """AC203 if all potentials of an island can be shifted together, because equations contain only differences."""
    flat = numbers.flat
    for shift in numbers.free():
        moved = of_connectors(flat, shift, Kind.VARIABLE)
        if not moved or of_connectors(flat, shift, Kind.FLOW) or len({round(shift[k], 6) for k in moved}) > 1:
            continue
        dependent_rows = [y for y in numbers.dependent() if touch(flat, y, shift)]
        if any(numbers.prescribes[i] for y in dependent_rows for i in y):
            continue  # two sources prescribe one flow, and the free potential between them is only a consequence
        return _island(flat, moved, dependent_rows)
    return None


def _island(flat: FlatSystem, moved: Sequence[int], dependent_rows: Sequence[Vector]) -> StructureError:
    names = [n for n in names_of(flat, moved) if connector_of(flat, n) is not None]
    declaration = flat.declaration(moved[0])
    quantity = names[0].rpartition(".")[2]
    connectors = [n.rpartition(".")[0] for n in names]
    components = list(dict.fromkeys(component_of(flat, n) for n in names))
    shown = connectors if len(", ".join(connectors)) <= 50 else [label(flat, c) for c in components]
    moved_scalars = set(moved)
    island_equations = [
        e for e in flat.equations if not isinstance(e.source, str) and moved_scalars & unknowns_in(flat, e)
    ]
    junctions = [flat.equations[i] for y in dependent_rows[:1] for i in y if isinstance(flat.equations[i].source, str)]
    evidence = ["they occur only as differences:", *lines(flat, island_equations, 4)] if island_equations else []
    if junctions:
        evidence += ["while one of these follows from the others:", *lines(flat, junctions, 4)]
    cause, advice = hint([declaration])
    open_ends = loose(flat, connectors)
    isolated = [c for c in components if unconnected(flat, c)]
    if len(isolated) == len(components):
        cause = f"{listed(isolated)} {'is' if len(isolated) == 1 else 'are'} connected to nothing"
        advice = f"connect {listed(open_ends)}, or leave {'it' if len(isolated) == 1 else 'them'} out"
    elif open_ends:
        advice = f"connect {listed(open_ends)}" + (f"; {advice}" if advice else "")
    return StructureError(
        "AC203",
        f"{flat.name}: nothing fixes the {_described(declaration.doc)} {quantity} of {listed(shown)}"
        + (f": {cause}" if isolated and len(isolated) == len(components) else ""),
        where=[s for c in components[:2] for s in made_at(flat, c)],
        evidence=evidence,
        cause=cause or "no component of this island sets an absolute value",
        help=advice or "connect one of them to a component that fixes it (a ground, a fixed point, a source)",
    )


def _described(doc: str) -> str:
    """First word of the documentation of a declaration that is not an article: potential, position, angle."""
    words = [w for w in doc.lower().replace(",", "").split() if w not in ("absolute", "the", "a")]
    return words[0] if words else "potential"


def potential_twice(numbers: Pencil) -> StructureError | None:
    """AC205 if components fix one potential, or one difference of potentials, more than once."""
    flat = numbers.flat
    for y in numbers.dependent():
        equations = [flat.equations[i] for i in sorted(y)]
        moved = {k: 1.0 for d in numbers.free() if touch(flat, y, d) for k in d}
        circulating = of_connectors(flat, moved, Kind.FLOW)
        if not circulating and not any(numbers.prescribes[i] for i in y):
            continue
        across = _owners(flat, equations, Kind.VARIABLE)
        if len(across) > 1:
            return _potential_twice(numbers, y, across, circulating)
        stated = list(dict.fromkeys(e.component for e in equations if not isinstance(e.source, str)))
        points = _shorted(flat, stated[0]) if len(stated) == 1 else None
        if points is not None:
            return _short_circuit(numbers, y, stated[0], points, circulating)
    return None


def flow_twice(numbers: Pencil) -> StructureError | None:
    """AC205 if components fix one flow more than once, or a flow that ends at an open connector."""
    flat = numbers.flat
    for y in numbers.dependent():
        if not any(numbers.prescribes[i] for i in y):
            continue
        equations = [flat.equations[i] for i in sorted(y)]
        through = _owners(flat, equations, Kind.FLOW)
        ends = loose(flat, [n.rpartition(".")[0] for n in _shared(flat, equations, Kind.FLOW)])
        if len(through) > 1 or (through and ends):
            moved = [k for d in numbers.free() if touch(flat, y, d) for k in d]
            return _flow_twice(numbers, y, through, ends, moved)
    return None


def _potential_twice(
    numbers: Pencil, y: Vector, components: Sequence[str], circulating: Sequence[int]
) -> StructureError:
    flat = numbers.flat
    equations = [flat.equations[i] for i in sorted(y)]
    shared = _shared(flat, equations, Kind.VARIABLE)
    what = " - ".join(shared) if len(shared) == 2 else listed(shared, 3)
    cause, advice = hint(flat.declaration(k) for k in circulating)
    ends = loose(flat, dict.fromkeys(str(e.source).partition(" of ")[2].partition(" is zero")[0] for e in equations))
    if ends:
        cause = f"{listed(ends)} {'is' if len(ends) == 1 else 'are'} not connected, so nothing can flow there"
        advice = f"connect {listed(ends)}"
    return StructureError(
        "AC205",
        f"{flat.name}: {_subject(flat, components)} {what}{' twice' if len(components) > 2 else ''}",
        where=[s for c in components[:3] for s in made_at(flat, c)],
        evidence=["these do:", *lines(flat, equations, 8), verdict(numbers, y), *_left_open(flat, circulating)],
        cause=cause or "one quantity is prescribed by two components",
        help=advice or "remove one of them, or put something compliant between them",
    )


def _flow_twice(
    numbers: Pencil, y: Vector, components: Sequence[str], ends: Sequence[str], moved: Sequence[int]
) -> StructureError:
    flat = numbers.flat
    equations = [flat.equations[i] for i in sorted(y)]
    junctions = [e for e in equations if isinstance(e.source, str)]
    what = _shared(flat, junctions or equations, Kind.FLOW)[:1]
    cause = "the flows into a junction sum to zero, so that sources in series must agree"
    advice = "remove one of them, or connect something that takes up the difference"
    if ends:
        cause = f"{listed(ends)} {'is' if len(ends) == 1 else 'are'} not connected, so the flow there is zero"
        advice = f"connect {listed(ends)}"
    return StructureError(
        "AC205",
        f"{flat.name}: {_subject(flat, components)} {listed(what)}{' twice' if len(components) > 2 else ''}",
        where=[s for c in components[:3] for s in made_at(flat, c)],
        evidence=["these do:", *lines(flat, equations, 8), verdict(numbers, y), *_left_open(flat, moved)],
        cause=cause,
        help=advice,
    )


def _short_circuit(
    numbers: Pencil, y: Vector, component: str, points: tuple[str, str], circulating: Sequence[int]
) -> StructureError:
    flat = numbers.flat
    one, other = points
    equations = [flat.equations[i] for i in sorted(y)]
    return StructureError(
        "AC205",
        f"{flat.name}: {component} prescribes a difference between {one} and {other}, which coincide",
        where=made_at(flat, component),
        evidence=["these do:", *lines(flat, equations, 8), verdict(numbers, y), *_left_open(flat, circulating)],
        cause=f"{one} and {other} are connected with each other",
        help="remove that connection, or put something between them",
    )


def _shorted(flat: FlatSystem, component: str) -> tuple[str, str] | None:
    """Two connectors of a component that are connected with each other."""
    seen: dict[int, str] = {}
    for v in flat.variables:
        end = connector_of(flat, v.path)
        if v.declaration.kind is Kind.VARIABLE and end is not None and component_of(flat, v.path) == component:
            if v.first in seen:
                return seen[v.first], end
            seen[v.first] = end
    return None


def _subject(flat: FlatSystem, components: Sequence[str]) -> str:
    names = listed((label(flat, c) for c in components), 4)
    if len(components) == 1:
        return f"{names} prescribes"
    return f"{names} both prescribe" if len(components) == 2 else f"{names} together prescribe"


def _left_open(flat: FlatSystem, scalars: Iterable[int]) -> list[str]:
    names = names_of(flat, scalars)
    return [f"and leave undetermined: {listed(names, 4)}"] if names else []


def demand(numbers: Pencil, y: Vector) -> float | None:
    """Remainder of a combination of linear equations in which the unknowns cancel; None for nonlinear ones."""
    rows = sorted(y)
    elsewhere = pencil_rows(numbers.flat, rows, numbers.flat.parameter_values, seed=2)
    if abs(elsewhere - numbers.matrix[rows]).max() > 1e-9:
        return None
    scale = max(abs(v) for v in y.values())
    return sum(y[i] / scale * float(numbers.rest[i]) for i in rows)


def verdict(numbers: Pencil, y: Vector) -> str:
    """Sentence that tells whether the equations of a combination contradict each other."""
    rest = demand(numbers, y)
    if rest is None:
        return "one of them follows from the others, or contradicts them"
    if abs(rest) > 1e-9:
        return f"together they demand 0 == {abs(rest):g}"
    return "one of them follows from the others"


def unknowns_in(flat: FlatSystem, equation: FlatEquation) -> set[int]:
    """Flat scalars of an equation; a derivative counts as its variable."""
    scalars = set()
    for v in flat.pool.variables_in(equation.left, equation.right):
        while v in flat.pool.integral_of:
            v = flat.pool.integral_of[v]
        scalars.add(v)
    return scalars


def of_connectors(flat: FlatSystem, scalars: Iterable[int], kind: Kind) -> list[int]:
    """Those of the scalars that are connector variables of this kind."""
    return [
        k
        for k in scalars
        if flat.owner[k].declaration.kind is kind and connector_of(flat, flat.owner[k].path) is not None
    ]


def touch(flat: FlatSystem, y: Vector, d: Vector) -> bool:
    """True if a combination of equations and a free direction have a component in common."""
    mine = {flat.equations[i].component for i in y if not isinstance(flat.equations[i].source, str)}
    theirs = {component_of(flat, name) for name in names_of(flat, d)}
    return bool(mine & theirs)


def _owners(flat: FlatSystem, equations: Iterable[FlatEquation], kind: Kind) -> list[str]:
    """Components whose own equations contain connector variables of this kind."""
    return list(
        dict.fromkeys(
            e.component
            for e in equations
            if not isinstance(e.source, str) and of_connectors(flat, unknowns_in(flat, e), kind)
        )
    )


def _shared(flat: FlatSystem, equations: Iterable[FlatEquation], kind: Kind) -> list[str]:
    """Connector variables of this kind in the equations, named as in the component of the first that contains them."""
    name_of: dict[int, str] = {}
    for e in equations:
        for k in of_connectors(flat, sorted(unknowns_in(flat, e)), kind):
            names = names_of(flat, [k])
            own_names = [n for n in names if component_of(flat, n) == e.component]
            name_of.setdefault(k, (own_names or names)[0])
    return list(dict.fromkeys(name_of.values()))
