"""Scenes of runs against the figures that the models themselves stand for, and their glTF."""

from __future__ import annotations

import json
import math
import os
import shutil
import struct
import subprocess
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, fixed, part
from acausal.animate.looks import Part, Piece, Rigid, look_of
from acausal.animate.meshes import box
from acausal.animate.picture import facing
from acausal.animate.scene import Node, Scene
from acausal.errors import UsageError
from acausal.library.multibody import Body, BodyBox, Prismatic, Revolute, Spring, World
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.oscillator import Oscillator
from acausal.models.pendulum_chain import PendulumChain


class Swing(Component):
    """A box of 1 m on a hinge about z, let go level, and a mass on a spring beside it."""

    world: World = part()
    hinge: Revolute = part()
    bar: BodyBox = part()
    rail: Prismatic = part()
    mass: Body = part()
    spring: Spring = part()

    def build(self) -> None:
        self.world = World()
        self.hinge = Revolute(phi=fixed(0.0), w=fixed(0.0))
        self.bar = BodyBox(r=(1.0, 0.0, 0.0), width=0.1, height=0.2, width_direction=(0.0, 1.0, 0.0))
        self.rail = Prismatic(n=(0.0, -1.0, 0.0), s=fixed(0.5), v=fixed(0.0))
        self.mass = Body(m=1.0)
        self.spring = Spring(c=100.0, s_unstretched=0.3)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.hinge.frame_a, self.rail.frame_a, self.spring.frame_a)
        yield connect(self.hinge.frame_b, self.bar.frame_a)
        yield connect(self.rail.frame_b, self.mass.frame_a, self.spring.frame_b)


@pytest.fixture(scope="module")
def swing() -> acausal.Result:
    return acausal.simulate(Swing(), stop_time=1.0, tolerance=1e-8)


def named(scene: Scene, name: str) -> Node:
    return next(n for n in scene.nodes if n.name == name)


def chunks(glb: bytes) -> tuple[dict[str, Any], bytes]:
    """JSON and binary chunk of a .glb file (glTF 2.0, section 4.4)."""
    magic, version, length = struct.unpack_from("<4sII", glb)
    assert (magic, version, length) == (b"glTF", 2, len(glb))
    size, kind = struct.unpack_from("<I4s", glb, 12)
    assert kind == b"JSON"
    rest = 20 + size
    length, kind = struct.unpack_from("<I4s", glb, rest)
    assert kind == b"BIN\0"
    return json.loads(glb[20:rest]), glb[rest + 8 : rest + 8 + length]


def test_poses_are_those_of_the_joints(swing: acausal.Result) -> None:
    scene = acausal.animate(Swing(), swing).scene
    phi = swing["hinge.phi"]
    bar = named(scene, "bar")
    expected = np.zeros((len(phi), 3, 3))
    expected[:, 0, 0] = expected[:, 1, 1] = np.cos(phi)
    expected[:, 1, 0], expected[:, 0, 1], expected[:, 2, 2] = np.sin(phi), -np.sin(phi), 1.0
    assert np.allclose(bar.R, expected, atol=1e-6)
    assert bar.trail is not None
    assert np.allclose(bar.trail[:, 1], np.sin(phi), atol=1e-6)
    # The spring reaches from the origin to the mass, half a metre below at the start.
    spring = named(scene, "spring")
    assert spring.scale[0, 2] == pytest.approx(0.5)
    assert np.allclose(spring.R[0] @ [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], atol=1e-9)
    assert np.allclose(named(scene, "mass").r[:, 1], -swing["rail.s"], atol=1e-9)


def test_bodies_with_dimensions_have_them(swing: acausal.Result) -> None:
    scene = acausal.animate(Swing(), swing).scene
    (piece,) = named(scene, "bar").pieces
    assert np.allclose(piece.mesh.positions.min(axis=0), [0.0, -0.05, -0.1])
    assert np.allclose(piece.mesh.positions.max(axis=0), [1.0, 0.05, 0.1])


def test_up_is_against_gravity(swing: acausal.Result) -> None:
    assert np.allclose(acausal.animate(Swing(), swing).scene.upright, np.eye(3))

    class Sideways(Swing):
        """The same with gravity along x."""

        def build(self) -> None:
            super().build()
            self.world = World(n=(1.0, 0.0, 0.0))

    tilted = acausal.animate(Sideways(), stop_time=0.1, poses=10).scene
    assert np.allclose(tilted.upright @ [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0])


def test_a_drill_leaves_a_hole_as_deep_as_its_tip() -> None:
    """s(20 s) = 10.521 mm of the founding scene; the cone of the point is d / (2 tan(59 deg)) = 4.807 mm deep."""
    scene = acausal.animate(ThickBlock(), poses=400).scene
    row = int(np.argmin(np.abs(scene.time - 20.0)))
    wall, point = named(scene, "drill.hole"), named(scene, "drill.hole.point")
    h = 8e-3 / math.tan(math.radians(59.0))
    assert wall.scale[row, 2] == pytest.approx(10.521275e-3 - h, abs=1e-6)
    assert point.scale[row, 0] == pytest.approx(1.0)
    assert point.r[row, 2] == pytest.approx(10.521275e-3 - h, abs=1e-6)
    assert np.all(np.diff(wall.scale[:, 2]) > -1e-12)
    # Before the touch there is none.
    assert wall.scale[0, 0] < 1e-5
    # At 20 s the block pushes back with the 2000 N of the source, against the feed along +z.
    force = named(scene, "drill.frame_a.f")
    assert force.scale[row, 2] / scene.force_scale == pytest.approx(2000.0, rel=1e-3)
    assert np.allclose(force.R[row] @ [0, 0, 1], [0, 0, -1], atol=1e-9)


def test_gltf_holds_names_tracks_and_limits(swing: acausal.Result) -> None:
    pytest.importorskip("pygltflib")
    content, binary = chunks(acausal.animate(Swing(), swing).glb())
    assert content["asset"]["version"] == "2.0"
    names = [n.get("name") for n in content["nodes"]]
    assert {"bar", "mass", "spring", "hinge", "world"} <= set(names)
    (animation,) = content["animations"]
    paths = {(names[c["target"]["node"]], c["target"]["path"]) for c in animation["channels"]}
    assert ("bar", "rotation") in paths
    assert ("bar", "translation") not in paths  # it stays at the hinge
    assert ("spring", "scale") in paths
    for accessor in content["accessors"]:
        view = content["bufferViews"][accessor["bufferView"]]
        size = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        assert view["byteLength"] == 4 * size * accessor["count"]
        assert view.get("byteOffset", 0) + view["byteLength"] <= len(binary)
    rotation = next(c for c in animation["channels"] if names[c["target"]["node"]] == "bar")
    track = content["accessors"][animation["samplers"][rotation["sampler"]]["output"]]
    view = content["bufferViews"][track["bufferView"]]
    q = np.frombuffer(binary, np.float32, 4 * track["count"], view.get("byteOffset", 0)).reshape(-1, 4)
    assert np.allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-6)
    assert np.allclose(2 * np.arctan2(q[:, 2], q[:, 3]), swing["hinge.phi"], atol=1e-5)


def test_the_validator_of_khronos_finds_nothing(swing: acausal.Result, tmp_path: Path) -> None:
    pytest.importorskip("pygltflib")
    node = shutil.which("node")
    library = os.environ.get("ACAUSAL_GLTF_VALIDATOR")
    if node is None or library is None:
        pytest.skip("needs node and the npm package gltf-validator, whose folder ACAUSAL_GLTF_VALIDATOR names")
    (tmp_path / "swing.glb").write_bytes(acausal.animate(Swing(), swing).glb())
    script = (
        f"require({json.dumps(library)}).validateBytes(new Uint8Array(require('fs').readFileSync(process.argv[1])))"
        ".then(r => console.log(JSON.stringify(r.issues)))"
    )
    run = subprocess.run([node, "-e", script, str(tmp_path / "swing.glb")], capture_output=True, text=True, check=True)
    issues = json.loads(run.stdout)
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_two_thousand_poses_are_a_page_of_two_megabytes() -> None:
    """The founding scene, eleven components."""
    pytest.importorskip("pygltflib")
    result = acausal.simulate(ThickBlock(), output_interval=40.0 / 2000)
    assert len(result.matrix) > 2000
    animation = acausal.animate(ThickBlock(), result, poses=2001)
    page = animation.html()
    assert len(animation.scene.time) > 1900
    assert len(page) < 2_000_000


def test_shapes_are_attached_from_outside(swing: acausal.Result) -> None:
    def crate(part: Part) -> list[Rigid]:
        return [Rigid((Piece(box((0.2, 0.2, 0.2)), "#112233"),))]

    scene = acausal.animate(Swing(), swing, looks={Body: crate}).scene
    (piece,) = named(scene, "mass").pieces
    assert piece.color == "#112233"


def test_a_package_names_the_module_of_its_looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module that happens to be called `looks` is not loaded."""
    body = "from acausal.library.multibody import Body\nclass Crate(Body):\n    pass\n"
    look = (
        "from acausal.animate.looks import Piece, Rigid\nfrom acausal.animate.meshes import box\n"
        "from named_looks.parts import Crate\n"
        "LOOKS = {Crate: lambda part: [Rigid((Piece(box((0.2, 0.2, 0.2)), '#112233'),))]}\n"
    )
    files = {
        "named_looks": {"__init__": "__looks__ = 'named_looks.drawn'", "parts": body, "drawn": look},
        "other_looks": {"__init__": "", "parts": body, "looks": "raise RuntimeError('it was loaded')"},
    }
    for package, modules in files.items():
        (tmp_path / package).mkdir()
        for name, text in modules.items():
            (tmp_path / package / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    named_crate = import_module("named_looks.parts").Crate()
    (drawn,) = look_of(named_crate, {})(Part(named_crate, None, "", cast("Any", None), 1.0))  # type: ignore[misc]
    assert cast("Rigid", drawn).pieces[0].color == "#112233"
    # drawn as the bodies it descends from
    assert look_of(import_module("other_looks.parts").Crate(), {}) is look_of(Body(m=1.0), {})


def test_poses_are_thinned_and_each_time_has_one(swing: acausal.Result) -> None:
    rows = np.repeat(swing.matrix, 2, axis=0)
    doubled = acausal.Result("Swing", np.repeat(swing.time, 2), rows, swing.signals)
    scene = acausal.animate(Swing(), doubled, poses=99).scene
    assert len(scene.time) <= 100
    assert np.all(np.diff(scene.time) > 0.0)
    assert (scene.time[0], scene.time[-1]) == (0.0, 1.0)


def test_times_of_one_number_in_single_precision_are_one(swing: acausal.Result) -> None:
    """glTF asks for times that increase, in single precision: 1e-9 s after 1 s there is none."""
    near = acausal.Result("Swing", np.append(swing.time, 1.0 + 1e-9), swing.matrix[[*range(501), 500]], swing.signals)
    time = acausal.animate(Swing(), near).scene.time
    assert np.all(np.diff(time.astype(np.float32)) > 0.0)
    assert time[-1] == near.time[-1]


def test_what_turns_too_fast_to_be_seen_is_noted() -> None:
    scene = acausal.animate(ThickBlock(), poses=60).scene
    (note,) = scene.notes
    assert "drill" in note or "body" in note
    assert "--poses" in note
    assert acausal.animate(PendulumChain(n=2), poses=200).scene.notes == ()


def test_what_has_no_shape_and_what_is_of_another_model_are_refused(swing: acausal.Result) -> None:
    with pytest.raises(UsageError, match="AC083"):
        acausal.animate(Oscillator())
    with pytest.raises(UsageError, match="AC082"):
        acausal.animate(PendulumChain(), swing)


def test_a_moving_picture_without_a_browser(swing: acausal.Result, tmp_path: Path) -> None:
    from PIL import Image, ImageSequence

    scene = acausal.animate(Swing(), swing, poses=5)
    scene.save(tmp_path / "swing.gif")
    with Image.open(tmp_path / "swing.gif") as picture:
        frames = [np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(picture)]
    assert len(frames) > 3
    assert np.abs(frames[0] - frames[-1]).max() > 50


def test_a_moving_picture_shows_three_faces_of_a_box_and_hides_none_of_them() -> None:
    """A flat box from above: drawn with those behind, one of its bottom hid half of its top."""
    from matplotlib.figure import Figure

    axes: Any = Figure().add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    axes.view_init(elev=18, azim=-60)
    mesh = box((1.0, 1.0, 0.1))
    corners = mesh.positions[mesh.triangles]
    seen = facing(corners, axes.get_proj())
    normals = {tuple(n) for n in np.cross(corners[seen, 1] - corners[seen, 0], corners[seen, 2] - corners[seen, 0])}
    assert {tuple(np.sign(n).astype(int).tolist()) for n in normals} == {(0, 0, 1), (1, 0, 0), (0, -1, 0)}
    assert not facing(corners[:, ::-1], axes.get_proj())[seen].any()
