"""Contacts that cannot come about in a model that is made smaller: which pairs of bodies can touch, proved by bounds.

What moves depends on who touches whom, and the other way round. So the pairs grow: without any contact the model is
solved, and the poses of the bodies are bounded (`acausal.lower.motionless`); pairs whose bounds meet enter the
equations, and so on until none is added. The model of the last round is the true one: as long as no other pair has
touched, it moves as computed, and moving so, no other pair touches.

A component takes part when its class has these methods (`library/contact/scene.py` is the example):

- `poses()`: names of its own signals by which it decides, relative to its path; scalars or arrays.
- `confined(bounds)`: keep what can be in touch while these signals stay within their bounds (lowest and highest values
  by name), and what was kept before; True when that adds something and more may follow. None: keep nothing.
- `apart()`: pairs of names and reasons of what was left out.
- `unsteady()`: names of what is kept and would still change the structure during a run.
- `released()`: take the structure back that it had before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from acausal.errors import UsageError
from acausal.flatten.instances import instances
from acausal.language.component import Component
from acausal.lower.motionless import bounds
from acausal.lower.outputs import output_scalars
from acausal.lower.select import Left
from acausal.lower.solve import Solution

CONTACT = "contact"


@contextmanager
def confined(model: Component, solved: Callable[[Sequence[str]], Solution]) -> Iterator[tuple[Left, ...]]:
    """The model with the contacts that can come about, and what was left out; afterwards it is as before.

    `solved` gives the equations that some signals need, for the model as it is then.

    Raises
    ------
    UsageError
        AC027 when contacts are kept that change the structure during a run: drills that leave several holes.
    """
    found: dict[str, Any] = {i.path: i.component for i in instances(model)}
    parts = {path: c for path, c in found.items() if hasattr(type(c), "confined")}
    if not parts:
        yield ()
        return
    try:
        for part in parts.values():
            part.confined(None)
        while any([_grown(path, part, solved) for path, part in parts.items()]):
            pass
        for path, part in parts.items():
            _refuse(model, path, part.unsteady())
        yield tuple(Left(CONTACT, f"{path}: {n}", why) for path, part in parts.items() for n, why in part.apart())
    finally:
        for part in parts.values():
            part.released()


def _grown(path: str, part: Any, solved: Callable[[Sequence[str]], Solution]) -> bool:
    """Bound the poses and choose anew."""
    names = part.poses()
    if not names:
        return bool(part.confined({}))
    solution = solved([_named(path, name) for name in names])
    reduced = solution.structure.reduced
    found = {}
    for name in names:
        scalars = output_scalars(reduced.flat, [_named(path, name)])
        low, high = np.array(bounds(solution, [reduced.image[s] for s in scalars.values()])).T
        found[name] = low, high
    return bool(part.confined(found))


def _named(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _refuse(model: Component, path: str, unsteady: Sequence[str]) -> None:
    if unsteady:
        raise UsageError(
            "AC027",
            f"contacts of {type(model).__name__} would change the equations during a run: it cannot be made smaller",
            evidence=[f"{path}: {name} may leave several holes" for name in unsteady[:6]],
            help="a drill that keeps to one hole says so: DrillBody(wanders=False, ...)",
        )
