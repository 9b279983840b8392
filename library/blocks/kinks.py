"""Which kinks of a table are relations of the model: all, where they are few.

What lies between many is found by each run for its tolerance (`acausal.numeric.table_ends`).
"""

from __future__ import annotations

from collections.abc import Sequence

MANY = 64
"""Kinks up to which all of them are relations."""


def few(lengths: Sequence[float], turns: Sequence[float], height: float) -> list[int]:
    """Numbers of the rows that begin with a kink; none where there are many.

    Parameters
    ----------
    lengths
        Of all rows.
    turns
        By how much the slope changes between neighbours.
    height
        The range of the values, beside which a kink is none.
    """
    sizes = [abs(d) * min(a, b) for d, a, b in zip(turns, lengths, lengths[1:], strict=False)]
    seen = [k for k, size in enumerate(sizes, start=1) if size > 1e-9 * height]
    return seen if len(seen) <= MANY else []
