"""Spanning tree over overconstrained connectors (frames), as defined by the Modelica language.

Nodes are connector instances. Branches inside components are never cut; connections are cut where they close a loop.
Every island has one root: a declared one, else the best potential root (Modelica 3.6, section 9.4.1).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

from acausal.errors import DeclarationError, StructureError
from acausal.flatten.connections.connections import Joint, UnionFind
from acausal.flatten.flat import FlatLoop
from acausal.flatten.instances.instances import Instance, numbers
from acausal.flatten.instances.statements import statements
from acausal.language.component import Component, Connector
from acausal.language.connections.overconstrained import Branch, PotentialRoot, Root
from acausal.language.statement import Origin


@dataclass(frozen=True)
class SpanningTree:
    """Indices of the joints that close a loop, and therefore have residuals instead of equalities.

    `loops` names the components along each loop.
    """

    cut: frozenset[int]
    loops: tuple[FlatLoop, ...] = ()


_LOWEST_PRIORITY = 2**31
"""Priority number greater than that of any potential root, so that these frames are considered last."""


def is_overconstrained(connector: Connector) -> bool:
    """True for a connector with an overconstrained variable, such as a frame."""
    return _has_rotation(type(connector))


_has_rotation: Callable[..., bool] = cache(lambda cls: any(d.overconstrained for d in cls._declarations.values()))


def spanning_tree(
    all_instances: Sequence[Instance],
    physical: Sequence[Joint],
    number_of: dict[int, int],
    assumed: Sequence[int] = (),
) -> SpanningTree:
    """Cut loops and assign every frame its role (read by `rooted` and `is_root`).

    The roles are stored in views of the frames and of the components that own them, which are added to `number_of`. The
    user's components stay unchanged, so that one model can be flattened in two ways at the same time. `assumed` frames,
    those of a component that is described alone, are roots of islands without any other root.
    """
    frames = [i.number for i in all_instances if isinstance(i.component, Connector) and is_overconstrained(i.component)]
    if not frames:
        return SpanningTree(frozenset())
    branches, roots, potential = _ties(all_instances, number_of)
    potential = [*potential, *((_LOWEST_PRIORITY, number) for number in assumed)]
    n = len(all_instances)
    sets = UnionFind(n + 1)  # node n represents the world, to which all declared roots belong
    for number in roots:
        sets.union(n, number)
    neighbours: dict[int, list[int]] = {f: [] for f in frames}
    for a, b in branches:
        sets.union(a, b)
        neighbours[a].append(b)
        neighbours[b].append(a)
    cut: set[int] = set()
    connected = UnionFind(n)
    for k, joint in enumerate(physical):
        # Skip connections that earlier ones imply: their loop would contain no component.
        if joint.a in neighbours and connected.find(joint.a) != connected.find(joint.b):
            if sets.union(joint.a, joint.b):
                connected.union(joint.a, joint.b)
                neighbours[joint.a].append(joint.b)
                neighbours[joint.b].append(joint.a)
            else:
                cut.add(k)
    owners = {i.number: i.owner.number for i in all_instances if i.owner is not None}
    # Only connections from outside count: the frames of a composite are always connected to those of its parts.
    joined = {end for joint in physical for end in (joint.a, joint.b) if owners.get(end) != joint.by}
    chosen = _choose_roots(sets, n, frames, roots, potential, all_instances, joined)
    _assign_roles(all_instances, frames, neighbours, chosen, branches)
    number_of |= numbers(all_instances)
    loops = tuple(_loop(all_instances, physical[k], neighbours, n, roots) for k in sorted(cut))
    return SpanningTree(frozenset(cut), loops)


def _loop(
    all_instances: Sequence[Instance], joint: Joint, neighbours: dict[int, list[int]], world: int, roots: list[int]
) -> FlatLoop:
    """Components on the shortest path of the tree between the ends of a cut joint; the world connects all roots."""
    came_from = {joint.a: joint.a}
    queue = deque([joint.a])
    while queue and joint.b not in came_from:
        current = queue.popleft()
        adjacent = roots if current == world else neighbours[current] + ([world] if current in roots else [])
        for other in adjacent:
            if other not in came_from:
                came_from[other] = current
                queue.append(other)
    route = [joint.b]
    while route[-1] != joint.a:
        route.append(came_from[route[-1]])
    owners = [all_instances[k].owner for k in route if k != world]
    names = dict.fromkeys(owner.path for owner in owners if owner is not None)
    return FlatLoop((all_instances[joint.a].path, all_instances[joint.b].path), joint.origin, tuple(names))


def _ties(
    all_instances: Sequence[Instance], number_of: dict[int, int]
) -> tuple[list[tuple[int, int]], list[int], list[tuple[int, int]]]:
    branches: list[tuple[int, int]] = []
    roots: list[int] = []
    potential: list[tuple[int, int]] = []
    for instance in all_instances:
        if not hasattr(type(instance.component), "ties"):
            continue
        for tie, origin in statements(instance.component, "ties"):
            if not isinstance(tie, Branch | Root | PotentialRoot):
                raise DeclarationError(
                    "AC130",
                    f"{type(instance.component).__name__}.ties yields `{tie}` ({type(tie).__name__})",
                    where=(origin.span(),),
                    help="yield branch(a, b), root(a) or potential_root(a)",
                )
            a = _frame(tie.a, number_of, origin)
            if isinstance(tie, Branch):
                branches.append((a, _frame(tie.b, number_of, origin)))
            elif isinstance(tie, Root):
                roots.append(a)
            else:
                potential.append((tie.priority, a))
    return branches, roots, potential


def _frame(connector: Connector, number_of: dict[int, int], origin: Origin) -> int:
    """Number of a connector in `ties`; raises DeclarationError AC130 if it is no frame of the model."""
    number = number_of.get(id(connector))
    if number is None or not is_overconstrained(connector):
        raise DeclarationError(
            "AC130",
            f"{connector._path_to('').rstrip('.')} ({type(connector).__name__}) cannot be tied",
            where=(origin.span(),),
            cause="it is no part of the model" if number is None else "it has no overconstrained variable",
            help="branch, root and potential_root are for frames of the component itself",
        )
    return number


def _choose_roots(
    sets: UnionFind,
    world: int,
    frames: list[int],
    roots: list[int],
    potential: list[tuple[int, int]],
    all_instances: Sequence[Instance],
    joined: set[int],
) -> list[int]:
    chosen = list(roots)
    has_root = {sets.find(world)} if roots else set()
    for _, number in sorted(potential):
        island = sets.find(number)
        if island not in has_root:
            has_root.add(island)
            chosen.append(number)
    for number in frames:
        if sets.find(number) not in has_root:
            members = [all_instances[f] for f in frames if sets.find(f) == sets.find(number)]
            beyond = {all_instances[f].owner for f in frames if sets.find(f) != sets.find(number)}
            raise _unoriented(all_instances, members, beyond, joined)
    return chosen


def _unoriented(
    all_instances: Sequence[Instance], island: list[Instance], beyond: set[Instance | None], joined: set[int]
) -> StructureError:
    """AC203 for an island of frames without a root.

    `beyond` are components with a frame in another island, `joined` the frames that are connected from outside.
    """
    first = island[0]
    unconnected = [f.path for f in island if f.number not in joined]
    owners = {f.owner.number: f.owner for f in island if f.owner is not None}
    isolated = [
        o.path for o in owners.values() if o.path and not any(f.owner is o and f.number in joined for f in island)
    ]
    acting = [o.path for o in owners.values() if o in beyond]
    cause = "no World, Fixed or Body is in this island of frames"
    help = f"connect {' or '.join(unconnected[:2]) or 'one of them'} to World.frame_b, Fixed.frame_b or a Body"
    why = ""
    if len(isolated) == len(owners):
        why = f": {', '.join(isolated)} is connected to nothing"
        help = f"connect {' or '.join(unconnected[:2])}, or leave it out"
    elif acting:
        first = next((f for f in island if f.owner not in beyond), first)
        why = f": nothing moved by {' and '.join(acting[:3])} has mass"
        cause = "a frame that is not fixed needs the mass of a Body to move; there is none in this island of frames"
        help = f"connect a Body to {first.path}, or World or Fixed if it is to stand still"
    return StructureError(
        "AC203",
        f"{type(all_instances[0].component).__name__}: nothing fixes the orientation of {first.path}{why}",
        where=(first.owner.origin.span(),) if first.owner else (),
        evidence=[f"not connected: {', '.join(unconnected[:6])}"] if unconnected else [],
        cause=cause,
        help=help,
    )


def _assign_roles(
    all_instances: Sequence[Instance],
    frames: list[int],
    neighbours: dict[int, list[int]],
    chosen: list[int],
    branches: list[tuple[int, int]],
) -> None:
    depth = dict.fromkeys(chosen, 0)
    queue = deque(chosen)
    while queue:
        here = queue.popleft()
        for other in neighbours[here]:
            if other not in depth:
                depth[other] = depth[here] + 1
                queue.append(other)
    roots = set(chosen)
    nearer = {number: True for number in frames}
    for a, b in branches:
        nearer[a] = depth[a] <= depth[b]
        nearer[b] = not nearer[a]
    owners: dict[int, Instance] = {}
    for number in frames:
        frame = all_instances[number]
        frame.replace_by_view(frame.component._view({"_roles": {"is_root": number in roots, "rooted": nearer[number]}}))
        if frame.owner is not None:
            owners[frame.owner.number] = frame.owner
    for owner in owners.values():
        views: dict[int, Component] = {id(face): p.component for p in owner.parts for face in p.faces}
        parts = {
            name: [views.get(id(m), m) for m in value] if isinstance(value, list) else views.get(id(value), value)
            for name, value in owner.component._parts.items()
        }
        owner.replace_by_view(owner.component._view(parts=parts))
