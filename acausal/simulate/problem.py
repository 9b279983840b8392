"""The DAE as the integrators get it: scaled variables, time counted from the segment's start, one parameter vector."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel
from acausal.simulate.marching import followed
from acausal.simulate.native.policy import Native
from acausal.simulate.numbered import Numbered, numbered

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Problem:
    """A compiled model seen by an integrator, for one run.

    States and algebraic variables are divided by their nominal magnitudes, so that one absolute tolerance fits all.
    The model's parameters `p` and inputs `u` are numbers in its equations (`numbered.py`).

    `wanted_native` is the run's option `native`: whether to use the equations as compiled C.
    """

    compiled: CompiledModel
    p: Vector
    u: Vector
    wanted_native: bool | None = None

    @property
    def n_dynamic(self) -> int:
        """Number of states of the coupled system; the others are integrated apart."""
        return self.compiled.n_dynamic

    def numbers(self, m: Vector, x: Vector, start: float) -> Vector:
        """The integrator's parameter vector: modes, discrete variables out of all states, start of the segment."""
        return np.concatenate([m, x[len(x) - self.compiled.discretes :], [start]])

    @cached_property
    def scale_x(self) -> Vector:
        """Nominal magnitudes of the dynamic states."""
        return self.compiled.nominal_x[: self.n_dynamic]

    @property
    def scale_z(self) -> Vector:
        """Nominal magnitudes of the algebraic variables."""
        return self.compiled.nominal_z

    @cached_property
    def native(self) -> Native:
        """The model's compiled C, as far as there is any."""
        return Native(self.compiled, self.wanted_native, self.p)

    @cached_property
    def numbered(self) -> Numbered:
        """The equations as integrators get them, with `p` and `u` as they are when this is first asked for."""
        return numbered(self.compiled, self.p, self.u)

    def solve_algebraic(self, times: Vector, x: Vector, z: Vector, p: Vector) -> Vector:
        """Algebraic variables along a trajectory, each point started from the one before; shape (nz, n)."""
        nz = len(self.compiled.algebraic)
        if nz == 0:
            return np.zeros((0, len(times)))
        found = np.empty((nz, len(times)))
        here = z / self.scale_z
        for k, time in enumerate(times):
            states = x[: self.n_dynamic, k] / self.scale_x
            numbers = self.numbers(p, x[:, k], 0.0)
            here = self.numbered.algebraic_root(here, np.concatenate([[time], states, numbers]))[0]
            found[:, k] = here * self.scale_z
        return found

    def follow_algebraic(self, start: float, times: Vector, x: Vector, z: Vector, p: Vector) -> Vector:
        """The same where nothing is integrated: from the values `z` at `start` along their branch; shape (nz, n)."""
        numbers = self.numbers(p, x, 0.0)

        def solve(t: float, guess: Vector) -> tuple[Vector, float]:
            found = self.numbered.algebraic_root(guess, np.concatenate([[t], numbers]))[0]
            return found, float(np.max(np.abs(self.numbered.quick(t, [], found, numbers, [])[1])))

        return followed(solve, start, times, z / self.scale_z) * self.scale_z[:, None]
