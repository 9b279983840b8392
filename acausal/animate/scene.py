"""Scenes: the moving bodies of a result, as nodes with a pose per time, from the looks of the model's components."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acausal.animate import meshes
from acausal.animate.looks import RED, Arrow, Drawn, Hole, Look, Part, Piece, Rigid, Stretched, look_of, up_of
from acausal.animate.meshes import Array
from acausal.errors import UsageError
from acausal.flatten.instances.instances import Instance, placed
from acausal.language.choices import is_changing
from acausal.language.component import Component, Connector
from acausal.result.result import Result

_QUARTER = math.radians(90.0)
_FAR = 5.0
"""A scene is shown whole if it is at most this many times as large as its moving parts."""


@dataclass(frozen=True, eq=False)
class Node:
    """Pieces and their motion: positions [m], shape (n, 3), rotations (n, 3, 3), scales (n, 3), in the model's axes.

    `kind` is body, force or hole; `trail` is the path of one of its points, shape (n, 3).
    """

    name: str
    pieces: tuple[Piece, ...]
    r: Array
    R: Array
    scale: Array
    kind: str = "body"
    trail: Array | None = None
    endless: bool = False
    symbol: bool = False


@dataclass(frozen=True, eq=False)
class Scene:
    """All nodes of a result over its times, shape (n,) in s.

    `upright` turns the model's axes so that up is +y, as glTF has it; `force_scale` is the length of an arrow per
    force [m/N]; `notes` describe bodies that are not shown or shown incorrectly.
    """

    model: str
    time: Array
    nodes: tuple[Node, ...]
    size: float
    upright: Array
    force_scale: float
    notes: tuple[str, ...] = ()


def scene_of(
    model: Component, result: Result, looks: Mapping[type[Component], Look] | None = None, poses: int = 2000
) -> Scene:
    """The scene of a run of `model`, at up to `poses` of the rows of its result.

    Raises UsageError: AC083 when the model has nothing with a shape, AC082 when the result is not of this model.
    """
    found, _ = placed(model)
    found = [*found, *_named_to_last(found, result)]
    drawn = [i for i in found if look_of(i.component, looks or {}) is not None]
    shown = [i for i in drawn if _is_recorded(i, result)]
    if not drawn:
        raise UsageError(
            "AC083",
            f"{type(model).__name__} has nothing to animate: none of its components has a shape",
            help="components of acausal.library.multibody, contact and drilling have shapes; others need looks={...}",
        )
    _check_is_of(model, found, drawn, shown, result)
    rows = _rows(result.time, poses)
    maker = _Maker(result, rows, looks or {})
    # components with dimensions, and their motion, determine the size of the scene; others are drawn in proportion
    size = _extent(worth_seeing(maker.nodes(shown, 1e-6))) or 1.0
    nodes = _without_needless(maker.nodes(shown, size), size)
    missing = [i.path for i in drawn if i not in shown and not _may_be_missing(i)]
    notes = [f"not in the result, and therefore not shown: {', '.join(missing[:5])}"] if missing else []
    notes += _too_fast(nodes)
    forces, scale = _scaled([n for n in nodes if n.kind == "force"], size)
    kept = (*(n for n in nodes if n.kind != "force"), *forces)
    return Scene(
        type(model).__name__, result.time[rows], kept, size, _upright(found, result, size), scale, tuple(notes)
    )


def _check_is_of(
    model: Component, found: Sequence[Instance], drawn: Sequence[Instance], shown: Sequence[Instance], result: Result
) -> None:
    """Refuse a result without the bodies of the model, or with bodies that the model does not have (AC082)."""
    known = {i.path for i in found}
    changing = tuple({name.partition("[")[0] + "[" for i in found for name in _lasting(i)})
    frames = [n.removesuffix(".r_0[0]") for n in result.names if n.endswith(".r_0[0]")]
    foreign = [f for f in frames if ".frame" in f and f not in known and not f.startswith(changing)]
    # contacts that never occurred are not in a result, and outer components (a world) are in many models
    around = tuple(o.cls for i in found for o in type(i.component)._outers.values())
    needed = [i for i in drawn if not _may_be_missing(i) and not isinstance(i.component, around)]
    if foreign or (needed and not any(i in shown for i in needed)):
        what = f"{foreign[0]} is not in the model" if foreign else f"it has no signals of {needed[0].path}"
        raise UsageError(
            "AC082",
            f"the result of {result.model} is not one of this {type(model).__name__}: {what}",
            help="name the model of the result: acausal animate RESULT --model MODEL, with its --set",
        )


def _is_recorded(instance: Instance, result: Result) -> bool:
    """Whether the frames of a component are in the result."""
    frames = [p.path for p in instance.parts if f"{p.path}.r_0[0]" in result]
    own = {name for name, p in instance.component._prototypes.items() if hasattr(type(p), "r_0")}
    return bool(frames) and len({f.rpartition(".")[2] for f in frames} & own) == len(own)


def _lasting(holder: Instance) -> dict[str, str]:
    """Paths in the model of the parts of a component that come and go, by their paths in results."""
    component = holder.component
    labels = component.whole().labels() if is_changing(component) else ()
    return {holder.prefix + kept: holder.prefix + own for own, kept in labels}


def _named_to_last(found: Iterable[Instance], result: Result) -> list[Instance]:
    """Contacts that come and go, under their names in results: the two bodies, and the number of the contact."""
    known, made = {i.path: i for i in found}, []
    for holder in list(known.values()):
        own = _lasting(holder)
        heads = tuple({name.partition("[")[0] + "[" for name in own})
        paths = dict.fromkeys(n[: n.index("]") + 1] for n in result.names if heads and n.startswith(heads))
        for path in paths:
            source = known.get(own.get(re.sub(r"#\d+]$", "]", path), ""))
            if source is not None:
                instance = Instance(source.component, path, -1, holder)
                frames = [(n, c) for n, c in source.component._parts.items() if isinstance(c, Connector)]
                instance.parts += [Instance(c, f"{path}.{n}", -1, instance) for n, c in frames]
                made.append(instance)
    return made


def _may_be_missing(instance: Instance) -> bool:
    return instance.owner is not None and is_changing(instance.owner.component)


def _rows(time: Array, poses: int) -> NDArray[np.intp]:
    """Rows of a result to show, at most `poses`: one per time, at an event the one after it."""
    # times that coincide in single precision, as in glTF, count as one
    single = (time - time[0]).astype(np.float32)
    last = np.flatnonzero(np.append(np.diff(single) > 0.0, True))
    if len(last) <= poses:
        return last
    wanted = np.linspace(time[0], time[-1], poses)
    return np.unique(last[np.searchsorted(time[last], wanted).clip(0, len(last) - 1)])


class _Maker:
    """Converts the shapes that looks yield into nodes; poses of frames are read once."""

    def __init__(self, result: Result, rows: NDArray[np.intp], looks: Mapping[type[Component], Look]) -> None:
        self.result, self.rows, self.looks = result, rows, looks
        # compute all trajectories at once, because many are read
        assert len(result.matrix), "a result has rows"
        self._poses: dict[str, tuple[Array, Array]] = {}

    def nodes(self, shown: Iterable[Instance], size: float) -> list[Node]:
        """All nodes; the first node of a component has its path as name."""
        made: list[Node] = []
        for instance in shown:
            owner = instance.owner.component if instance.owner is not None else None
            part = Part(instance.component, owner, instance.path, self.result, size)
            look = look_of(instance.component, self.looks)
            assert look is not None, "only components with a look are shown"
            for drawn in look(part):
                # a contact that never occurred has no position
                made += [n for n in self._node(part, drawn) if np.isfinite(n.r).all() and np.isfinite(n.R).all()]
        names: dict[str, int] = {}
        for k, node in enumerate(made):
            names[node.name] = names.get(node.name, 0) + 1
            if names[node.name] > 1:
                made[k] = replace(node, name=f"{node.name}:{names[node.name]}")
        return made

    def _pose(self, frame: str) -> tuple[Array, Array]:
        if frame not in self._poses:
            r, R = (_held(self.result[f"{frame}.{name}"][self.rows]) for name in ("r_0", "R"))
            self._poses[frame] = r, R
        return self._poses[frame]

    def _node(self, part: Part, drawn: Drawn) -> Iterator[Node]:
        prefix = part.path + "." if part.path else ""
        ones = np.ones((len(self.rows), 3))
        if isinstance(drawn, Rigid):
            r, R = self._pose(prefix + drawn.frame)
            trail = None if drawn.trail is None else r + R @ np.array(drawn.trail)
            name = prefix + drawn.name if drawn.name else part.path
            yield Node(name, drawn.pieces, r, R, ones, trail=trail, endless=drawn.endless, symbol=drawn.symbol)
        elif isinstance(drawn, Stretched):
            (a, _), (b, _) = self._pose(prefix + drawn.frame_a), self._pose(prefix + drawn.frame_b)
            length = np.maximum(np.linalg.norm(b - a, axis=1), 1e-9 * part.size)
            scale = np.column_stack([ones[:, :2], length])
            yield Node(part.path, drawn.pieces, a, meshes.along(b - a), scale)
        elif isinstance(drawn, Arrow):
            yield self._arrow(part, prefix + drawn.frame)
        else:
            yield from self._hole(part, prefix, drawn)

    def _arrow(self, part: Part, frame: str) -> Node:
        """The force on the neighbour: cut forces act on the component, and therefore have the opposite sign."""
        r, R = self._pose(frame)
        f = np.nan_to_num(-np.einsum("nij,nj->ni", R, self.result[f"{frame}.f"][self.rows]))
        t = np.nan_to_num(-np.einsum("nij,nj->ni", R, self.result[f"{frame}.t"][self.rows]))
        square = np.sum(f * f, axis=1, keepdims=True)
        # the point of the line of action that is nearest to the frame
        r = r + np.cross(f, t) / np.where(square > 0.0, square, 1.0)
        force = np.sqrt(square[:, 0])
        scale = np.column_stack([np.ones((len(force), 2)), force])
        piece = Piece(meshes.arrow(0.008 * part.size), RED)
        return Node(f"{frame}.f", (piece,), r, meshes.along(f), scale, kind="force")

    def _hole(self, part: Part, prefix: str, hole: Hole) -> Iterator[Node]:
        """The cone of the drill point and the cylinder behind it, as deep as the tip has been so far."""
        s = np.nan_to_num(self.result[f"{prefix}s"][self.rows])
        tip, axis = (_held(self.result[f"{prefix}geometry.{name}"][self.rows]) for name in ("tip", "axis"))
        if s.max() <= 0.0:
            return
        deepest = int(np.argmax(s))
        e, radius = axis[deepest], hole.diameter / 2
        entry = tip[deepest] - e * s[deepest]
        depth = np.maximum.accumulate(np.maximum(s, 0.0))
        h = radius / math.tan(hole.point_angle / 2)
        r_w, R_w = self._pose(prefix + hole.frame)
        turned = R_w @ meshes.along(e)
        tiny = 1e-6 * hole.diameter
        straight = np.clip(depth - h, 0.0, hole.thickness)
        wide = np.minimum(depth, h) / h
        wide = np.where(depth - h >= hole.thickness, 0.0, wide)  # a through hole has no cone
        begin = r_w + R_w @ entry
        wall = meshes.cylinder(radius, 1.0).inside_out()
        along = np.einsum("nij,j->ni", R_w, e)
        dark = "#332c2a"
        is_there = np.where(straight > 0.0, 1.0, 1e-6)
        cut = np.column_stack([is_there, is_there, straight + tiny])
        yield Node(f"{part.path}.hole", (Piece(wall, dark),), begin, turned, cut, kind="hole")
        point = meshes.cone(radius, h).inside_out()
        scale = np.repeat(np.maximum(wide, 1e-6)[:, None], 3, axis=1)
        bottom = begin + along * straight[:, None]
        yield Node(f"{part.path}.hole.point", (Piece(point, dark),), bottom, turned, scale, kind="hole")


def _held(values: Array) -> Array:
    """Values with gaps filled by the last value before: a contact that does not exist has no frame."""
    known = np.isfinite(values).reshape(len(values), -1).all(axis=1)
    if known.all() or not known.any():
        return values
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, int(np.argmax(known)), last)]


def _without_needless(nodes: list[Node], size: float) -> list[Node]:
    """Remove the pieces of symbols that move with a component with a shape; they keep their pose."""
    solid = [n.r for n in nodes if n.kind == "body" and not n.symbol and not n.endless and np.all(n.scale == 1.0)]
    solid = [r for r in solid if np.ptp(r, axis=0).max() > 0.0]

    def is_needless(node: Node) -> bool:
        return node.symbol and any(np.abs(node.r - r).max() < 1e-9 * size for r in solid)

    return [replace(n, pieces=()) if is_needless(n) else n for n in nodes]


def corners(nodes: Iterable[Node]) -> Array:
    """Opposite corners of all bodies except unbounded ones, at all times, shape (n, 3) [m]."""
    found = [np.zeros((0, 3))]
    for node in nodes:
        if node.kind == "body" and node.pieces and not node.endless:
            points = np.concatenate([p.mesh.positions for p in node.pieces])
            for corner in (points.min(axis=0), points.max(axis=0)):
                found.append(node.r + np.einsum("nij,nj->ni", node.R, corner * node.scale))
    every = np.concatenate(found)
    every = every[np.isfinite(every).all(axis=1)]
    return every if len(every) else np.zeros((1, 3))


def worth_seeing(nodes: Iterable[Node]) -> list[Node]:
    """Nodes of the initial view: all, or only moving ones if these are a small part of the scene."""
    every = list(nodes)
    moving = [n for n in every if max(np.ptp(n.r, axis=0).max(), np.ptp(n.R, axis=0).max()) > 0.0]
    narrow = _extent(moving)
    return moving if narrow > 0.0 and _extent(every) > _FAR * narrow else every


def _extent(nodes: Iterable[Node]) -> float:
    """Diagonal of the box around all bodies [m]; 0 below 0.01 mm."""
    every = corners(nodes)
    size = float(np.linalg.norm(every.max(axis=0) - every.min(axis=0)))
    return size if size > 1e-5 else 0.0


def _scaled(forces: list[Node], size: float) -> tuple[list[Node], float]:
    """(Arrows as long as their forces demand, 95 % of them below a quarter of the scene; length per force [m/N])."""
    loads = np.concatenate([n.scale[:, 2] for n in forces]) if forces else np.zeros(0)
    loads = loads[loads > 0.0]
    if not loads.size:
        return [], 0.0
    per_force = 0.25 * size / float(np.quantile(loads, 0.95))
    return [_with_length(n, per_force * n.scale[:, 2], size) for n in forces if n.scale[:, 2].max() > 0.0], per_force


def _with_length(node: Node, length: Array, size: float) -> Node:
    visible = np.where(length > 1e-3 * size, 1.0, 1e-6)
    return replace(node, scale=np.column_stack([visible, visible, np.maximum(length, 1e-6 * size)]))


def _too_fast(nodes: Iterable[Node]) -> list[str]:
    """A note on bodies that turn so fast that two poses do not show the direction."""
    for node in nodes:
        if node.kind == "body" and len(node.R) > 1 and np.all(node.scale == 1.0):
            cosine = (np.einsum("nij,nij->n", node.R[1:], node.R[:-1]) - 1.0) / 2.0
            angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)).max())
            if angle > _QUARTER:
                return [
                    f"{node.name} turns by {math.degrees(angle):.0f} degrees between two poses and may seem to turn "
                    "slower or backwards: record more of them with --poses, or show a shorter run"
                ]
    return []


def _upright(found: Iterable[Instance], result: Result, size: float) -> Array:
    """A rotation that turns the upward direction to +y: against gravity, else against the feed of a drill."""
    directions = [up_of(Part(i.component, None, i.path, result, size)) for i in found]
    known = sorted((up for up in directions if up is not None), key=lambda up: not up.sure)
    return _turned_up(known[0].direction) if known else np.eye(3)


def _turned_up(up: Array) -> Array:
    """The smallest rotation that turns `up` to +y."""
    e = up / np.linalg.norm(up)
    y = np.array([0.0, 1.0, 0.0])
    v, c = np.cross(e, y), float(e @ y)
    if c < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + c))
