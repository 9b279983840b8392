"""Review of a run for holes that overlap, and for drills that come down beside the hole that they have cut.

Holes are compared where their workpieces do not move against each other, whether these are one component, two faces of
one plate, or two bodies of a scene. Two models side by side, each with a world of its own, are not compared, because
a model and its variant lie in one place.

A drilling force has one hole, whose depth is a state. The position of the hole would need more states, but the record
of a run has it. The touch is a located event, so there is a row at each entry, however far apart the outputs are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from acausal import Result
from acausal.library.drilling.holes import ALONG, Hole, named

Array = NDArray[np.float64]
# Entry by entry, because reading a whole vector describes all signals of the run.
_TIP, _AXIS = (tuple(f"geometry.{name}[{k}]" for k in range(3)) for name in ("tip", "axis"))
_SIGNALS = ("s", "s_tar", "d", "sigma", "geometry.s_exit", *_TIP, *_AXIS)
_ORIGIN = tuple(f"frame_w.r_0[{k}]" for k in range(3))
_TURN = tuple(f"frame_w.R[{i},{j}]" for i in range(3) for j in range(3))
_STILL = 1e-9
"""Motion [m], and change of a rotation matrix, that counts as rounding."""
_CUT = 0.01
"""Ratio of depth to diameter below which the tip has only touched the workpiece."""
_THIN = 1e-7
"""Layer [m] at the end of a hole that is ignored, since plates that lie on each other have a common face."""


def review(run: Result, paths: Sequence[str], scalars: Mapping[str, int]) -> list[str]:
    """Notes AC194 of single drilling forces, and AC192 of those in one workpiece; `paths` are theirs."""
    known = [path for path in paths if all(f"{path}.{name}" in run.signals for name in _SIGNALS)]
    if len(known) == 1 and _is_led(run, known[0]):
        return []
    made = [cut for path in known if len((cut := _Cut.of(run, path)).rows)]
    notes = [note for cut in made if (note := cut.beside())]
    models = _models(scalars)
    groups: dict[int, list[tuple[int, _Cut]]] = {}
    for cut in made:
        if (frame := scalars.get(f"{cut.path}.frame_w.r_0")) is not None:
            groups.setdefault(models(frame), []).append((frame, cut))
    return [*notes, *(note for group in groups.values() for note in _overlapping(run, group))]


def _is_led(run: Result, path: str) -> bool:
    """Whether the compiler has found that the drill cannot leave its axis, so that nothing has to be computed."""
    return all(run.signals[f"{path}.{name}"].column is None for name in (*_TIP[:2], *_AXIS))


def _models(scalars: Mapping[str, int]) -> Callable[[int], int]:
    """Function from the number of a frame's position to that of its model: frames that components connect."""
    above: dict[int, int] = {}

    def root(frame: int) -> int:
        while (upper := above.get(frame, frame)) != frame:
            frame = upper
        return frame

    first: dict[str, int] = {}
    for path, frame in scalars.items():
        if path.endswith(".r_0") and path.count(".") > 1:
            one, other = root(first.setdefault(path.rsplit(".", 2)[0], frame)), root(frame)
            above[max(one, other)] = min(one, other)
    return root


def _overlapping(run: Result, cuts: Sequence[tuple[int, _Cut]]) -> Iterator[str]:
    holes = [(frame, cut.path, cut.hole()) for frame, cut in cuts]
    for (frame, path, one), (other_frame, other_path, other) in combinations(holes, 2):
        moved = other if frame == other_frame else _moved(run, path, other_path, other)
        if moved is not None and one.overlaps(moved):
            yield (
                f"AC192: {named(one, moved)} overlap, {1e3 * one.apart(moved):.3g} mm apart: each is cut as if the "
                "other were full of material"
            )


def _moved(run: Result, path: str, other: str, hole: Hole) -> Hole | None:
    """The hole of `other` in the axes of the workpiece of `path`; None if one moves against the other."""
    if any(f"{p}.{name}" not in run.signals for p in (path, other) for name in (*_ORIGIN, *_TURN)):
        return None
    (r, other_r), (R, other_R) = (
        [np.column_stack([run[f"{p}.{name}"] for name in names]) for p in (path, other)] for names in (_ORIGIN, _TURN)
    )
    R, other_R = R.reshape(-1, 3, 3), other_R.reshape(-1, 3, 3)
    between, turn = np.einsum("nji,nj->ni", R, other_r - r), np.einsum("nji,njk->nik", R, other_R)
    present = np.isfinite(between).all(axis=1) & np.isfinite(turn).all(axis=(1, 2))
    between, turn = between[present], turn[present]
    if not len(turn) or max(np.ptp(between, axis=0).max(), np.ptp(turn, axis=0).max()) > _STILL:
        return None
    return replace(hole, entry=turn[0] @ hole.entry + between[0], axis=turn[0] @ hole.axis)


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
