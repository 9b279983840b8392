"""Cut forces around closed loops of frames, and the error for a loop that is constrained more than it can move."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from acausal.diagnose.null_space.pencil import Pencil
from acausal.diagnose.null_space.references import touch
from acausal.diagnose.words import component_of, connector_of, hint, lines, listed, made_at
from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation, FlatSystem
from acausal.language.component import Component
from acausal.language.declarations.declaration import Kind


def constrained_loop(numbers: Pencil) -> StructureError | None:
    """AC206 if dependent equations leave cut forces around a closed loop of frames undetermined."""
    flat = numbers.flat
    loop_components = {c for loop in flat.loops for c in loop.components}
    for y in numbers.dependent():
        open_ones = [k for d in numbers.free() if touch(flat, y, d) for k in d if is_cut_force(flat, k)]
        forces = [flat.scalar_name(k) for k in open_ones]
        if any(component_of(flat, flat.owner[k].path) in loop_components for k in open_ones):
            return loop_error(flat, forces, [])
        equations = [flat.equations[i] for i in sorted(y)]
        members = [c for c in dict.fromkeys(e.component for e in equations if not isinstance(e.source, str)) if c]
        if forces and not loop_components and len(set(members) & _in_rings(flat)) > 2:
            return _ring_error(flat, members, forces, equations)
    return None


def _ring_error(
    flat: FlatSystem, members: Sequence[str], forces: Sequence[str], equations: Sequence[FlatEquation]
) -> StructureError:
    """The error for a loop that is not cut, because one of its joints leaves the orientation free."""
    framed = {component_of(flat, path) for path, c in flat.components.items() if c.is_connector and _is_frame(c.cls)}
    ring = [c for c in members if c in framed]
    return StructureError(
        "AC206",
        f"{flat.name}: the closed loop of {listed(ring, 8)} is overconstrained",
        where=[s for c in ring[-3:] for s in made_at(flat, c)],
        evidence=[f"not determined: {listed(forces, 4)}", "constrained by:", *lines(flat, equations, 6)],
        cause="its joints have fewer degrees of freedom than closing the loop takes, which is six in space",
        help="replace one of its joints by one with more freedom, or remove a rigid connection",
    )


def _in_rings(flat: FlatSystem) -> set[str]:
    """Components that remain when those at the ends of open chains of frames are removed, one after the other."""
    junction: dict[str, int] = {}  # of each frame: connected potentials are one variable
    for v in flat.variables:
        path = connector_of(flat, v.path)
        if path is not None and v.declaration.overconstrained:
            junction.setdefault(path, v.first)
    ends: dict[str, set[int]] = {}
    for path, first in junction.items():
        ends.setdefault(component_of(flat, f"{path}.R"), set()).add(first)
    while True:
        count = Counter(joint for joints in ends.values() for joint in joints)
        inner = {c: kept for c, joints in ends.items() if len(kept := {j for j in joints if count[j] > 1}) > 1}
        if inner == ends:
            return set(ends)
        ends = inner


def _is_frame(cls: type[Component]) -> bool:
    return any(d.overconstrained for d in cls._declarations.values())


def is_cut_force(flat: FlatSystem, scalar: int) -> bool:
    """True for a force or torque of a frame."""
    owner = flat.owner[scalar]
    path = connector_of(flat, owner.path)
    if path is None or owner.declaration.kind is not Kind.FLOW:
        return False
    return _is_frame(flat.components[path].cls)


def loop_error(flat: FlatSystem, forces: Sequence[str], equations: Sequence[FlatEquation]) -> StructureError:
    """The error for the shortest loop, with the undetermined forces or the surplus constraints."""
    loops = list(flat.loops)
    involved = {component_of(flat, f) for f in forces} | {e.component for e in equations}
    # The loop with the largest fraction of components involved; of several, the shortest.
    loop = min(loops, key=lambda one: (-len(involved & set(one.components)) / len(one.components), len(one.components)))
    moving = {component_of(flat, v.path) for v in flat.variables if v.declaration.prefer_state}
    joints = [c for c in loop.components if c in moving]
    cause, advice = hint(
        d
        for path in dict.fromkeys(f.rpartition(".")[0] for f in forces)
        if path in flat.components
        for d in flat.components[path].cls._declarations.values()
        if d.kind is Kind.FLOW
    )
    if not joints:
        cause = "nothing in this loop can move: its parts hold each other twice, so that their loads are undetermined"
        advice = "remove one of the connections, or put a joint or something compliant between two of the parts"
    evidence = [f"the loop: {' - '.join(loop.components)}"]
    evidence.append(f"closed between {loop.ends[0]} and {loop.ends[1]}")
    if forces:
        evidence.append(f"not determined: {listed(forces, 4)}")
    evidence += lines(flat, equations, 4)
    return StructureError(
        "AC206",
        f"{flat.name}: the closed loop of {listed(joints or loop.components, 8)} is overconstrained",
        where=(loop.origin.span(),),
        evidence=evidence,
        cause=cause or "the joints of the loop constrain the same motion twice (a planar loop, two parallel guides)",
        help=advice or "replace one joint of the loop by one with more freedom, as RevolutePlanarLoopConstraint",
    )
