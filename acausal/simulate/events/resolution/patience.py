"""Looks at relations of a high degree, and those that are given up because too many looks have found nothing.

Bounds of a relation that is a quotient of small forces may include zero wherever a component of the forces is rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

# The most looks while the run advances by this fraction of its length.
MOST_LOOKS, _ADVANCE = 200, 1e-2


@dataclass
class Patience:
    """Looks in a run of length `span` [s]; `lost` are the numbers of relations that are given up."""

    span: float
    since: float = -math.inf
    looks: int = 0
    lost: set[int] = field(default_factory=set)

    def look(self, t: float, relations: Iterable[int]) -> None:
        """Count a look at some relations after time `t` [s]."""
        if t - self.since > _ADVANCE * self.span:
            self.since, self.looks = t, 0
        self.looks += 1
        if self.looks > MOST_LOOKS:
            self.lost.update(relations)
