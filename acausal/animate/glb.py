"""A scene as binary glTF 2.0: nodes with meshes, poses as linear and spherical tracks, trails as lines.

Khronos, glTF 2.0 specification, sections 3.6 (accessors), 3.7 (meshes), 3.11 (animations).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from acausal.animate.looks import Piece
from acausal.animate.meshes import Array
from acausal.animate.scene import Node, Scene
from acausal.errors import UsageError

_FLOAT, _UINT = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963
_LINE_STRIP, _TRIANGLES = 3, 4


@dataclass
class _Buffer:
    """Bytes, and the accessors and views into them; equal arrays are stored once."""

    gltf: Any
    kinds: Any
    content: bytearray = field(default_factory=bytearray)
    known: dict[tuple[str, str], int] = field(default_factory=dict)

    def add(self, values: Any, kind: str, target: int | None = None, limits: bool = False) -> int:
        """The accessor of an array: rows of `kind`, SCALAR, VEC3 or VEC4."""
        whole = np.issubdtype(values.dtype, np.integer)
        data = np.ascontiguousarray(values, dtype=np.uint32 if whole else np.float32)
        raw = data.tobytes()
        key = hashlib.sha256(raw).hexdigest(), f"{kind}{target}{limits}"
        if key not in self.known:
            view = self.kinds.BufferView(buffer=0, byteOffset=len(self.content), byteLength=len(raw), target=target)
            self.gltf.bufferViews.append(view)
            self.content += raw + b"\0" * (-len(raw) % 4)
            rows = data.reshape(len(data), -1)
            accessor = self.kinds.Accessor(
                bufferView=len(self.gltf.bufferViews) - 1,
                componentType=_UINT if whole else _FLOAT,
                count=len(data),
                type=kind,
                min=rows.min(axis=0).tolist() if limits else None,
                max=rows.max(axis=0).tolist() if limits else None,
            )
            self.gltf.accessors.append(accessor)
            self.known[key] = len(self.gltf.accessors) - 1
        return self.known[key]


def to_glb(scene: Scene) -> bytes:
    """The bytes of a `.glb` file. Times [s] count from the start of the run, because glTF has them in single precision.

    Raises UsageError: AC084 when pygltflib is not installed.
    """
    try:
        import pygltflib as kinds
    except ImportError as error:
        raise UsageError("AC084", "animations need pygltflib", help="python -m pip install pygltflib") from error
    gltf = kinds.GLTF2(asset=kinds.Asset(version="2.0", generator="acausal"))
    buffer = _Buffer(gltf, kinds)
    below: list[int] = []
    root = kinds.Node(name=scene.model, rotation=_quaternions(scene.upright[None])[0].tolist(), children=below)
    gltf.nodes.append(root)
    gltf.scenes.append(kinds.Scene(nodes=[0], name=scene.model))
    gltf.scene = 0
    animation = kinds.Animation(name="run", samplers=[], channels=[])
    drawing = _Drawing(buffer, {}, {})
    time = buffer.add(scene.time - scene.time[0], "SCALAR", limits=True)
    for node in scene.nodes:
        below.append(len(gltf.nodes))
        mesh = drawing.mesh(node.pieces, node.name) if node.pieces else None
        made = kinds.Node(name=node.name, mesh=mesh, extras={"kind": node.kind})
        gltf.nodes.append(made)
        _animate(buffer, animation, made, len(gltf.nodes) - 1, time, node)
    for node in scene.nodes:
        if node.trail is not None and len(node.trail) > 1 and np.ptp(node.trail, axis=0).max() > 1e-3 * scene.size:
            below.append(len(gltf.nodes))
            extras = {"kind": "trail"}
            gltf.nodes.append(kinds.Node(name=f"{node.name}:trail", mesh=drawing.line(node.trail), extras=extras))
    if animation.channels:
        gltf.animations.append(animation)
    gltf.buffers.append(kinds.Buffer(byteLength=len(buffer.content)))
    gltf.set_binary_blob(bytes(buffer.content))
    return b"".join(gltf.save_to_bytes())


def _animate(buffer: _Buffer, animation: Any, made: Any, number: int, time: int, node: Node) -> None:
    """Add the poses of a node: constant ones as attributes, others as tracks."""
    tracks = {
        "translation": (node.r, "VEC3"),
        "rotation": (_quaternions(node.R), "VEC4"),
        "scale": (node.scale, "VEC3"),
    }
    for path, (values, kind) in tracks.items():
        # decide in single precision what is constant, because a viewer gets no more
        if np.ptp(values.astype(np.float32), axis=0).max() == 0.0:
            setattr(made, path, values[0].tolist())
            continue
        sampler = buffer.kinds.AnimationSampler(input=time, output=buffer.add(values, kind), interpolation="LINEAR")
        animation.samplers.append(sampler)
        target = buffer.kinds.AnimationChannelTarget(node=number, path=path)
        animation.channels.append(buffer.kinds.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))


def _quaternions(R: Array) -> Array:
    """Unit quaternions (x, y, z, w) of rotations, shape (n, 3, 3) to (n, 4), neighbours on the same side."""
    from scipy.spatial.transform import Rotation

    # R is a rotation up to the tolerance of the run; scipy normalises it
    found = np.asarray(Rotation.from_matrix(R).as_quat())
    turned = np.cumprod(np.where(np.sum(found[1:] * found[:-1], axis=1) < 0.0, -1.0, 1.0))
    found[1:] *= turned[:, None]
    return found


@dataclass
class _Drawing:
    """Meshes and materials, each stored once."""

    buffer: _Buffer
    materials: dict[tuple[str, float], int]
    meshes: dict[tuple[Any, ...], int]

    def mesh(self, pieces: tuple[Piece, ...], name: str) -> int:
        """Number of the mesh with one primitive per piece."""
        kinds, gltf = self.buffer.kinds, self.buffer.gltf
        parts = [
            (
                self.buffer.add(p.mesh.positions, "VEC3", _ARRAY, limits=True),
                self.buffer.add(p.mesh.normals, "VEC3", _ARRAY),
                self.buffer.add(p.mesh.triangles.reshape(-1), "SCALAR", _ELEMENTS),
                self._material(p.color, p.opacity),
            )
            for p in pieces
        ]
        key = tuple(parts)
        if key not in self.meshes:
            primitives = [
                kinds.Primitive(
                    attributes=kinds.Attributes(POSITION=a, NORMAL=b), indices=c, material=m, mode=_TRIANGLES
                )
                for a, b, c, m in parts
            ]
            gltf.meshes.append(kinds.Mesh(primitives=primitives, name=name))
            self.meshes[key] = len(gltf.meshes) - 1
        return self.meshes[key]

    def line(self, points: Array) -> int:
        """Number of the mesh of a trail."""
        kinds, gltf = self.buffer.kinds, self.buffer.gltf
        place = self.buffer.add(points, "VEC3", _ARRAY, limits=True)
        attributes = kinds.Attributes(POSITION=place)
        primitive = kinds.Primitive(attributes=attributes, mode=_LINE_STRIP, material=self._material("#ee8833", 1.0))
        gltf.meshes.append(kinds.Mesh(primitives=[primitive], name="trail"))
        return len(gltf.meshes) - 1

    def _material(self, color: str, opacity: float) -> int:
        key = color, opacity
        if key not in self.materials:
            kinds, gltf = self.buffer.kinds, self.buffer.gltf
            srgb = np.array([int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)])
            linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
            surface = kinds.PbrMetallicRoughness(
                baseColorFactor=[*linear.tolist(), opacity], metallicFactor=0.1, roughnessFactor=0.6
            )
            mode = "BLEND" if opacity < 1.0 else "OPAQUE"
            made = kinds.Material(pbrMetallicRoughness=surface, alphaMode=mode, name=color)
            made.alphaCutoff = None  # only of the mode MASK
            gltf.materials.append(made)
            self.materials[key] = len(gltf.materials) - 1
        return self.materials[key]
