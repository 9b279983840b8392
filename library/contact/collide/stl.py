"""Points of STL files, text or binary, and the check that their surface is convex."""

from __future__ import annotations

import numbers
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acausal.errors import DeclarationError

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84

# Corners are single precision: dents count only beyond this depth, relative to the size.
_TOLERANCE = 1e-5

# Fraction of the surface that may be missing because of rounding errors.
_HOLE = 1e-4


def read_stl(path: str, body: str) -> NDArray[np.float64]:
    """Triangles of an STL file, shape (n, 3, 3); raises AC175 if there are none."""
    file = Path(path)
    try:
        data = file.read_bytes()
    except OSError as error:
        raise DeclarationError(
            "AC175", f"the mesh of {body} cannot be read: {file}", cause=str(error), help="give the path of an STL file"
        ) from None
    count = int.from_bytes(data[80:_HEADER], "little") if len(data) >= _HEADER else 0
    # Some binary files begin with the word `solid` too; they are recognised by their length.
    if len(data) == _HEADER + count * _RECORD.itemsize and count:
        return np.asarray(np.frombuffer(data, _RECORD, count, _HEADER)["corners"], dtype=float)
    words = data.decode("ascii", errors="replace").split()
    try:
        found = [[float(w) for w in words[k + 1 : k + 4]] for k, word in enumerate(words) if word.lower() == "vertex"]
        triangles = np.array(found, dtype=float).reshape(-1, 3, 3)
    except ValueError:
        triangles = np.zeros((0, 3, 3))
    if not len(triangles) or not np.isfinite(triangles).all():
        raise DeclarationError(
            "AC175",
            f"the mesh of {body} is not an STL file: {file}",
            help="text files hold `vertex x y z` lines, binary ones 50 bytes for each triangle",
        )
    return triangles


def convex_points(path: str, scale: float, body: str) -> NDArray[np.float64]:
    """Corners of a mesh, shape (n, 3), times `scale`.

    Raises
    ------
    DeclarationError
        AC176 if its surface is not convex or not closed; AC175 for a scale that is not positive.
    """
    from scipy.spatial import ConvexHull, QhullError

    if not isinstance(scale, numbers.Real) or not 0 < scale < np.inf:
        raise DeclarationError("AC175", f"the mesh of {body} is scaled by {scale!r}", help="1e-3 for files in mm")
    triangles = read_stl(path, body)
    corners = triangles.reshape(-1, 3)
    size = float(np.ptp(corners, axis=0).max())
    try:
        faces = ConvexHull(corners).equations
    except QhullError:
        return np.unique(corners, axis=0) * scale  # flat: reported by `check`
    depth = (-(triangles.mean(axis=1) @ faces[:, :3].T + faces[:, 3])).min(axis=1)
    worst = int(depth.argmax())
    if depth[worst] > _TOLERANCE * size:
        raise DeclarationError(
            "AC176",
            f"the mesh of {body} is not convex",
            evidence=[
                f"triangle {worst} of {len(triangles)} lies {depth[worst] * scale:.3g} m below the hull of {path}"
            ],
            help="cut it into convex parts and give each to its own shape",
        )
    area = float(np.linalg.norm(np.cross(*np.diff(triangles, axis=1).swapaxes(0, 1)), axis=1).sum()) / 2
    whole = ConvexHull(corners).area
    if area < (1 - _HOLE) * whole:
        raise DeclarationError(
            "AC176",
            f"the mesh of {body} is not closed",
            evidence=[f"its triangles cover {100 * area / whole:.4g} % of the hull of {path}"],
            help="close it, or give the points to ConvexHull if their hull is meant",
        )
    return np.unique(corners, axis=0) * scale
