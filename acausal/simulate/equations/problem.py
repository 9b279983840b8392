"""The DAE in the form for integrators: scaled variables, time from the segment's start, one parameter vector.

Where algebraic variables are functions of time or of given states, they are followed along their branch step by step.
Where two branches meet, as for a parallelogram that folds flat, Newton's method may converge to either if it is started
from the last position. Started from an extrapolation of the motion, it stays on the same branch. The step size is
chosen for that extrapolation, independently of the output times. Source: E. L. Allgower, K. Georg, Numerical
Continuation Methods (1990), chapter 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Protocol

import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.scaled import ScaledEquations, scaled_equations
from acausal.simulate.native.policy import Native


class Stretch(Protocol):
    """The part of a `Segment` that determines its algebraic variables: its start values, and its times, shape (n,)."""

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
    """A compiled model in one run, in the form for integrators.

    States and algebraic variables are divided by their nominal magnitudes, so that one absolute tolerance fits all.
    Parameters `p` and inputs `u` enter the equations through the values that they alone determine (`scaled.py`).

    `wanted_native` is the run's option `native`: whether to use the equations as compiled C.
    """

    compiled: CompiledModel
    p: Vector
    u: Vector
    wanted_native: bool | None = None

    @cached_property
    def n_dynamic(self) -> int:
        """Number of states of the coupled system; the others are integrated separately."""
        return self.compiled.n_dynamic

    def numbers(self, m: Vector, x: Vector, start: float) -> Vector:
        """Values that vary from segment to segment: modes, the discrete variables among all states, and the start."""
        return np.concatenate([m, x[len(x) - self.compiled.discretes :], [start]])

    def vector(self, m: Vector, x: Vector, start: float) -> Vector:
        """The parameter vector of the equations: values that p and u alone determine, then `numbers`."""
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
        """The compiled C code of the model, as far as it exists."""
        return Native(self.compiled, self.wanted_native, self.p)

    @cached_property
    def scaled(self) -> ScaledEquations:
        """The scaled equations, with the values that `p` and `u` have at the first access."""
        return scaled_equations(self.compiled, self.p, self.u)

    def solve_algebraic(self, segment: Stretch, x: Vector) -> Vector:
        """Algebraic variables at the first n times of a segment whose states are `x`, shape (nx, n); shape (nz, n).

        They are followed from the start of the segment, and must agree with those that the rates were computed with.

        Raises
        ------
        RuntimeError
            If they do not, because their branch ends: an integrator that eliminates them goes on with another branch.
        """
        nz = len(self.compiled.algebraic)
        followed_z = np.empty((nz, x.shape[1]))  # fewer than times if the solver has stopped
        if nz == 0:
            return followed_z
        first = here = segment.z / self.scale_z
        before = segment.start, segment.x[: self.n_dynamic] / self.scale_x
        for k, time in enumerate(segment.times[: x.shape[1]].tolist()):
            states, numbers = x[: self.n_dynamic, k] / self.scale_x, self.vector(segment.p, x[:, k], 0.0)
            # the rootfinder in the rates also starts from the values at the start of the segment
            used = self._root(first, time, states, numbers)
            if not self._holds(time, states, used, numbers):
                raise RuntimeError("CONV_FAIL: the algebraic equations have no solution there")
            if not _are_close(used, here):
                here = self._followed(before, (time, states), here, used, numbers)
                if not _are_close(used, here):
                    raise RuntimeError(LEFT)
            here, before = used, (time, states)
            followed_z[:, k] = here * self.scale_z
        return followed_z

    def keeps_branch(self, segment: Stretch, x: Vector, z: Vector) -> int:
        """How many steps of an implicit method, with `x` and `z` at the times of a segment, stay on their branch.

        Newton's method in a step past a fold may converge to another solution. `z` is on the branch if continuation
        leads to it along the cubic through the states with their rates, or, as the cubic may fail after a stiff
        transient, along the straight line between the states.
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
        """Algebraic variables at `b = (t, states)`, followed along the cubic through `a` and `b` with their rates."""
        (ta, xa), (tb, xb) = a, b
        times, states = np.array([ta, tb]), np.array([xa, xb])
        rates = np.tile((xb - xa) / (tb - ta), (2, 1))
        if not straight:
            rates = np.array([self._rates(*at, w, numbers) for at, w in ((a, z), (b, end))])
        return self._along(partial(_cubic, times, states, rates), ta, times[1:], z, numbers)[:, 0]

    def straight_on(self, rows: tuple[Vector, ...], instants: Vector) -> tuple[Vector, Vector]:
        """States and algebraic variables at the instants `instants` after the first of a few rows of one mode.

        The states are interpolated between the `rows` (times, states, algebraic variables, modes; columns are instants)
        by cubics; the algebraic variables are followed along their branch from the first row.

        Raises RuntimeError where their branch ends.
        """
        times, x, z, m = rows
        numbers, states = self.vector(m[:, 0], x[:, 0], 0.0), x[: self.n_dynamic].T / self.scale_x
        here = z.T / self.scale_z
        rates = np.array([self._rates(*row, numbers) for row in zip(times.tolist(), states, here, strict=True)])
        path = partial(_cubic, times, states, rates)
        followed_z = self._along(path, float(times[0]), instants, here[0], numbers)
        states_there = np.tile(x[:, :1], (1, len(instants)))
        states_there[: self.n_dynamic] = np.array([path(t) for t in instants.tolist()]).T * self.scale_x[:, None]
        return states_there, followed_z * self.scale_z[:, None]

    def extrapolated(self, rows: tuple[Vector, ...]) -> Vector:
        """Solutions of the algebraic equations at the rows from the third on, shape (nz, n), for rows of one mode.

        Newton's method starts on the line through the two previous rows, as in an implicit method; nan where it does
        not converge to a solution.
        """
        times, x, z, m = rows
        numbers, roots = self.vector(m[:, 0], x[:, 0], 0.0), np.full((len(z), len(times) - 2), np.nan)
        for k in range(2, len(times)):
            t, states = float(times[k]), x[: self.n_dynamic, k] / self.scale_x
            slope = (z[:, k - 1] - z[:, k - 2]) / (times[k - 1] - times[k - 2])
            root = self._root((z[:, k - 1] + (t - times[k - 1]) * slope) / self.scale_z, t, states, numbers)
            if self._holds(t, states, root, numbers):
                roots[:, k - 2] = root * self.scale_z
        return roots

    def _rates(self, t: float, states: Vector, z: Vector, numbers: Vector) -> Vector:
        return np.asarray(self.scaled.buffered(t, states, z, numbers, [])[0])

    def _along(
        self, states: Callable[[float], Vector], start: float, times: Vector, z: Vector, numbers: Vector
    ) -> Vector:
        """Algebraic variables, shape (nz, n), along states that are a function of time; all scaled."""
        at = lru_cache(1)(states)  # a solution is looked for and checked at one instant after the other

        def solve(t: float, guess: Vector) -> Vector:
            return self._root(guess, t, at(t), numbers)

        def holds(t: float, value: Vector) -> bool:
            return self._holds(t, at(t), value, numbers)

        return followed(solve, holds, start, times, z)

    def follow_algebraic(self, start: float, times: Vector, x: Vector, z: Vector, p: Vector) -> Vector:
        """Algebraic variables of a problem without states, from `z` at `start` along their branch; shape (nz, n)."""
        numbers = self.vector(p, x, 0.0)
        followed_z = self._along(lambda _: np.zeros(0), start, times, z / self.scale_z, numbers)
        return followed_z * self.scale_z[:, None]


LEFT = "CONV_FAIL: the algebraic variables leave their branch"


def _cubic(times: Vector, states: Vector, rates: Vector, t: float) -> Vector:
    """States at `t` by cubic Hermite interpolation of states with their rates, both of shape (n, nx)."""
    k = min(max(int(np.searchsorted(times, t)) - 1, 0), len(times) - 2)
    h, change = times[k + 1] - times[k], states[k + 1] - states[k]
    s = (t - times[k]) / h
    with np.errstate(invalid="ignore"):  # rates near a singular point may be infinite; the result is then nan
        bend = s * (s - 1) * ((1 - 2 * s) * change + h * ((s - 1) * rates[k] + s * rates[k + 1]))
    return np.asarray(states[k] + s * change + bend)


def _are_close(a: Vector, b: Vector) -> bool:
    return bool((np.abs(a - b) <= CLOSE * (1.0 + np.abs(b))).all())  # false for nan


# Largest distance between prediction and solution, in nominal magnitudes; below a tenth of it steps grow.
CLOSE = 0.02
_SMALLEST_STEP = 1e-9
# At most this many steps of the smallest size are taken by extrapolation alone: branches cross at points.
_MOST_CROSSING_STEPS = 100


def followed(
    solve: Callable[[float, Vector], Vector],
    holds: Callable[[float, Vector], bool],
    start: float,
    times: Vector,
    z: Vector,
) -> Vector:
    """Follow a solution from its value `z` at `start` to `times`; shape (nz, n).

    `solve(t, guess)` returns a solution near the guess, `holds(t, z)` says whether z is a solution.

    Raises RuntimeError where the branch ends.
    """
    solution = np.empty((len(z), len(times)))
    past: list[tuple[float, Vector]] = [(start, z)]
    # a step has several units in the last place, so that each advances the time
    smallest = max(_SMALLEST_STEP * (float(times[-1]) - start), 4 * math.ulp(float(times[-1])), 4 * math.ulp(start))
    step = (float(times[0]) - start) / 4
    here, crossing_steps = start, 0
    for k, output in enumerate(times):
        while here < output:
            t = min(here + max(step, smallest), float(output))
            if output - t < max(1e-3 * step, smallest):
                t = float(output)
            guess = _extrapolated(past, t)
            value = solve(t, guess)
            change = float(np.max(np.abs(value - guess) / (1.0 + np.abs(guess)), initial=0.0))
            if not (change <= CLOSE and holds(t, value)):  # nan compares false
                if t - here > 2 * smallest:
                    step = (t - here) / 4
                    continue
                crossing_steps += 1
                if not holds(t, guess) or crossing_steps > _MOST_CROSSING_STEPS:
                    raise RuntimeError(f"CONV_FAIL: the algebraic variables end at t = {here:g}")
                value = guess  # where branches cross, Newton's method may switch to the other one
            if t - past[-1][0] >= 0.1 * step or len(past) < 3:
                past = [*past[-2:], (t, value)]
            # a step cut short by an output does not grow, or the extrapolated points would be too far in the past
            if change <= 0.1 * CLOSE and t - here >= 0.9 * step:
                step *= 1.6
            here, z = t, value
        solution[:, k] = z
    return solution


def _extrapolated(past: list[tuple[float, Vector]], t: float) -> Vector:
    """The value at `t` of the Lagrange polynomial through up to three points."""
    total = np.zeros_like(past[0][1])
    for i, (ti, zi) in enumerate(past):
        weight = 1.0
        for j, (tj, _) in enumerate(past):
            if i != j:
                weight *= (t - tj) / (ti - tj)
        total = total + weight * zi
    return total
