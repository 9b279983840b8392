"""Integrators with fixed steps: CasADi's `rk` (order 4) and `collocation` (Radau), and Heun's second-order method."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.recent import Recent
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.problem import Problem
from acausal.simulate.equations.scaled import ScaledEquations
from acausal.simulate.interrupt import Interrupted
from acausal.simulate.solvers.base import CasadiSolver, quadratures_at, stateless, unmoved
from acausal.simulate.solvers.segment import Piece, Segment

# If a state is predicted to change by more than this in a step, relative to its size, an unchanged result is a failure.
_MOVED = 1e-9


def step_of(segment: Segment, solver: str) -> float:
    """Return the step; raises UsageError AC031 if none was given."""
    if segment.step is None:
        raise UsageError("AC031", f"solver '{solver}' has fixed steps and needs one", help="step=1e-3, or --step 1ms")
    return segment.step


def elements(segment: Segment, solver: str) -> int:
    """Return CasADi's number of finite elements over the segment for the given step.

    CasADi distributes the elements over the intervals between outputs and rounds up in each of them: if outputs are one
    step apart, a single element too many doubles the number of steps.
    """
    step, intervals = step_of(segment, solver), np.diff(segment.times, prepend=segment.start)
    span = float(segment.times[-1]) - segment.start
    count = max(1, math.floor(span / step + 1e-9))
    if count == 1:
        return max(1, math.ceil(span / step - 1e-9))
    longest = np.max(intervals / np.maximum(1.0, np.ceil(intervals * count / span - 1e-9)))
    return count if longest <= step * (1 + 1e-9) else math.ceil(span / step - 1e-9)


class Rk(CasadiSolver):
    """Classical Runge-Kutta method of order 4."""

    name = "rk"
    plugin = "rk"
    fixed_step = True
    explicit = True

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        return {"number_of_finite_elements": elements(segment, self.name)}


class Collocation(CasadiSolver):
    """Radau IIA of order 5: implicit and L-stable; optimal control uses the same transcription."""

    name = "collocation"
    plugin = "collocation"
    algebraic = True
    fixed_step = True
    accepts_nan = True

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        return {
            "number_of_finite_elements": elements(segment, self.name),
            "collocation_scheme": "radau",
            "interpolation_order": 3,
            "rootfinder": "newton",
            # a step on which Newton's method fails is an error
            "rootfinder_options": {"error_on_fail": True, "max_iter": 100, "show_eval_warnings": False},
        }

    def _solved(self, problem: Problem, segment: Segment) -> tuple[Vector, Vector, dict[str, Any]]:
        """Like the base class, but raises RuntimeError where a singular Jacobian left the states unchanged.

        Newton's step is then nan, and CasADi accepts it as converged.
        """
        x, z, stats = super()._solved(problem, segment)
        x0 = segment.x[: problem.n_dynamic] / problem.scale_x
        if np.array_equal(x[0], x0):
            numbers = problem.vector(segment.p, segment.x, segment.start)
            rates = problem.scaled.buffered(segment.start, x0, segment.z / problem.scale_z, numbers, [])[0]
            predicted = np.abs(rates) * (float(segment.times[0]) - segment.start)
            if (predicted > _MOVED * (1.0 + np.abs(x0))).any():
                raise RuntimeError("CONV_FAIL: the equations of a step are singular")
        return x, z, stats


class Rk2:
    """Heun's method (Rkfix2 in the paper); all steps run inside CasADi (`mapaccum`), not in a Python loop."""

    name = "rk2"
    algebraic = False
    fixed_step = True
    multistep = False
    explicit = True
    native = "nothing"

    def integrate(self, problem: Problem, segment: Segment) -> Piece:
        """Solve one segment with equal steps in each output interval, none longer than the given step."""
        if not problem.n_dynamic:
            return stateless(problem, segment)
        spans = np.diff(np.concatenate([[segment.start], segment.times]))
        try:
            return self._piece(problem, segment, *self._solved(problem, segment, spans, step_of(segment, self.name)))
        except Interrupted as stop:
            done = len(stop.rows[0]) if stop.rows else 0
            if done:
                stop.piece = self._piece(problem, replace(segment, times=segment.times[:done]), stop.rows[0].T, 0)
            raise

    def _piece(self, problem: Problem, segment: Segment, scaled_x: Vector, steps: int) -> Piece:
        values = scaled_x * problem.scale_x[:, None]
        if not np.isfinite(values).all():
            raise RuntimeError("the solution is not finite: the fixed step is too large for this model")
        values = np.vstack([values, quadratures_at(problem, segment), unmoved(problem, segment)])
        z = problem.solve_algebraic(segment, values)
        return Piece(values, z, {"steps": float(steps), "rhs_evaluations": 2.0 * steps})

    def _solved(self, problem: Problem, segment: Segment, spans: Vector, step: float) -> tuple[Vector, int]:
        """Return the scaled states at the output times and the number of steps, from compiled or interpreted code."""
        x = segment.x[: problem.n_dynamic] / problem.scale_x
        counts = np.maximum(1, np.ceil(spans / step - 1e-9)).astype(int)
        evaluations = 2.0 * float(counts.sum())
        program = None if problem.compiled.algebraic else problem.native.heun(heun, evaluations)
        if program is not None:
            p = program.vector(problem.p, problem.u, problem.numbers(segment.p, segment.x, segment.start))
            return program.run(x, p, spans, step)
        problem.native.interpreted("heun", evaluations)
        sizes = np.repeat(spans / counts, counts)
        steps = np.vstack([np.concatenate([[0.0], np.cumsum(sizes)[:-1]]), sizes])
        p = problem.vector(segment.p, segment.x, segment.start)
        if problem.compiled.algebraic:
            p = np.concatenate([p, segment.z / problem.scale_z])
        found, done = [], 0
        for count, intervals in _runs(counts):
            th = steps[:, done : done + count * intervals].ravel(order="F")
            run = _accumulated(problem.scaled, count, intervals)
            # equations with a rootfinder take p anew for each step, unrolled steps for each interval
            (rows,) = run(x, th, np.tile(p, run.function.numel_in(2) // len(p)))
            found.append(rows.reshape(len(x), intervals))
            x = found[-1][:, -1]
            done += count * intervals
        return np.hstack(found), len(sizes)


# The base by which CasADi nests accumulations; its default of 10 takes four times as long to build (10 000 steps).
_BASE = {"base": 4}
# Functions that are cached for each form of the equations: to build one takes two or three times as long as a call.
_MOST_CACHED = 64
_ACCUMULATED: WeakKeyDictionary[ScaledEquations, Recent[BufferedFunction]] = WeakKeyDictionary()


def _accumulated(equations: ScaledEquations, count: int, intervals: int) -> BufferedFunction:
    """`(x, [t, h] of all steps, p of each interval) -> x at the end of each interval` of `count` steps."""
    cached = _ACCUMULATED.setdefault(equations, Recent(_MOST_CACHED))
    found = cached.get((count, intervals))
    if found is None:
        inner = _several(heun(equations.ode), count)
        run = inner.mapaccum("run", intervals, 1, _BASE) if intervals > 1 else inner
        found = cached.put((count, intervals), BufferedFunction(run))
    return found


def _several(one_step: Any, count: int) -> Any:
    """Combine `count` steps into one function, unrolled if small: that is built and called ten times faster."""
    if count == 1:
        return one_step
    if not one_step.is_a("SXFunction") or one_step.n_instructions() * count > 20_000:
        return one_step.fold(count)
    x, steps, p = ca.SX.sym("x", one_step.numel_in(0)), ca.SX.sym("th", 2, count), ca.SX.sym("p", one_step.numel_in(2))
    end = x
    for k in range(count):
        end = one_step(end, steps[:, k], p)
    return ca.Function("steps", [x, steps, p], [end])


def _runs(counts: NDArray[np.int_]) -> list[tuple[int, int]]:
    """(steps per interval, number of intervals) for runs of intervals with equally many steps.

    These numbers are powers of two, so that few functions serve all stretches between events.
    """
    ends = np.flatnonzero(np.diff(counts)) + 1
    parts = [(int(part[0]), len(part)) for part in np.split(counts, ends)]
    return [(count, 1 << k) for count, n in parts for k in reversed(range(n.bit_length())) if n >> k & 1]


def heun(ode: Any) -> Any:
    """Build one step of Heun's method, `(x, [t, h], p) -> x`, with scaled states."""
    kind: Any = ca.SX if ode.is_a("SXFunction") else ca.MX
    x, th, p = kind.sym("x", ode.numel_in("x")), kind.sym("th", 2), kind.sym("p", ode.numel_in("p"))
    t, h = th[0], th[1]
    none = kind(0, 1)
    k1 = ode(t, x, none, p, none)[0]
    k2 = ode(t + h, x + h * k1, none, p, none)[0]
    return ca.Function("heun", [x, th, p], [x + h / 2 * (k1 + k2)])
