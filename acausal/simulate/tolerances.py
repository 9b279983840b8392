"""Tolerances: what a run promises, and what of it a solver, a search or a check gets. Nothing else scales them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Tolerances:
    """A relative tolerance, and `factor` times as much in nominal magnitudes as the absolute one."""

    relative: float
    factor: float = 1e-3

    @property
    def absolute(self) -> float:
        """The absolute tolerance, in nominal magnitudes."""
        return self.relative * self.factor

    def scaled(self, share: float, least: float = 0.0) -> Tolerances:
        """So many times both, and the relative one at least `least`."""
        return replace(self, relative=max(share * self.relative, least))

    def of(self, values: ArrayLike, nominal: ArrayLike = 1.0) -> NDArray[np.float64]:
        """What values of this size may be off, shape that of the values; `nominal` where they are not scaled."""
        return np.asarray(self.relative * np.abs(values) + self.absolute * np.asarray(nominal))
