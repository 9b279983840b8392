"""What is integrated between two events: the equations of fixed modes, and relations that are held at their guard.

A held relation is one of two things. In a *sliding mode* both sides of a relation lead back to it, a relay at its
switching point: its mode is then a number between 0 and 1, the one that keeps the distance to the guard constant
(A. F. Filippov, Differential Equations with Discontinuous Righthand Sides, 1988; V. I. Utkin, Sliding Modes in Control
and Optimization, 1992). At *rest* a `when` that resets a velocity has acted ever sooner, a ball on the floor: the rate
of that velocity is then the one that keeps distance and approach at zero, until it would have to pull.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.problem import Problem
from acausal.simulate.equations.shares import Border
from acausal.simulate.events.active_set import TOGETHER, ActiveSet, Hold, active_set
from acausal.simulate.native.policy import Library


@dataclass(frozen=True, eq=False)
class Regime:
    """What is integrated by one run for one set of held relations; `free` is the problem of the free model.

    With a `border` the equations of the mode leave loads open (`simulate/equations/shares.py`).

    The guards are positive while the regime lasts: the directed distance of each relation that is free, then for each
    held one what must not become negative: mode and one minus mode, or the force that keeps it at rest.
    """

    free: Problem
    holds: tuple[Hold, ...] = ()
    border: Border | None = None
    _constants: Vector | None = None

    @cached_property
    def active_set(self) -> ActiveSet:
        """The functions, which all runs share."""
        return active_set(self.free.compiled, self.holds, self.border)

    @cached_property
    def problem(self) -> Problem:
        """The problem to integrate."""
        if not self.holds and self.border is None:
            return self.free
        return Problem(self.active_set.compiled, self.free.p, self.free.u, self.free.wanted_native)

    def constants(self, library: Library[Any]) -> Vector:
        """What parameters and inputs alone determine, for compiled code; computed once."""
        if self._constants is None:
            (found,) = library.constants(self.free.p, self.free.u)
            object.__setattr__(self, "_constants", found)
            return found
        return self._constants

    @cached_property
    def compiled(self) -> CompiledModel:
        """The model of `problem`."""
        return self.active_set.compiled

    def relaxed(self, *given: Any, near: NDArray[np.intp]) -> Vector:
        """See `ActiveSet.relaxed`: of some guards."""
        if len(near) == 1:
            return self.active_set.buffered_relaxed(*given, near)[0]
        rows = -(-len(near) // TOGETHER)
        blocks = np.resize(near, (rows, TOGETHER))  # filled up with guards that are asked for anyway
        return np.concatenate([self.active_set.buffered_relaxed_together(*given, block)[0] for block in blocks])[
            : len(near)
        ]

    def modes(self, t: Vector, x: Vector, z: Vector, m: Vector) -> Vector:
        """Modes along n instants, shape (nm, n) or, when none slides, (nm,)."""
        sliding = [(k, h.relation) for k, h in enumerate(self.holds) if h.target is None]
        if not sliding or not len(t):
            return m
        n = len(t)
        wide = [np.tile(v[:, None], (1, n)) for v in (self.free.u, self.free.p, m)]
        found = np.array(self.active_set.multipliers.map(n)(t[None, :], x, z, *wide))
        rows: Vector = wide[2]
        for k, relation in sliding:
            for other in (relation, *self.free.compiled.events.twins[relation]):
                rows[self.active_set.first + other] = found[k]
        return rows

    def is_solvable(self, t: float, x: Vector, z: Vector, m: Vector) -> bool:
        """Whether each multiplier has an effect at this point, in proportion to its size."""
        count = len(self.holds)
        slope, other = (v.reshape(count, count) for v in self.active_set.effect(t, x, z, self.free.u, self.free.p, m))
        size = np.abs(slope).max(axis=1)
        if not np.isfinite(slope).all() or not (size > 0).all():
            return False
        affine = (np.abs(slope - other) <= 1e-9 * size[:, None]).all()
        return bool(affine and np.linalg.cond(slope / size[:, None]) < 1e12)
