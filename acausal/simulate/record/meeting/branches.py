"""Instants at which a run may have gone on with another solution of its algebraic equations.

Where two solutions cross (y * (x - y) == 0 at x = 0), the Jacobian of the equations is singular, and a run may stay on
its solution or change to the other one, since Newton's method does not know where it came from. No solver notices:
IDAS steps over such a point without an evaluation there, and explicit methods continue with whatever their rootfinder
returns. Both continuations satisfy the equations, so a note says where this happened.

The sign of the determinant, with continuous unknowns, reveals it: this sign is the index of an isolated solution, and
where it changes, other solutions meet this one. Source: M. A. Krasnoselskii, Topological Methods in the
Theory of Nonlinear Integral Equations (1964), chapter IV. Where a run changes to
the other solution, the sign may stay (it is opposite on the two), and it also stays where two others meet this one at
once. So wherever the magnitude of a determinant dips, the solution before it is continued along the recorded states to
the zero. Only blocks that are nonlinear in their own unknowns have several solutions; linear networks cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.diagnose.words import listed
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.lower.diagonal_blocks import nonlinear_blocks
from acausal.recent import once_per_owner
from acausal.result.result import Result
from acausal.simulate.equations.problem import Problem
from acausal.simulate.options import Options
from acausal.simulate.record.divisors.blocks import Blocks, Rows
from acausal.simulate.record.divisors.poles import may_have_poles
from acausal.simulate.record.meeting.between import UNTOLD, Again, rows_between
from acausal.simulate.record.meeting.kinked import meeting_at_kinks
from acausal.simulate.record.record import Recorder

_WAYS = "a run may go straight on or turn off into another one"

_LEAST, _CHEAP = 64, 1e5  # rows examined in any case, and operations that are negligible beside a run
_LARGEST = 300  # largest block whose null space is computed
_DIP = 0.4  # ratio of a determinant near a zero to its values two rows before and after
_POINTS = 37, 289  # points at which the solution is continued near a zero: first, and to confirm what is found
_BEGINS = 1e-5  # ratio of a determinant at a zero where a stretch begins to its value two rows later
_SINGULAR = 0.2  # ratio of a determinant at a zero to the ends of its window; at a pole it exceeds 1
_POLE = 5.0  # largest such ratio where it jumps at a kink
_ZERO = 1e-8  # ratio at which a determinant touches zero
_TURNED = 0.2  # least distance from the continued solution, relative to the change meanwhile
_CALL = 300  # operations that take as long as a call of a function
_ZOOMS = 4  # refinements around a zero that is touched
_MOST = 12  # most windows of a run in which the solution is continued
_MOVE = 1.0  # relative distance from a solution within which the sign of the determinant is examined
_ASIDE = np.geomspace(1e-5, 1.0, 16)  # the points there, as fractions of this distance
_KINKS = frozenset(("fabs", "min", "max", "noevent"))
_SAME = 1e-9  # relative change of a variable at one instant that is a rounding error
_FAINT = 1e-9  # change of an unknown, relative to its nominal magnitude, that counts as none


@dataclass(frozen=True, eq=False)
class _Blocks(Blocks):
    """The nonlinear blocks of a model, and the `modes` on which its rates and equations depend."""

    modes: list[int]


@once_per_owner
def _blocks(compiled: CompiledModel) -> _Blocks | None:
    """The blocks of a model that owns its functions (`common`); None if its equations have one solution."""
    s = Symbols(compiled)
    ode, alg = compiled.rhs(*s.inputs)
    slope = ca.jacobian(alg, s.z)
    found = Blocks.of(compiled, s, slope, nonlinear_blocks(slope, s.z))
    modes = sorted(set(ca.jacobian_sparsity(ca.vertcat(ode, alg), s.m).get_col()))
    return None if found is None else _Blocks(found.blocks, found.slopes, modes)


def looks(compiled: CompiledModel, p: Vector, options: Options, is_fixed: bool) -> Vector:
    """Additional instants [s] that a run with few rows needs for this search, and those of poles and closed loops."""
    several = (
        may_have_poles(compiled, p)
        or bool(compiled.solution.structure.invariants)
        or (bool(compiled.algebraic) and _blocks(compiled.common) is not None)
    )
    if not several or options.span >= _LEAST * options.output_interval:
        return np.zeros(0)
    step = options.step if is_fixed and options.step is not None else options.span / _LEAST
    count = int(options.span / step * (1 - 1e-9))
    return options.start_time + step * np.unique(np.linspace(1, count, min(count, _LEAST)).astype(int))


def crossed_branches(
    problem: Problem, recorder: Recorder, again: Again, step: float | None, is_implicit: bool
) -> tuple[str, ...]:
    """Return the note on points between the rows of a run at which solutions of algebraic equations cross.

    `again`: Repeats the run from one of its rows on.
    `step`: Length of fixed steps [s].
    `is_implicit`: Whether algebraic variables are unknowns of the steps. With fixed implicit steps, a near miss is
    as bad as a crossing: stages may lie on another solution than the ends of steps. The weighted sum of the stages is
    then wrong although all rows satisfy the equations.
    """
    compiled, found, left_out = problem.compiled, meeting_at_kinks(problem, recorder), None
    blocks = _blocks(compiled.common) if compiled.algebraic and recorder.count >= 4 else None
    if blocks is not None:
        whole = _distinct(recorder, blocks.modes)
        steps = recorder.counters.get("steps", len(whole[0]))
        look = partial(_meeting, problem, blocks, steps, step is not None and is_implicit)
        found += look(whole)
        if not found:
            closer, left_out = rows_between(problem, recorder, whole, again, step)
            found += [place for part in closer for place in look(part)]
    if not found:
        return () if left_out is None else (UNTOLD.format(left_out),)
    t, moved = min(found)
    names = listed([problem.compiled.algebraic[c] for c in moved], 4)
    return (
        f"near t = {t:.4g} s solutions of the equations for {names} meet: {_WAYS}, and rounding decides which it "
        "takes; look at these variables after that time, compare solvers, and state which solution is meant, by "
        "where(...) or another form of the equation",
    )


def _meeting(
    problem: Problem, blocks: _Blocks, steps: float, is_coarse: bool, whole: Rows
) -> list[tuple[float, tuple[int, ...]]]:
    """Instants at which solutions meet, and the unknowns in which they differ."""
    compiled, count = problem.compiled, len(whole[0])
    work = _CALL + blocks.slopes.function.n_instructions() + sum(len(b.row) * len(b.columns) for b in blocks.blocks)
    # no more rows than the solver has made steps: further rows would add little
    most = int(max(_LEAST, steps, _CHEAP / work))
    some = np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))
    joined = _joined(whole, blocks.modes, some)
    at = tuple(a[..., some] for a in whole)
    found: list[tuple[float, tuple[int, ...]]] = []
    all_signs, all_sizes = blocks.determinants(problem, at)
    flips, dips = _turning(joined, all_signs, all_sizes)
    for number, block in enumerate(blocks.blocks if _KINKS & compiled.operations else ()):
        dips[number] |= _turns(joined, at[0], at[2][block.columns])
    for number, k in np.argwhere(_beginning(joined, all_sizes)).tolist():
        place = _place(problem, blocks, number, at, [k, k], tuple(a[..., k + 2 : k + 3] for a in at))
        found += [] if place is None else [place]
    for number in np.flatnonzero(flips.any(axis=1) | dips.any(axis=1)).tolist():
        signs, sizes, low = all_signs[number], all_sizes[number], np.flatnonzero(dips[number])
        for first, last in _windows(joined, np.flatnonzero(flips[number]), low[np.argsort(sizes[low])]):
            window = tuple(a[..., some[first] : some[last] + 1] for a in whole)
            ends, flipped = sizes[[first, last]], signs[first] * signs[last] < 0.0
            places = [_crossing(problem, blocks, number, window, ends, flipped, _POINTS[0])]
            if is_coarse:
                places += _other_solution(problem, blocks.blocks[number].columns, window)
            elif places[0] is not None:
                places = [_crossing(problem, blocks, number, window, ends, flipped, _POINTS[1])]
            found += [place for place in places if place is not None][:1]
    return found


def _distinct(recorder: Recorder, modes: list[int]) -> Rows:
    """The rows of a run without repeated ones: a located kink changes neither variables nor equations."""
    t, x, z, m = recorder.rows()
    again = (np.diff(t) <= 0.0) & (m[modes, 1:] == m[modes, :-1]).all(axis=0)
    for values, nominal in ((x, recorder.compiled.nominal_x), (z, recorder.compiled.nominal_z)):
        again &= (np.abs(np.diff(values)) <= _SAME * (nominal[:, None] + np.abs(values[:, 1:]))).all(axis=0)
    kept = np.concatenate([[True], ~again])
    return t[kept], x[:, kept], z[:, kept], m[:, kept]


def _joined(whole: Rows, modes: list[int], some: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether no event lies between each of the rows `some` and the next one, shape (some - 1,)."""
    t, m = whole[0], whole[3][modes]
    apart = (np.diff(t) <= 0.0) | (m[:, 1:] != m[:, :-1]).any(axis=0)
    before = np.concatenate([[0], np.cumsum(apart)])[some]
    return np.asarray(before[1:] == before[:-1])


def _turning(joined: NDArray[np.bool_], signs: Vector, sizes: Vector) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether determinants change sign before the next row, and whether they dip at a row; shape (blocks, rows)."""
    flips, dips = np.zeros(signs.shape, dtype=bool), np.zeros(signs.shape, dtype=bool)
    kept = signs.copy()  # a row exactly at a zero gets the sign of the row before
    kept[:, 1:] = np.where(signs[:, 1:] == 0.0, signs[:, :-1], signs[:, 1:])
    flips[:, :-1] = joined & (kept[:, 1:] * kept[:, :-1] < 0.0)
    if signs.shape[1] >= 5:
        inside = joined[:-3] & joined[1:-2] & joined[2:-1] & joined[3:]
        left, right = np.maximum(sizes[:, :-4], sizes[:, 1:-3]), np.maximum(sizes[:, 3:-1], sizes[:, 4:])
        dips[:, 2:-2] = inside & (sizes[:, 2:-2] <= np.minimum(left, right) + np.log(_DIP))
    return flips, dips


def _beginning(joined: NDArray[np.bool_], sizes: Vector) -> NDArray[np.bool_]:
    """Whether a stretch, after the start or an event, begins at a zero of the determinant; shape (blocks, rows - 2)."""
    first = np.concatenate([[True], ~joined[:-2]]) & joined[:-1] & joined[1:]
    return np.asarray(first & (sizes[:, :-2] < sizes[:, 2:] + np.log(_BEGINS)))


def _turns(joined: NDArray[np.bool_], t: Vector, z: Vector) -> NDArray[np.bool_]:
    """Whether the slopes of some unknowns `z`, shape (size, n), change at a row; shape (n,)."""
    found = np.zeros(len(t), dtype=bool)
    if len(t) < 5:
        return found
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = np.diff(z) / np.diff(t)
        before, behind = slopes[:, :-3], slopes[:, 3:]
        turned = np.abs(behind - before) > np.maximum(np.abs(before), np.abs(behind))
    found[2:-2] = turned.any(axis=0) & joined[:-3] & joined[1:-2] & joined[2:-1] & joined[3:]
    return found


def _windows(joined: NDArray[np.bool_], flips: NDArray[np.intp], dips: NDArray[np.intp]) -> list[tuple[int, int]]:
    """First and last rows of windows around changes of sign (before the next row) and around dips (at a row)."""
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
    """Return the instant of a crossing in a window, and the unknowns in which solutions differ; None if there is none.

    `ends`: Logarithms of the determinant in the first and the last row of the window.
    `flips`: Whether its signs there differ.
    `points`: Number of points at which the solution is continued.
    """
    columns, (t, _, z, _) = blocks.blocks[number].columns, window
    wanted = np.union1d(np.linspace(t[0], t[-1], points), t)[1:]
    try:
        along, signs, sizes = _straight_on(problem, blocks, number, window, wanted)
    except RuntimeError:  # the solution ends here, and the run continues on another one
        return (float(np.mean(t)), tuple(columns.tolist())) if flips else None
    changes = signs[1:] * signs[:-1] <= 0.0
    changes &= np.maximum(sizes[1:], sizes[:-1]) < np.log(_POLE) + float(ends.max())
    if changes.any():
        k = int(np.argmax(changes))
        return _place(problem, blocks, number, along, [k, k + 1], tuple(a[..., [0, -1]] for a in along))
    scale = problem.scale_z[columns]
    off = np.abs(along[2][columns][:, np.isin(wanted, t)] - z[columns, 1:]).max(axis=1) / scale
    passed = np.abs(z[columns] - z[columns, :1]).max(axis=1) / scale
    turned = off > _TURNED * passed + _FAINT
    k = int(np.argmin(sizes))
    if not (flips or sizes[k] < np.log(_SINGULAR) + float(ends.min())):
        return None
    if turned.any():
        return float(wanted[k]), tuple(columns[turned].tolist())
    return _touching(problem, blocks, number, window, wanted[max(k - 1, 0) : k + 2], float(ends.min()))


def _straight_on(
    problem: Problem, blocks: _Blocks, number: int, window: Rows, wanted: Vector
) -> tuple[Rows, Vector, Vector]:
    """Continue the solution from the first row of a window to some instants; return it with its determinants."""
    x, z = problem.straight_on(window, wanted)
    along = wanted, x, z, np.tile(window[3][:, :1], (1, len(wanted)))
    signs, sizes = blocks.determinants(problem, along)
    return along, signs[number], sizes[number]


def _touching(
    problem: Problem, blocks: _Blocks, number: int, window: Rows, wanted: Vector, end: float
) -> tuple[float, tuple[int, ...]] | None:
    """Return where the determinant touches zero without a change of sign near some instants; None if it does not."""
    for _ in range(_ZOOMS):
        try:
            at = np.linspace(wanted[0], wanted[-1], _POINTS[0])
            along, _, sizes = _straight_on(problem, blocks, number, window, at)
        except RuntimeError:
            return None
        k = int(np.argmin(sizes))
        if sizes[k] < np.log(_ZERO) + end:
            return _place(problem, blocks, number, along, [k, k], tuple(a[..., [0, -1]] for a in window))
        wanted = at[max(k - 1, 0) : k + 2]
    return None


def _other_solution(problem: Problem, columns: NDArray[np.intp], window: Rows) -> list[tuple[float, tuple[int, ...]]]:
    """Return the first row that is on another solution than the two before, and its unknowns; none or one."""
    t, _, z, _ = window
    scale, at = problem.scale_z[columns, None], problem.extrapolated(window)[columns]
    passed = np.abs(z[columns] - z[columns, :1]).max(axis=1, keepdims=True) / scale
    other = np.abs(at - z[columns, 2:]) / scale > _TURNED * passed + _FAINT  # false for nan
    return [(float(t[k + 2]), tuple(columns[other[:, k]].tolist())) for k in np.flatnonzero(other.any(axis=0))[:1]]


def _place(
    problem: Problem, blocks: _Blocks, number: int, along: Rows, two: list[int], beside: Rows
) -> tuple[float, tuple[int, ...]] | None:
    """Return the crossing between two points of a solution; None if there is no other solution at the rows `beside` it.

    The other solution departs along the null space of the Jacobian, and between the two lies a zero of the determinant.
    If its sign does not change along this direction, there is one solution only: any z satisfies x * (z - 1) == 0 at
    x = 0, and y**3 == x has an infinite slope there.
    """
    block = blocks.blocks[number]
    columns, (before, behind) = block.columns, two
    entries = blocks.entries(problem, tuple(a[..., two] for a in along))[number]
    signs, sizes = block.determinants(entries)
    k = behind if sizes[1] < sizes[0] else before
    t = float(along[0][k])
    if len(columns) > _LARGEST:
        return t, tuple(columns.tolist())
    values = np.exp(np.minimum(sizes - sizes.max(), 0.0)) if np.isfinite(sizes.max()) else np.ones(2)
    share = values[0] / values.sum()  # at a kink the zero is that of a mean of both Jacobians
    matrix = block.matrices((1 - share) * entries[:1] + share * entries[1:])[0]
    size = np.maximum(np.abs(matrix).max(axis=1, keepdims=True), 1e-300)
    direction = np.linalg.svd(matrix / size)[2][-1]
    moved = _MOVE * (1.0 + float((np.abs(along[2][columns, k]) / problem.scale_z[columns]).max()))
    aside = np.concatenate([moved * _ASIDE, -moved * _ASIDE])
    there = tuple(np.repeat(a, len(aside), axis=-1) for a in beside)
    there[2][columns] += np.outer(problem.scale_z[columns] * direction, np.tile(aside, len(beside[0])))
    signs = blocks.determinants(problem, there)[0][number].reshape(-1, len(aside))
    if not ((signs.min(axis=1) < 0.0) & (signs.max(axis=1) > 0.0)).any():
        return None
    return t, tuple(columns[np.abs(direction) > 0.1 * np.abs(direction).max()].tolist())


def on_meeting(result: Result) -> tuple[str, ...]:
    """The notes of a run that say where solutions meet, or may meet."""
    notes = result.stats["notes"]
    assert isinstance(notes, tuple)
    return tuple(note for note in notes if _WAYS in note or UNTOLD.rpartition("}")[2] in note)
