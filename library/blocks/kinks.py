"""Selection of the kinks of a table that are located as events: all of them if they are few.

If they are many, each run determines those at which it has to stop for its tolerance (`acausal.numeric.table_ends`).
"""

from __future__ import annotations

from collections.abc import Sequence

MANY = 64
"""Largest number of kinks that are relations."""


def few(lengths: Sequence[float], turns: Sequence[float], height: float) -> list[int]:
    """Numbers of the rows that start with a kink; empty if there are more than `MANY`.

    Parameters
    ----------
    lengths
        Length of the interval of each row.
    turns
        Change of slope between neighbouring intervals.
    height
        Range of the values: smaller kinks are rounding errors.
    """
    sizes = [abs(d) * min(a, b) for d, a, b in zip(turns, lengths, lengths[1:], strict=False)]
    seen = [k for k, size in enumerate(sizes, start=1) if size > 1e-9 * height]
    return seen if len(seen) <= MANY else []
