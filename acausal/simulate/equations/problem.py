"""The DAE as the integrators get it: scaled variables, time counted from the segment's start, one parameter vector.

Algebraic variables as functions of time alone: followed along their branch, step by step.

Where two branches meet, a parallelogram that folds flat, Newton's method started from the last position takes either;
started from where the motion leads, it stays on the one it is on. Steps are as short as the extrapolation needs, not as
the outputs ask. Source: E. L. Allgower, K. Georg, Numerical Continuation Methods (1990), chapter 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.scaled import ScaledEquations, scaled_equations
from acausal.simulate.native.policy import Native


class Stretch(Protocol):
    """What of a `Segment` says where its algebraic variables are: its start, and its times, shape (n,)."""

    @property
    def start(self) -> float: ...
    @property
    def times(self) -> Vector: ...
    @property
    def x(self) -> Vector: ...
    @property
    def z(self) -> Vector: ...
    @property
    def p(self) -> Vector: ...


@dataclass(frozen=True, eq=False)
class Problem:
    """A compiled model seen by an integrator, for one run.

    States and algebraic variables are divided by their nominal magnitudes, so that one absolute tolerance fits all.
    The model's parameters `p` and inputs `u` come to the equations as what they alone determine (`scaled.py`).

    `wanted_native` is the run's option `native`: whether to use the equations as compiled C.
    """

    compiled: CompiledModel
    p: Vector
    u: Vector
    wanted_native: bool | None = None

    @cached_property
    def n_dynamic(self) -> int:
        """Number of states of the coupled system; the others are integrated apart."""
        return self.compiled.n_dynamic

    def numbers(self, m: Vector, x: Vector, start: float) -> Vector:
        """What varies from segment to segment: modes, discrete variables out of all states, start of the segment."""
        return np.concatenate([m, x[len(x) - self.compiled.discretes :], [start]])

    def vector(self, m: Vector, x: Vector, start: float) -> Vector:
        """The parameter vector of the equations: what p and u alone determine, then `numbers`."""
        return np.concatenate([self._constants, self.numbers(m, x, start)])

    @cached_property
    def _constants(self) -> Vector:
        return self.scaled.constants(self.p, self.u)

    @cached_property
    def scale_x(self) -> Vector:
        """Nominal magnitudes of the dynamic states."""
        return self.compiled.nominal_x[: self.n_dynamic]

    @cached_property
    def scale_z(self) -> Vector:
        """Nominal magnitudes of the algebraic variables."""
        return self.compiled.nominal_z

    @cached_property
    def native(self) -> Native:
        """The model's compiled C, as far as there is any."""
        return Native(self.compiled, self.wanted_native, self.p)

    @cached_property
    def scaled(self) -> ScaledEquations:
        """The equations as integrators get them, with `p` and `u` as they are when this is first asked for."""
        return scaled_equations(self.compiled, self.p, self.u)

    def solve_algebraic(self, segment: Stretch, x: Vector) -> Vector:
        """Algebraic variables at the times of a segment whose states are `x`; shape (nz, n).

        They are followed from the start of the segment, and must be the ones with which the rates were computed.

        Raises
        ------
        RuntimeError
            Where they end: an integrator that has eliminated them goes on with those of another branch.
        """
        nz = len(self.compiled.algebraic)
        found = np.empty((nz, len(segment.times)))
        if nz == 0:
            return found
        first = here = segment.z / self.scale_z
        before = segment.start, segment.x[: self.n_dynamic] / self.scale_x
        for k, time in enumerate(segment.times.tolist()):
            states, numbers = x[: self.n_dynamic, k] / self.scale_x, self.vector(segment.p, x[:, k], 0.0)
            # the rates had their root from the start of the segment
            used = self._root(first, time, states, numbers)
            if not self._holds(time, states, used, numbers):
                raise RuntimeError("CONV_FAIL: the algebraic equations have no solution there")
            if not _are_close(used, here):
                here = self._followed(before, (time, states), here, used, numbers)
                if not _are_close(used, here):
                    raise RuntimeError(LEFT)
            here, before = used, (time, states)
            found[:, k] = here * self.scale_z
        return found

    def keeps_branch(self, segment: Stretch, x: Vector, z: Vector) -> int:
        """How many of an implicit method's steps, `x` and `z` at the times of a segment, stay on their branch.

        Newton's method within a step past a fold may end on what else solves the equations. Where the states of a
        step and its rates do not lead there along a cubic, as after a stiff transient, a straight line may.
        """
        here, before = segment.z / self.scale_z, (segment.start, segment.x[: self.n_dynamic] / self.scale_x)
        for k, time in enumerate(segment.times.tolist()):
            at, used = (time, x[: self.n_dynamic, k] / self.scale_x), z[:, k] / self.scale_z
            if not _are_close(used, here):
                numbers = self.vector(segment.p, x[:, k], 0.0)
                if not any(self._leads(before, at, here, used, numbers, straight) for straight in (False, True)):
                    return k
            here, before = used, at
        return len(segment.times)

    def _leads(
        self,
        a: tuple[float, Vector],
        b: tuple[float, Vector],
        z: Vector,
        end: Vector,
        numbers: Vector,
        straight: bool,
    ) -> bool:
        with suppress(RuntimeError):
            return _are_close(end, self._followed(a, b, z, end, numbers, straight))
        return False

    def _root(self, guess: Vector, t: float, states: Vector, numbers: Vector) -> Vector:
        return self.scaled.algebraic_root(guess, np.concatenate([[t], states, numbers]))[0]

    def _holds(self, t: float, states: Vector, z: Vector, numbers: Vector) -> bool:
        return bool(self.scaled.buffered_is_root(t, states, z, numbers)[0][0])

    def _followed(
        self,
        a: tuple[float, Vector],
        b: tuple[float, Vector],
        z: Vector,
        end: Vector,
        numbers: Vector,
        straight: bool = False,
    ) -> Vector:
        """Algebraic variables at `b = (t, states)` along the cubic that leaves `a` and arrives there with its rates."""
        (ta, xa), (tb, xb) = a, b
        h = tb - ta
        fa = fb = (xb - xa) / h
        if not straight:
            fa, fb = (self.scaled.buffered(t, s, w, numbers, [])[0] for (t, s), w in ((a, z), (b, end)))

        def at(t: float) -> Vector:
            s = (t - ta) / h
            bend = s * (s - 1) * ((1 - 2 * s) * (xb - xa) + h * ((s - 1) * fa + s * fb))
            return np.asarray(xa + s * (xb - xa) + bend)

        def solve(t: float, guess: Vector) -> Vector:
            return self._root(guess, t, at(t), numbers)

        def holds(t: float, value: Vector) -> bool:
            return self._holds(t, at(t), value, numbers)

        return followed(solve, holds, ta, np.array([tb]), z)[:, 0]

    def follow_algebraic(self, start: float, times: Vector, x: Vector, z: Vector, p: Vector) -> Vector:
        """The same where nothing is integrated: from the values `z` at `start` along their branch; shape (nz, n)."""
        numbers = self.vector(p, x, 0.0)

        def solve(t: float, guess: Vector) -> Vector:
            return self._root(guess, t, np.zeros(0), numbers)

        def holds(t: float, value: Vector) -> bool:
            return self._holds(t, np.zeros(0), value, numbers)

        return followed(solve, holds, start, times, z / self.scale_z) * self.scale_z[:, None]


LEFT = "CONV_FAIL: the algebraic variables leave their branch"


def _are_close(a: Vector, b: Vector) -> bool:
    return bool((np.abs(a - b) <= CLOSE * (1.0 + np.abs(b))).all())  # false for nan


# Largest distance between prediction and solution, in nominal magnitudes; below a tenth of it steps grow.
CLOSE = 0.02
_SMALLEST = 1e-9
# Steps of the smallest size that are taken without Newton's method: branches cross at points, not along stretches.
_CROSSED = 100


def followed(
    solve: Callable[[float, Vector], Vector],
    holds: Callable[[float, Vector], bool],
    start: float,
    times: Vector,
    z: Vector,
) -> Vector:
    """The solution at `times`, shape (nz, n), from its value `z` at `start`.

    `solve(t, guess)` gives a solution, `holds(t, z)` says whether z is one.

    Raises RuntimeError where the branch ends.
    """
    found = np.empty((len(z), len(times)))
    past: list[tuple[float, Vector]] = [(start, z)]
    # a step is of several units in the last place, so that every one gets on
    smallest = max(_SMALLEST * (float(times[-1]) - start), 4 * math.ulp(float(times[-1])), 4 * math.ulp(start))
    step = (float(times[0]) - start) / 4
    here, crossed = start, 0
    for k, wanted in enumerate(times):
        while here < wanted:
            to = min(here + max(step, smallest), float(wanted))
            if wanted - to < max(1e-3 * step, smallest):
                to = float(wanted)
            guess = _extrapolated(past, to)
            value = solve(to, guess)
            off = float(np.max(np.abs(value - guess) / (1.0 + np.abs(guess)), initial=0.0))
            if not (off <= CLOSE and holds(to, value)):  # nan is not good either
                if to - here > 2 * smallest:
                    step = (to - here) / 4
                    continue
                crossed += 1
                if not holds(to, guess) or crossed > _CROSSED:
                    raise RuntimeError(f"CONV_FAIL: the algebraic variables end at t = {here:g}")
                value = guess  # where branches cross, Newton's method knows nothing of where it came from
            if to - past[-1][0] >= 0.1 * step or len(past) < 3:
                past = [*past[-2:], (to, value)]
            here, z = to, value
            if off <= 0.1 * CLOSE:
                step *= 1.6
        found[:, k] = z
    return found


def _extrapolated(past: list[tuple[float, Vector]], t: float) -> Vector:
    """The polynomial through up to three points, at `t` (Lagrange)."""
    total = np.zeros_like(past[0][1])
    for i, (ti, zi) in enumerate(past):
        weight = 1.0
        for j, (tj, _) in enumerate(past):
            if i != j:
                weight *= (t - tj) / (ti - tj)
        total = total + weight * zi
    return total
