"""Potentials that nothing fixes, and quantities that are fixed twice: null vectors of the flat system, in words."""

from __future__ import annotations

from collections.abc import Iterable

from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation, FlatSystem
from acausal.language.declare import Kind
from acausal.lower.diagnosis.pencil import Pencil, Vector
from acausal.lower.diagnosis.words import (
    component_of,
    connector_of,
    equations_of,
    hint,
    label,
    lines,
    listed,
    made_at,
    names_of,
)


def without_reference(numbers: Pencil) -> StructureError | None:
    """AC203 when all potentials of an island can be shifted together: every equation holds differences only."""
    flat = numbers.flat
    for shift in numbers.free():
        moved = _potentials(flat, shift)
        if not moved or _flows(flat, shift) or len({round(shift[k], 6) for k in moved}) > 1:
            continue
        twice = [y for y in numbers.dependent() if _touch(flat, y, shift)]
        if any(numbers.prescribes[i] for y in twice for i in y):
            continue  # two sources prescribe one flow; that the potential between them is free only follows
        return _island(flat, moved, twice)
    return None


def _island(flat: FlatSystem, moved: list[int], twice: list[Vector]) -> StructureError:
    names = [n for n in names_of(flat, moved) if connector_of(flat, n) is not None]
    declaration = flat.declaration(moved[0])
    quantity = names[0].rpartition(".")[2]
    connectors = [n.rpartition(".")[0] for n in names]
    components = list(dict.fromkeys(component_of(flat, n) for n in names))
    wanted = set(moved)
    inside = [
        e
        for e in flat.equations
        if not isinstance(e.source, str) and wanted & _bases(flat, flat.pool.variables_in(e.left, e.right))
    ]
    junctions = [flat.equations[i] for y in twice[:1] for i in y if isinstance(flat.equations[i].source, str)]
    evidence = ["they occur only as differences:", *lines(flat, inside, 4)]
    if junctions:
        evidence += ["while one of these follows from the others:", *lines(flat, junctions, 4)]
    cause, advice = hint([declaration])
    open_ends = [n for n in connectors if _is_open(flat, n)]
    if open_ends:
        advice = f"connect {listed(open_ends)}" + (f"; {advice}" if advice else "")
    return StructureError(
        "AC203",
        f"{flat.name}: nothing fixes the {_described(declaration.doc)} {quantity} of {listed(connectors, 4)}",
        where=[s for c in components[:2] for s in made_at(flat, c)],
        evidence=evidence,
        cause=cause or "no component of this island sets an absolute value",
        help=advice or "connect one of them to a component that fixes it (a ground, a fixed point, a source)",
    )


def _described(doc: str) -> str:
    """First word of the declaration's meaning where it is a plain noun: potential, position, angle."""
    words = [w for w in doc.lower().replace(",", "").split() if w not in ("absolute", "the", "a")]
    return words[0] if words else "potential"


def prescribed_twice(numbers: Pencil) -> StructureError | None:
    """AC205 when several components fix one potential, one difference of potentials or one flow."""
    flat = numbers.flat
    for y in numbers.dependent():
        equations = [flat.equations[i] for i in y]
        across = _owners(flat, equations, Kind.VARIABLE)
        through = _owners(flat, equations, Kind.FLOW)
        components = across if len(across) > 1 else through
        if len(components) < 2 or not any(numbers.prescribes[i] for i in y):
            continue
        circulating = [d for d in numbers.free() if _touch(flat, y, d)]
        return _twice(numbers, y, components, len(across) > 1, circulating)
    return None


def _twice(
    numbers: Pencil, y: Vector, components: list[str], is_potential: bool, circulating: list[Vector]
) -> StructureError:
    flat = numbers.flat
    equations = [flat.equations[i] for i in sorted(y)]
    kind = Kind.VARIABLE if is_potential else Kind.FLOW
    shared = _shared(flat, equations, kind)
    moved = [k for d in circulating[:1] for k in d]
    cause, advice = hint(flat.declaration(k) for k in moved)
    open_ends = [
        e.source.split(" ")[3] for e in equations if isinstance(e.source, str) and e.source.endswith("not connected")
    ]
    if open_ends:
        advice = f"connect {listed(open_ends)}"
    names = listed((label(flat, c) for c in components), 4)
    what = " - ".join(shared) if is_potential and len(shared) == 2 else listed(shared, 3)
    both = "both" if len(components) == 2 else "together"
    surplus = "" if len(components) == 2 else " twice"
    evidence = [*lines(flat, equations, 8), _verdict(numbers, y)]
    if moved:
        evidence.append(f"and leave open: {listed(names_of(flat, moved), 4)}")
    return StructureError(
        "AC205",
        f"{flat.name}: {names} {both} prescribe {what}{surplus}",
        where=[s for c in components[:2] for s in made_at(flat, c)],
        evidence=evidence,
        cause=cause or "one quantity is prescribed by two components",
        help=advice or "remove one of them, or put something compliant between them",
    )


def dependent_equations(numbers: Pencil) -> StructureError | None:
    """AC204 when the unknowns cancel in a combination of equations, though every one could be matched."""
    for y in numbers.dependent():
        return combined(numbers, y)
    return None


def combined(numbers: Pencil, y: Vector) -> StructureError:
    """The error for one combination of equations in which the unknowns cancel."""
    flat = numbers.flat
    equations = [flat.equations[i] for i in sorted(y)]
    stated = [e for e in equations if not isinstance(e.source, str)] or equations
    components = list(dict.fromkeys(e.component for e in stated))
    free = [d for d in numbers.free() if _touch(flat, y, d)]
    open_names = listed(names_of(flat, (k for d in free[:1] for k in d)), 4)
    contradict = abs(_demand(numbers, y)) > 1e-9
    cause, advice = hint(flat.declaration(k) for d in free[:1] for k in d)
    return StructureError(
        "AC204",
        f"{equations_of(flat, components)} "
        + ("contradict each other" if contradict else "say the same twice"),
        where=[e.origin.span() for e in stated[:2] if e.origin is not None],
        evidence=[*lines(flat, equations, 8), _verdict(numbers, y)]
        + ([f"and leave open: {open_names}"] if open_names else []),
        cause=cause or "the unknowns cancel in this combination of equations",
        help=advice or "replace one of these equations by one that fixes what is left open",
    )


def _demand(numbers: Pencil, y: Vector) -> float:
    scale = max(abs(v) for v in y.values())
    return sum(v / scale * float(numbers.rest[i]) for i, v in sorted(y.items()))


def _verdict(numbers: Pencil, y: Vector) -> str:
    demand = _demand(numbers, y)
    if abs(demand) > 1e-9:
        return f"together they demand 0 == {abs(demand):g}"
    return "one of them follows from the others"


def _bases(flat: FlatSystem, variables: Iterable[int]) -> set[int]:
    found = set()
    for v in variables:
        while v in flat.pool.integral_of:
            v = flat.pool.integral_of[v]
        found.add(v)
    return found


def _of_connector(flat: FlatSystem, scalar: int, kind: Kind) -> bool:
    owner = flat.owner[scalar]
    return owner.declaration.kind is kind and connector_of(flat, owner.path) is not None


def _potentials(flat: FlatSystem, vector: Vector) -> list[int]:
    return [k for k in vector if _of_connector(flat, k, Kind.VARIABLE)]


def _flows(flat: FlatSystem, vector: Vector) -> list[int]:
    return [k for k in vector if _of_connector(flat, k, Kind.FLOW)]


def _touch(flat: FlatSystem, y: Vector, d: Vector) -> bool:
    """True when a combination of equations and a free direction concern components in common."""
    mine = {flat.equations[i].component for i in y if not isinstance(flat.equations[i].source, str)}
    theirs = {component_of(flat, name) for name in names_of(flat, d)}
    return bool(mine & theirs)


def _owners(flat: FlatSystem, equations: Iterable[FlatEquation], kind: Kind) -> list[str]:
    """Components whose own equations hold connector variables of one kind."""
    return list(
        dict.fromkeys(
            e.component
            for e in equations
            if not isinstance(e.source, str)
            and any(_of_connector(flat, k, kind) for k in _bases(flat, flat.pool.variables_in(e.left, e.right)))
        )
    )


def _shared(flat: FlatSystem, equations: Iterable[FlatEquation], kind: Kind) -> list[str]:
    """Connector variables of a kind that occur in these equations, each by its first name."""
    scalars = [
        k
        for e in equations
        for k in sorted(_bases(flat, flat.pool.variables_in(e.left, e.right)))
        if _of_connector(flat, k, kind)
    ]
    return list(dict.fromkeys(flat.scalar_name(k) for k in scalars))


def _is_open(flat: FlatSystem, connector: str) -> bool:
    ending = f"of {connector} is zero: not connected"
    return any(isinstance(e.source, str) and e.source.endswith(ending) for e in flat.equations)


