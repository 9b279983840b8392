"""Which kinks of a long table no step of a solver foresees.

A solver whose steps are long, because nothing has happened, steps over what begins there: behind a kink that is much
larger than those shortly before, and behind a stretch that is straight for three times as long as what follows. Where
rows change from one to the next as they did before, its steps follow them, as they follow any curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

MANY = 64
"""Kinks up to which all of them are foreseen by nobody."""

# How many kinks before one are looked at, how much larger it is, and how much longer the straight stretch before it.
_RECENT, _SUDDEN, _LONGER = 8, 8.0, 3.0


def sudden(ends: Sequence[float], turns: Sequence[float], height: float, *, back: bool) -> list[int]:
    """Places among `ends` of the kinks at which a run is to stop.

    Parameters
    ----------
    ends
        Abscissas of all rows and the end of the last one.
    turns
        By how much the slope changes at each of `ends` but the first and the last, so that `turns[0]` is at `ends[1]`.
    height
        The range of the values, beside which a kink is none.
    back
        Whether the table may be passed from its end, too.
    """
    lengths = [b - a for a, b in pairwise(ends)]
    sizes = [abs(d) * min(a, b) for d, a, b in zip(turns, lengths, lengths[1:], strict=False)]
    seen = [k for k, size in enumerate(sizes, start=1) if size > 1e-9 * height]
    if len(seen) <= MANY:
        return seen
    found = _forward(ends, sizes, seen)
    if back:
        flipped = [-v for v in reversed(ends)]
        last = len(ends) - 1
        found |= {last - k for k in _forward(flipped, sizes[::-1], [last - k for k in reversed(seen)])}
    return sorted(found)


def _forward(ends: Sequence[float], sizes: Sequence[float], seen: Sequence[int]) -> set[int]:
    """The same in the order of the abscissas."""
    found = set[int]()
    for n, k in enumerate(seen):
        before = max((sizes[j - 1] for j in range(max(1, k - _RECENT), k)), default=0.0)
        straight = ends[k] - (ends[seen[n - 1]] if n else ends[0])
        follows = (ends[seen[n + 1]] if n + 1 < len(seen) else ends[-1]) - ends[k]
        if sizes[k - 1] > _SUDDEN * before or straight > _LONGER * follows:
            found.add(k)
    return found
