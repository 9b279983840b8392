"""Checks of shapes, poses and bodies before anything is computed with them; errors name the body."""

from __future__ import annotations

import math
import numbers
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from acausal.errors import DeclarationError
from acausal.library.contact.collide.checks import check_shape, shown
from acausal.library.contact.scene.bodies import ContactBody

_SKEW = 1e-6


def check_pose(pose: Any, body: str) -> None:
    """Raise DeclarationError AC179 unless a pose is a position and a rotation matrix."""
    pair = pose if isinstance(pose, tuple | list) and len(pose) == 2 else (None, None)
    place, turn = (_numbers(part, shape) for part, shape in zip(pair, ((3,), (3, 3)), strict=True))
    fact = ""
    if place is None or turn is None:
        fact = f"is {shown(pose)}, not a position of 3 numbers [m] and a rotation of 3x3 numbers"
    elif np.abs(turn @ turn.T - np.eye(3)).max() > _SKEW or np.linalg.det(turn) < 0:
        fact = "has a matrix that is not a rotation: its rows are not three right-handed orthogonal unit vectors"
    if fact:
        raise DeclarationError(
            "AC179",
            f"the pose of {body} {fact}",
            help="pose=((x, y, z), axis_rotation((0, 0, 1), angle)); IDENTITY where it is not turned",
        )


def check_bodies(bodies: object) -> None:
    """Refuse names that occur twice, and wrong shapes, poses and reaches.

    Raises
    ------
    DeclarationError
        AC172 for names, AC174 for shapes, AC179 for poses, reaches, and for objects that are not bodies.
    """
    listed: list[Any] = list(bodies) if isinstance(bodies, tuple | list) else [None]
    given = [b for b in listed if isinstance(b, ContactBody)]
    if len(given) < len(listed):
        wrong = next(b for b in listed if not isinstance(b, ContactBody))
        raise DeclarationError(
            "AC179",
            f"the bodies of the scene are {shown(bodies if wrong is None else wrong)}, not a tuple of bodies",
            help="ContactScene(bodies=(ContactBody(name=..., shape=...), ...))",
        )
    names = [b.name for b in given]
    twice = sorted({n for n in names if names.count(n) > 1}) if len(set(names)) < len(names) else []
    if twice:
        raise DeclarationError("AC172", f"the scene has two bodies '{twice[0]}'", help="give each its own name")
    for body in given:
        _check_body(body)


def check_scene(skin: object, keep: object) -> None:
    """Raise DeclarationError AC179 for an impossible skin [m] or number of pairs."""
    if not (isinstance(skin, numbers.Real) and 0.0 < float(skin) < math.inf):
        raise DeclarationError("AC179", f"the skin of the scene is {shown(skin)}", help="give a positive length in m")
    if not isinstance(keep, int) or keep < 0:
        raise DeclarationError(
            "AC179", f"the scene is to keep {shown(keep)} pairs", help="give a whole number, 0 or more"
        )


def _check_body(body: ContactBody) -> None:
    if not isinstance(body.name, str) or not body.name:
        raise DeclarationError("AC172", f"a body of the scene is called {body.name!r}", help="give it a name")
    check_shape(body.shape, body.name)
    check_pose(body.pose, body.name)
    if body.reach is None:
        return
    low, high = (_numbers(side, (3,), finite=False) for side in (*body.reach, None, None)[:2])
    if low is None or high is None or not (low <= high).all():
        raise DeclarationError(
            "AC179",
            f"the reach of {body.name} is {shown(body.reach)}, not the lowest and the highest corner of a box",
            help="reach=((x_min, y_min, z_min), (x_max, y_max, z_max)) in m, in world axes",
        )


def _numbers(value: ArrayLike | None, shape: tuple[int, ...], finite: bool = True) -> NDArray[np.float64] | None:
    """A value as an array of the given shape; None if it is not one."""
    try:
        found = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return None
    wrong = found.shape != shape or np.isnan(found).any() or (finite and not np.isfinite(found).all())
    return None if wrong else found
