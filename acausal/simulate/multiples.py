"""Multiples of an interval, as a user would write them."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector

# Intervals are taken for fractions with denominators up to this, if one of these is the same number; and the largest
# integer that a number holds exactly.
_LARGEST_DENOMINATOR, _EXACT = 10**9, 2**53


def multiples(first: float, interval: float, k: NDArray[np.int64]) -> Vector:
    """Instants `first + k * interval` [s], rounded once: the third multiple of 0.3 is 0.9, not 0.8999999999999999.

    A product rounds the interval and then its multiple, so that tables of results would have times of 17 digits.
    """
    instants: Vector = np.asarray(first + interval * k, dtype=np.float64)
    a, h = _fraction(first), _fraction(interval)
    if not len(k) or float(a) != first or float(h) != interval:
        return instants
    denominator = a.denominator * h.denominator
    offset, factor = a.numerator * h.denominator, h.numerator * a.denominator
    largest = abs(offset) + factor * int(np.abs(k).max())
    if max(largest, denominator) > _EXACT:
        return instants
    # both integers are exact, and a division rounds once
    return np.asarray((offset + factor * k.astype(np.float64)) / denominator)


@lru_cache(maxsize=256)
def _fraction(value: float) -> Fraction:
    return Fraction(value).limit_denominator(_LARGEST_DENOMINATOR)
