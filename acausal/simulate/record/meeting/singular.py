"""Singular positions of mechanisms that a run has passed.

Where the constraints of positions depend on each other, a mechanism can continue in more than one way: a parallelogram
that is stretched out can also fold back. Its inertia decides, but only exactly on the constraints. As little as a
tolerance away from them, the two motions become separate branches, and a solver with small steps may change from one to
the other. Rounding errors decide which one a run takes, so a note says where that was.

On the way through such a position the smallest singular value of the Jacobian falls to zero and rises again, both
linearly; if the mechanism only comes near, it turns before. Rows are too far apart to distinguish these, but there are
two signs: a minor of the Jacobian that changes its sign was zero in between; and if the motion changed to another
branch, velocities differ by far more than the rates on both sides explain.
"""

from __future__ import annotations

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.record.project import constraints
from acausal.simulate.record.record import Recorder

_RANK = 1e-9  # ratio to the largest singular value below which another counts as zero
_NEAR = 0.3  # ratio of the smallest singular value near such a position to its maximum over the run
_ALIKE = 0.5  # how far apart the zeros extrapolated from both sides may be, in distances of rows
_TURNED = 0.3  # change of a state that its rates do not explain, relative to its size


def singular_positions(recorder: Recorder) -> tuple[str, ...]:
    """Return the note on singular positions of closed loops between the rows of a run."""
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
        "of them a run takes; look at the motion after it, and compare solvers",
    )


def _turning(times: Vector, slopes: Vector) -> list[int]:
    """Return rows at which the smallest singular value turns as if it were zero nearby; never next to an event."""
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
    """Whether the largest minor in the row before has changed its sign in the row after."""
    import scipy.linalg  # the import takes a tenth of a second, and few runs need it

    *_, order = scipy.linalg.qr(slopes[k - 1], mode="economic", pivoting=True)
    rows, columns = slopes.shape[1:]
    chosen = order[: min(rows, columns)]
    if rows > columns:
        return False
    signs = np.linalg.slogdet(slopes[[k - 1, k + 1]][:, :, chosen])[0]
    return bool(signs[0] * signs[1] < 0.0)


def _turns_off(recorder: Recorder, k: int) -> bool:
    """Whether the rates on both sides do not explain the change of some state around that row."""
    times, x, z, m = recorder.rows()
    before, behind = (
        np.array(recorder.compiled.rhs(times[j], x[:, j], z[:, j], recorder.u, recorder.p, m[:, j])[0]).ravel()
        for j in (k - 1, k + 1)
    )
    told = (times[k + 1] - times[k - 1]) * (before + behind) / 2
    left = np.abs(x[:, k + 1] - x[:, k - 1] - told)
    size = np.abs(x[:, k - 2 : k + 3]).max(axis=1) + 1e-3 * recorder.compiled.nominal_x
    return bool((left > _TURNED * size).any())
