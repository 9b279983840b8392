"""A scene as an animated GIF, drawn by matplotlib, for uses without a browser."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.animate.meshes import Array
from acausal.animate.scene import Node, Scene, corners, worth_seeing

_FRAMES = 60
_SECONDS = 6.0
_PIXELS = 480


def to_gif(scene: Scene) -> bytes:
    """The GIF: sixty pictures over six seconds, whatever the duration of the run."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=(_PIXELS / 100, _PIXELS / 100), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    rows = np.unique(np.linspace(0, len(scene.time) - 1, min(_FRAMES, len(scene.time))).round().astype(int))
    low, high = _limits(scene)
    pictures = []
    for row in rows:
        axes.clear()
        axes.set_axis_off()
        for setter, a, b in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), low, high, strict=True):
            setter(a, b)
        axes.set_box_aspect(tuple(high - low))
        axes.view_init(elev=18, azim=-60)
        _draw(axes, scene, int(row))
        axes.text2D(0.04, 0.04, f"{scene.time[row]:.3g} s", transform=axes.transAxes)
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()))
    stream = io.BytesIO()
    first, *rest = [p.quantize(256) for p in pictures]
    first.save(
        stream,
        "GIF",
        save_all=True,
        append_images=rest,
        duration=int(1000 * _SECONDS / len(rows)),
        loop=0,
        optimize=False,
    )
    return stream.getvalue()


# matplotlib's up is z, glTF's is y.
_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def _placed(scene: Scene, node: Node, row: int, points: Array) -> Array:
    world = node.r[row] + (points * node.scale[row]) @ node.R[row].T
    return np.asarray(world @ (_Z_UP @ scene.upright).T)


def _limits(scene: Scene) -> tuple[Array, Array]:
    every = corners(worth_seeing(scene.nodes)) @ (_Z_UP @ scene.upright).T
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.05 * scene.size
    # a flat box could not be seen: give it some depth
    padding = np.maximum(0.0, 0.2 * scene.size - (high - low)) / 2
    return low - margin - padding, high + margin + padding


def _draw(axes: Any, scene: Scene, row: int) -> None:
    """Draw all triangles in one collection, so that those in front hide the others; lit from the upper left.

    Triangles seen from behind are left out, as in the page. They would not be hidden: triangles are sorted by the
    distance of their middles, and of a large plate one below may be nearer than one above.
    """
    from matplotlib.colors import to_rgba
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    lamp = np.array([-0.4, -0.5, 0.77])
    triangles, colors = [], []
    for node in scene.nodes:
        if node.endless or np.any(node.scale[row] < 1e-5):
            continue
        for piece in node.pieces:
            found = _placed(scene, node, row, piece.mesh.positions)[piece.mesh.triangles]
            found = found[facing(found, axes.get_proj())]
            normals = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
            length = np.linalg.norm(normals, axis=1)
            bright = 0.55 + 0.45 * np.maximum(0.0, normals @ lamp / np.where(length > 0.0, length, 1.0))
            rgba = np.tile(to_rgba(piece.color, piece.opacity), (len(found), 1))
            rgba[:, :3] *= bright[:, None]
            triangles.append(found)
            colors.append(rgba)
    faces = Poly3DCollection(np.concatenate(triangles), facecolors=np.concatenate(colors), linewidths=0)
    axes.add_collection3d(faces)


def facing(triangles: Array, projection: Array) -> NDArray[np.bool_]:
    """Mask of the triangles, shape (n, 3, 3), whose corners are counter-clockwise as seen by the viewer."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    corners = triangles.reshape(-1, 3).T
    projected = proj_transform(corners[0], corners[1], corners[2], projection)
    x, y, _ = (np.asarray(v).reshape(-1, 3).T for v in projected)
    return np.asarray((x[1] - x[0]) * (y[2] - y[0]) > (x[2] - x[0]) * (y[1] - y[0]))
