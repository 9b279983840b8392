"""Instants at which a run may have gone on with another solution of its algebraic equations.

Where two solutions cross (y * (x - y) == 0 at x = 0) the slope of the equations by their unknowns is singular, and a
run may go straight on or turn off; Newton's method knows nothing of where it came from. No solver refuses this by
itself: IDAS steps over such a point without an evaluation there, and explicit methods go on with what their
rootfinder returns. Neither is wrong by the equations, so a note says where it was.

A determinant that changes its sign while the unknowns stay continuous tells it: the index of an isolated solution is
this sign, and where it changes, other solutions meet this one. Source: M. A. Krasnoselskii, Topological Methods in the
Theory of Nonlinear Integral Equations (1964), chapter IV. Where a run turns off, the sign may stay (it is opposite on
the two solutions): so the solution is followed straight on from before, along the recorded states. Only blocks that are
nonlinear in their own unknowns have several solutions, so those of networks that are linear cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.diagnose.words import listed
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.record import Recorder

Rows = tuple[Vector, ...]  # times, states, algebraic variables, modes; columns are instants

_LARGEST = 60  # unknowns of a block
_MOST_WORK, _FEWEST = 1e5, 64  # operations for the determinants of a run, and rows that are looked at in any case
_DIP = 0.4  # what is left of a determinant beside a zero, by its values two rows before and behind
_POINTS = 37, 289  # at which the solution is followed beside a zero: what is found has to stay at the second
_SINGULAR = 0.2  # what is left there, by the ends: a pole goes the other way
_CURVED = 0.05  # change of the determinant with the unknowns at its zero, by its values at the ends
_TURNED = 0.2  # distance from the solution straight on, by what is passed meanwhile
_CALL = 300  # operations that take as long as a call
_MOST = 12  # places of a run that are followed
_MOVE = 0.1  # of the unknowns, by their size, over which this change is taken
_FAINT = 1e-9  # change of an unknown, by its nominal magnitude, that is none


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Blocks of algebraic equations with several solutions: places among the unknowns, and their slopes."""

    columns: tuple[NDArray[np.intp], ...]
    slopes: Any  # `(t, x, z, u, p, m) -> entries` of the blocks one by one, each column by column

    def matrices(self, problem: Problem, at: Rows) -> list[Vector]:
        """Slopes of each block by its own unknowns in their nominal magnitudes, shape (n, size, size)."""
        t, x, z, m = (np.ascontiguousarray(a.T) for a in at)
        entries = rows(self.slopes, (t[:, None], x, z, problem.u, problem.p, m))
        entries[~np.isfinite(entries)] = 0.0
        sizes = [len(c) for c in self.columns]
        parts = np.split(entries, np.cumsum(np.square(sizes))[:-1], axis=1)
        return [part.reshape(-1, n, n).transpose(0, 2, 1) for part, n in zip(parts, sizes, strict=True)]

    def determinants(self, problem: Problem, at: Rows) -> tuple[Vector, Vector]:
        """Signs of the determinants of all blocks, and logarithms of their magnitudes, shape (blocks, n) each."""
        with np.errstate(divide="ignore"):
            found = [
                (np.sign(m[:, 0, 0]), np.log(np.abs(m[:, 0, 0]))) if m.shape[1] == 1 else np.linalg.slogdet(m)
                for m in self.matrices(problem, at)
            ]
        return np.array([signs for signs, _ in found]), np.array([sizes for _, sizes in found])


# None for models whose equations have one solution.
_KNOWN: WeakKeyDictionary[CompiledModel, _Blocks | None] = WeakKeyDictionary()


def _blocks(compiled: CompiledModel) -> _Blocks | None:
    compiled = compiled.common
    if compiled not in _KNOWN:
        s = Symbols(compiled)
        slope = ca.jacobian(compiled.rhs(*s.inputs)[1], s.z)
        pattern = slope.sparsity()
        _, order, unknowns, first, *_ = pattern.btf()
        curved = ca.jacobian_sparsity(slope.nz[:], s.z).T  # columns are entries of the slope
        at, depends = curved.colind(), curved.row()
        columns: list[NDArray[np.intp]] = []
        entries: list[int] = []
        for a, b in pairwise(first):
            places = unknowns[a:b]
            own, taken = set(places), pattern.get_nz(order[a:b], places) if b - a <= _LARGEST else []
            if any(own.intersection(depends[at[k] : at[k + 1]]) for k in taken if k >= 0):
                columns.append(np.array(places, dtype=np.intp))
                entries += [k % (slope.nnz() + 1) for k in taken]  # -1 is none, which is the zero behind all others
        scaled = ca.vertcat((slope @ ca.diag(ca.DM(compiled.nominal_z))).nz[:], 0.0)
        function = ca.Function("slopes", s.inputs, [ca.densify(scaled[entries])]) if entries else None
        _KNOWN[compiled] = _Blocks(tuple(columns), function) if entries else None
    return _KNOWN[compiled]


def crossed_branches(problem: Problem, recorder: Recorder, is_coarse: bool) -> tuple[str, ...]:
    """The note on points between the rows of a run at which solutions of algebraic equations cross.

    `is_coarse`: Whether the run itself may take a near miss for a crossing: fixed implicit steps, whose stages may stay
    on another solution than their ends. The sum of these is then wrong, though all rows solve the equations.
    """
    compiled = problem.compiled
    if not compiled.algebraic or recorder.count < 4:
        return ()
    blocks = _blocks(compiled)
    if blocks is None:
        return ()
    whole = recorder.rows()
    work = _CALL + blocks.slopes.n_instructions() + sum(len(c) ** 3 for c in blocks.columns)
    most = max(_FEWEST, int(_MOST_WORK / work))
    some = np.unique(np.linspace(0, recorder.count - 1, min(recorder.count, most)).astype(int))
    joined = _joined(whole, some)
    at = tuple(a[..., some] for a in whole)
    found: list[tuple[float, tuple[int, ...]]] = []
    all_signs, all_sizes = blocks.determinants(problem, at)
    flips, dips = _turning(joined, all_signs, all_sizes)
    for number in np.flatnonzero(flips.any(axis=1) | dips.any(axis=1)).tolist():
        signs, sizes, z = all_signs[number], all_sizes[number], at[2][blocks.columns[number]]
        low = np.flatnonzero(dips[number] & _turns(at[0], z))
        for first, last in _windows(joined, np.flatnonzero(flips[number]), low[np.argsort(sizes[low])]):
            window = tuple(a[..., some[first] : some[last] + 1] for a in whole)
            ends, flipped = sizes[[first, last]], signs[first] * signs[last] < 0.0
            tried = [_crossing(problem, blocks, number, window, ends, flipped, points) for points in _POINTS]
            places = [place for place in tried if place is not None]
            if is_coarse:
                places += _other_solution(problem, blocks.columns[number], window)
            found += places[:1] if is_coarse or len(places) == len(tried) else []
    if not found:
        return ()
    t, moved = min(found)
    names = listed([compiled.algebraic[c] for c in moved], 4)
    return (
        f"near t = {t:.4g} s solutions of the equations for {names} meet: a run may go straight on or turn off into "
        "another one, and rounding decides which it takes; look at these variables behind that time, compare solvers, "
        "and state which solution is meant, by where(...) or another form of the equation",
    )


def _joined(whole: Rows, some: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether nothing happens between each of some rows and the next one, shape (some - 1,)."""
    t, m = whole[0], whole[3]
    apart = (np.diff(t) <= 0.0) | (m[:, 1:] != m[:, :-1]).any(axis=0)
    before = np.concatenate([[0], np.cumsum(apart)])[some]
    return np.asarray(before[1:] == before[:-1])


def _turning(joined: NDArray[np.bool_], signs: Vector, sizes: Vector) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether determinants have another sign in the next row, and whether they dip in a row, shape (blocks, rows)."""
    flips, dips = np.zeros(signs.shape, dtype=bool), np.zeros(signs.shape, dtype=bool)
    kept = signs.copy()  # a row exactly on a zero has the sign of the one before
    kept[:, 1:] = np.where(signs[:, 1:] == 0.0, signs[:, :-1], signs[:, 1:])
    flips[:, :-1] = joined & (kept[:, 1:] * kept[:, :-1] < 0.0)
    if signs.shape[1] >= 5:
        inside = joined[:-3] & joined[1:-2] & joined[2:-1] & joined[3:]
        left, right = np.maximum(sizes[:, :-4], sizes[:, 1:-3]), np.maximum(sizes[:, 3:-1], sizes[:, 4:])
        dips[:, 2:-2] = inside & (sizes[:, 2:-2] <= np.minimum(left, right) + np.log(_DIP))
    return flips, dips


def _turns(t: Vector, z: Vector) -> NDArray[np.bool_]:
    """Whether some of the unknowns `z`, shape (size, n), have other slopes before a row and behind it, shape (n,)."""
    found = np.zeros(len(t), dtype=bool)
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = np.diff(z) / np.diff(t)
        before, behind = slopes[:, :-3], slopes[:, 3:]
        turned = np.abs(behind - before) > _TURNED * np.maximum(np.abs(before), np.abs(behind))
    found[2:-2] = turned.any(axis=0)
    return found


def _windows(joined: NDArray[np.bool_], flips: NDArray[np.intp], dips: NDArray[np.intp]) -> list[tuple[int, int]]:
    """First and last rows around some flips between a row and the next, and around dips in a row."""
    windows: list[tuple[int, int]] = []
    for k, behind in [*((k, 3) for k in flips.tolist()), *((k, 2) for k in dips.tolist())]:
        first, last = max(k - 2, 0), min(k + behind, len(joined))
        while first < k and not joined[first:k].all():
            first += 1
        while last > k + 1 and not joined[k:last].all():
            last -= 1
        if len(windows) < _MOST and all(abs(first - other) > 1 for other, _ in windows):
            windows.append((first, last))
    return windows


def _crossing(
    problem: Problem, blocks: _Blocks, number: int, window: Rows, ends: Vector, flips: bool, points: int
) -> tuple[float, tuple[int, ...]] | None:
    """Instant of a crossing among a few rows, and the unknowns that it moves; None where there is none.

    `ends`: Logarithms of the determinant in the first and the last of these rows.
    `flips`: Whether its sign is another one in the last.
    `points`: At which the solution is followed.
    """
    columns, (t, _, z, m) = blocks.columns[number], window
    wanted = np.union1d(np.linspace(t[0], t[-1], points), t)[1:]
    try:
        x, straight = problem.straight_on(window, wanted)
    except RuntimeError:  # the solution ends, and the run goes on
        return (float(np.mean(t)), tuple(columns.tolist())) if flips else None
    modes = np.tile(m[:, :1], (1, len(wanted)))
    along = wanted, x, straight, modes
    signs, sizes = (found[number] for found in blocks.determinants(problem, along))
    least = np.log(_SINGULAR) + float(ends.min())
    changes = np.flatnonzero((signs[1:] * signs[:-1] <= 0.0) & (np.minimum(sizes[1:], sizes[:-1]) < least))
    scale = problem.scale_z[columns]
    if len(changes):
        k = int(changes[0])
        k += int(sizes[k + 1] < sizes[k])
        return _place(problem, blocks, number, along, k, float(ends.min()))
    off = np.abs(straight[columns][:, np.isin(wanted, t)] - z[columns, 1:]).max(axis=1) / scale
    passed = np.abs(z[columns] - z[columns, :1]).max(axis=1) / scale
    turned = off > _TURNED * passed + _FAINT
    k = int(np.argmin(sizes))
    return (float(wanted[k]), tuple(columns[turned].tolist())) if turned.any() and (flips or sizes[k] < least) else None


def _other_solution(problem: Problem, columns: NDArray[np.intp], window: Rows) -> list[tuple[float, tuple[int, ...]]]:
    """The first row to which the line of the two before leads to another solution, and its unknowns; none or one."""
    t, _, z, _ = window
    scale, at = problem.scale_z[columns, None], problem.extrapolated(window)[columns]
    passed = np.abs(z[columns] - z[columns, :1]).max(axis=1, keepdims=True) / scale
    other = np.abs(at - z[columns, 2:]) / scale > _TURNED * passed + _FAINT  # nan is none
    return [(float(t[k + 2]), tuple(columns[other[:, k]].tolist())) for k in np.flatnonzero(other.any(axis=0))[:1]]


def _place(
    problem: Problem, blocks: _Blocks, number: int, along: Rows, k: int, end: float
) -> tuple[float, tuple[int, ...]] | None:
    """The crossing at one of the points of a solution; None where the unknowns are only undefined there.

    The other solution leaves in the direction in which the equations have no slope. Where that stays so along this
    direction (x * (z - 1) == 0 at x = 0) there is none: any z solves the equations there, and beside it only one.
    """
    columns = blocks.columns[number]
    here = tuple(a[..., [k, k, k]] for a in along)
    matrix = blocks.matrices(problem, here)[number][0]
    size = np.maximum(np.abs(matrix).max(axis=1, keepdims=True), 1e-300)
    direction = np.linalg.svd(matrix / size)[2][-1]
    moved = _MOVE * (1.0 + float((np.abs(along[2][columns, k]) / problem.scale_z[columns]).max()))
    z = here[2].copy()
    z[columns] += np.outer(problem.scale_z[columns] * direction, [0.0, moved, -moved])
    signs, sizes = (found[number] for found in blocks.determinants(problem, (here[0], here[1], z, here[3])))
    values = signs * np.exp(np.minimum(sizes - end, 50.0))
    if not np.abs(values[1:] - values[0]).max() > _CURVED:
        return None
    return float(along[0][k]), tuple(columns[np.abs(direction) > 0.1].tolist())
