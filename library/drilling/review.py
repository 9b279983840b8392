"""Review of a run for holes that overlap, and for drills that come down beside the hole that they have cut.

A drilling force has one hole, whose depth is a state. The position of the hole would need more states, but the record
of a run has it. The touch is a located event, so there is a row at each entry, however far apart the outputs are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from acausal import Result
from acausal.library.drilling.holes import ALONG, Hole, named

Array = NDArray[np.float64]
# Entry by entry, because reading a whole vector describes all signals of the run.
_TIP, _AXIS = (tuple(f"geometry.{name}[{k}]" for k in range(3)) for name in ("tip", "axis"))
_SIGNALS = ("s", "s_tar", "d", "sigma", "geometry.s_exit", *_TIP, *_AXIS)
_CUT = 0.01
"""Ratio of depth to diameter below which the tip has only touched the workpiece."""
_THIN = 1e-7
"""Layer [m] at the end of a hole that is ignored, since plates that lie on each other have a common face."""


def review(run: Result, paths: Sequence[str], scalars: Mapping[str, int]) -> list[str]:
    """Notes AC194 of single drilling forces, and AC192 of those in one frame of a workpiece; `paths` are theirs.

    Two forces share a workpiece if their frames are connected (equal numbers in `scalars`); frames of two models side
    by side may coincide without being connected. A scene whose structure changes has no such numbers and notes
    overlapping holes itself.
    """
    known = [path for path in paths if all(f"{path}.{name}" in run.signals for name in _SIGNALS)]
    if len(known) == 1 and _is_led(run, known[0]):
        return []
    made = [cut for path in known if len((cut := _Cut.of(run, path)).rows)]
    notes = [note for cut in made if (note := cut.beside())]
    frames: dict[int, list[Hole]] = {}
    for cut in made:
        if (frame := scalars.get(f"{cut.path}.frame_w.r_0")) is not None:
            frames.setdefault(frame, []).append(cut.hole())
    return [*notes, *_overlapping(frames.values())]


def _is_led(run: Result, path: str) -> bool:
    """Whether the compiler has found that the drill cannot leave its axis, so that nothing has to be computed."""
    return all(run.signals[f"{path}.{name}"].column is None for name in (*_TIP[:2], *_AXIS))


def _overlapping(groups: Iterable[list[Hole]]) -> Iterator[str]:
    for holes in groups:
        for one, other in combinations(holes, 2):
            if one.overlaps(other):
                yield (
                    f"AC192: {named(one, other)} overlap, {1e3 * one.apart(other):.3g} mm apart: each is cut as if the "
                    "other were full of material"
                )


@dataclass(frozen=True, eq=False)
class _Cut:
    """The rows of a run at which the tip is in the hole: entry [m] and direction of the drill, shape (n, 3)."""

    path: str
    d: float
    sigma: float
    depth: float
    rows: NDArray[np.intp]
    times: Array
    entry: Array
    axis: Array
    thickness: float

    @classmethod
    def of(cls, run: Result, path: str) -> _Cut:
        s, ground = run[f"{path}.s"], run[f"{path}.s_tar"]
        tip, axis = (np.column_stack([run[f"{path}.{name}"] for name in names]) for names in (_TIP, _AXIS))
        d, sigma = (float(np.nanmax(run[f"{path}.{name}"])) for name in ("d", "sigma"))
        rows = np.flatnonzero((s > 0) & (ground > _CUT * d))
        entry = tip[rows] - axis[rows] * s[rows, None]
        depth = float(np.nanmax(ground, initial=0.0))
        through = s[rows[:1]] - run[f"{path}.geometry.s_exit"][rows[:1]]
        return cls(path, d, sigma, depth, rows, run.time[rows], entry, axis[rows], float(through.max(initial=0.0)))

    def beside(self) -> str:
        """Return the note on the first instant at which the drill is beside its hole; "" if it never is."""
        off = np.linalg.norm(np.cross(self.entry - self.entry[0], self.axis[0]), axis=1)
        away = np.flatnonzero((off > self.d / 4) | (self.axis @ self.axis[0] < ALONG))
        if not len(away):
            return ""
        k = away[0]
        drawn_out = self.rows[k] - self.rows[0] > k
        how = "comes down" if drawn_out else "is moved"
        why = (
            "this force has one hole only, where the drill entered first: elsewhere it acts only below the depth of "
            "that hole; a DrillBody of a ContactScene makes new holes"
            if drawn_out
            else "the hole moves with it, and no force acts across the axis"
        )
        where = f"{1e3 * off[k]:.3g} mm beside its hole" if off[k] > self.d / 4 else "across its hole"
        return f"t = {self.times[k]:.9g} s: {self.path}: AC194: the drill {how} {where}: {why}"

    def hole(self) -> Hole:
        inside = min(self.depth, self.thickness) - _THIN
        return Hole(self.path, self.d, self.sigma, self.entry[0], self.axis[0], self.depth, inside)
