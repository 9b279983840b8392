"""Which kinks of a table are located as events: all of them, where they are few.

Where they are many, each run finds those at which it has to stop for its tolerance (`acausal.numeric.table_ends`).
"""

from __future__ import annotations

from collections.abc import Sequence

MANY = 64
"""Kinks up to which all of them are relations."""


def few(lengths: Sequence[float], turns: Sequence[float], height: float) -> list[int]:
    """Numbers of the rows that begin with a kink; an empty result where there are many.

    Parameters
    ----------
    lengths
        Length of the interval that each row begins.
    turns
        By how much the slope changes between neighbours.
    height
        Range of the values: smaller kinks are rounding errors.
    """
    sizes = [abs(d) * min(a, b) for d, a, b in zip(turns, lengths, lengths[1:], strict=False)]
    seen = [k for k, size in enumerate(sizes, start=1) if size > 1e-9 * height]
    return seen if len(seen) <= MANY else []
