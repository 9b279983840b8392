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
from functools import cached_property, partial
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
        times, states = np.array([ta, tb]), np.array([xa, xb])
        rates = np.tile((xb - xa) / (tb - ta), (2, 1))
        if not straight:
            rates = np.array([self._rates(*at, w, numbers) for at, w in ((a, z), (b, end))])
        return self._along(partial(_cubic, times, states, rates), ta, times[1:], z, numbers)[:, 0]

    def straight_on(self, rows: tuple[Vector, ...], wanted: Vector) -> tuple[Vector, Vector]:
        """States and algebraic variables at some instants behind the first of a few rows of one mode.

        The states are those of the `rows` (times, states, algebraic variables, modes; columns are instants), with
        cubics between them; the algebraic variables go on from the first row as they began.

        Raises RuntimeError where their branch ends.
        """
        times, x, z, m = rows
        numbers, states = self.vector(m[:, 0], x[:, 0], 0.0), x[: self.n_dynamic].T / self.scale_x
        here = z.T / self.scale_z
        rates = np.array([self._rates(*at, numbers) for at in zip(times.tolist(), states, here, strict=True)])
        path = partial(_cubic, times, states, rates)
        found = self._along(path, float(times[0]), wanted, here[0], numbers)
        at = np.tile(x[:, :1], (1, len(wanted)))
        at[: self.n_dynamic] = np.array([path(t) for t in wanted.tolist()]).T * self.scale_x[:, None]
        return at, found * self.scale_z[:, None]

    def extrapolated(self, rows: tuple[Vector, ...]) -> Vector:
        """What solves the algebraic equations at the third of some rows of one mode and those behind it, shape (nz, n).

        Newton's method begins on the line through the two rows before, as an implicit method may; nan where it does not
        end on a solution.
        """
        times, x, z, m = rows
        numbers, found = self.vector(m[:, 0], x[:, 0], 0.0), np.full((len(z), len(times) - 2), np.nan)
        for k in range(2, len(times)):
            t, states = float(times[k]), x[: self.n_dynamic, k] / self.scale_x
            slope = (z[:, k - 1] - z[:, k - 2]) / (times[k - 1] - times[k - 2])
            root = self._root((z[:, k - 1] + (t - times[k - 1]) * slope) / self.scale_z, t, states, numbers)
            if self._holds(t, states, root, numbers):
                found[:, k - 2] = root * self.scale_z
        return found

    def _rates(self, t: float, states: Vector, z: Vector, numbers: Vector) -> Vector:
        return np.asarray(self.scaled.buffered(t, states, z, numbers, [])[0])

    def _along(
        self, states: Callable[[float], Vector], start: float, times: Vector, z: Vector, numbers: Vector
    ) -> Vector:
        """Algebraic variables, shape (nz, n), along states that are a function of time; all scaled."""

        def solve(t: float, guess: Vector) -> Vector:
            return self._root(guess, t, states(t), numbers)

        def holds(t: float, value: Vector) -> bool:
            return self._holds(t, states(t), value, numbers)

        return followed(solve, holds, start, times, z)

    def follow_algebraic(self, start: float, times: Vector, x: Vector, z: Vector, p: Vector) -> Vector:
        """The same where nothing is integrated: from the values `z` at `start` along their branch; shape (nz, n)."""
        numbers = self.vector(p, x, 0.0)
        found = self._along(lambda _: np.zeros(0), start, times, z / self.scale_z, numbers)
        return found * self.scale_z[:, None]


LEFT = "CONV_FAIL: the algebraic variables leave their branch"


def _cubic(times: Vector, states: Vector, rates: Vector, t: float) -> Vector:
    """States at `t` on the cubics through those at some times with their rates, shapes (n, nx) (Hermite)."""
    k = min(max(int(np.searchsorted(times, t)) - 1, 0), len(times) - 2)
    h, change = times[k + 1] - times[k], states[k + 1] - states[k]
    s = (t - times[k]) / h
    with np.errstate(invalid="ignore"):  # rates beside a singular point may be infinite; no solution is nan
        bend = s * (s - 1) * ((1 - 2 * s) * change + h * ((s - 1) * rates[k] + s * rates[k + 1]))
    return np.asarray(states[k] + s * change + bend)


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
            # not beyond the distance of the outputs, or the points that are extrapolated would be old ones
            if off <= 0.1 * CLOSE and to - here >= 0.9 * step:
                step *= 1.6
            here, z = to, value
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
