"""Singular positions of mechanisms that a run has passed.

Where constraints of positions depend on each other, a mechanism can go on in more than one way: a parallelogram that
is stretched out also folds back. Its inertia decides, but only as long as it is exactly on the constraints: beside them
by as little as a tolerance the two ways become two branches, and a solver with small steps turns off from one into the
other. Which of them a run took is told by nothing but rounding, so a note says where that was.

On a way through such a position the least singular value of the Jacobian falls to zero and rises again, both linearly.
A mechanism that only comes near turns before. Rows are too far apart to see which it was, but not these two signs: a
minor of the Jacobian that has changed its sign was zero in between; and where the motion turned off, velocities differ
by far more than the rates on both sides tell.
"""

from __future__ import annotations

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.record.project import constraints
from acausal.simulate.record.record import Recorder

_RANK = 1e-9  # smallest singular value that counts, by the largest
_NEAR = 0.3  # the least singular value of rows beside such a position, by its largest of the run
_ALIKE = 0.5  # how far apart both sides may see the zero, in distances of rows
_TURNED = 0.3  # what rates leave unexplained of a change, by the size of the state


def singular_positions(recorder: Recorder) -> tuple[str, ...]:
    """The note on singular positions of closed loops between the rows of a run."""
    structure = recorder.compiled.solution.structure
    stated = [k for k, (e, _) in enumerate(structure.invariants) if e not in structure.integral]
    if not stated or recorder.count < 5:
        return ()
    times, x, z, m = recorder.rows()
    slopes = constraints(recorder.compiled, times, x, z, recorder.u, recorder.p, m)[1][:, stated]
    slopes = slopes * recorder.compiled.nominal_x
    if not np.isfinite(slopes).all():
        return ()
    found = [k for k in _turning(times, slopes) if _is_passed(slopes, k) or _turns_off(recorder, k)]
    if not found:
        return ()
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return (
        f"near t = {times[found[0]]:.4g} s{more} the mechanism passes a position, stretched out or folded, in which "
        "its constraints depend on each other and from which it can go on in more than one way: rounding decides which "
        "of them a run takes; look at the motion behind it, and compare solvers",
    )


def _turning(times: Vector, slopes: Vector) -> list[int]:
    """Rows at which the least singular value turns as if it were zero beside them; never beside an event."""
    sizes = np.linalg.svd(slopes, compute_uv=False)
    rank = int((sizes > _RANK * sizes[:, :1]).sum(axis=1).max(initial=0))
    if not rank:
        return []
    least, found = sizes[:, rank - 1] / sizes[:, 0], []
    turns = np.flatnonzero((least[1:-1] <= least[:-2]) & (least[1:-1] < least[2:])) + 1
    for k in turns.tolist():
        if k < 2 or k > len(times) - 3 or not (np.diff(times[k - 2 : k + 3]) > 0.0).all():
            continue
        a, b, _, c, d = least[k - 2 : k + 3].tolist()
        if not (a > b and d > c and max(b, c) < _NEAR * least.max()):
            continue
        left = times[k - 1] + b * (times[k - 1] - times[k - 2]) / (a - b)
        right = times[k + 1] - c * (times[k + 2] - times[k + 1]) / (d - c)
        if abs(right - left) < _ALIKE * (times[k + 1] - times[k - 1]):
            found.append(k)
    return found


def _is_passed(slopes: Vector, k: int) -> bool:
    """Whether the largest minor of the row before has another sign in the row behind."""
    import scipy.linalg  # a tenth of a second, which only runs with such rows have to wait for

    *_, order = scipy.linalg.qr(slopes[k - 1], mode="economic", pivoting=True)
    rows, columns = slopes.shape[1:]
    chosen = order[: min(rows, columns)]
    if rows > columns:
        return False
    signs = np.linalg.slogdet(slopes[[k - 1, k + 1]][:, :, chosen])[0]
    return bool(signs[0] * signs[1] < 0.0)


def _turns_off(recorder: Recorder, k: int) -> bool:
    """Whether some state changed beside that row by what the rates on both sides do not tell."""
    times, x, z, m = recorder.rows()
    before, behind = (
        np.array(recorder.compiled.rhs(times[j], x[:, j], z[:, j], recorder.u, recorder.p, m[:, j])[0]).ravel()
        for j in (k - 1, k + 1)
    )
    told = (times[k + 1] - times[k - 1]) * (before + behind) / 2
    left = np.abs(x[:, k + 1] - x[:, k - 1] - told)
    size = np.abs(x[:, k - 2 : k + 3]).max(axis=1) + 1e-3 * recorder.compiled.nominal_x
    return bool((left > _TURNED * size).any())
