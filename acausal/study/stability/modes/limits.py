"""Largest stable step of each fixed-step method on a run, verified by stepping the model."""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers import solver_named
from acausal.simulate.solvers.segment import Segment, Tolerances
from acausal.simulate.step_limit.amplification import METHODS, Method
from acausal.simulate.step_limit.limit import eigenvectors
from acausal.simulate.step_limit.state_matrix import LARGEST_DENSE, StateMatrix
from acausal.study.stability.modes.modes import Local, Mode, mode
from acausal.study.stability.trajectory import Point, Trajectory

BELOW, ABOVE = 0.9, 1.1
"""Fractions of the largest stable step at which it is verified."""
_SIZE = 1e-6
_MOST_STEPS = 400


@dataclass(frozen=True)
class Check:
    """Two runs of `steps` steps of size `step` [s] from the worst point, one of them disturbed in the worst mode.

    `measured` and `predicted` are the factors by which one step multiplies the disturbance (geometric mean).
    """

    step: float
    steps: int
    measured: float
    predicted: float

    @property
    def grows(self) -> bool:
        """Whether the disturbance grew."""
        return self.measured > 1.0 + 1e-9

    def content(self) -> dict[str, object]:
        """For JSON."""
        return dict(vars(self))


@dataclass(frozen=True)
class Limit:
    """Stability limits of one method on a run."""

    method: Method
    # Largest step [s] with |R| <= 1 for every mode at every point; inf: any step; 0: none, for an undamped mode.
    largest_step: float
    usable_step: float  # largest step [s] at which no mode grows more than twofold beyond its own growth
    # `mode`, `usable_by`: the modes that limit the two; None without limit.
    mode: Mode | None
    usable_by: Mode | None
    rings: float  # |R| for modes much faster than the step: 0 damps them at once, 1 not at all
    # `below`, `above`: runs at 0.9 and 1.1 of the largest step; None where there is no such step.
    below: Check | None = None
    above: Check | None = None

    @property
    def confirmed(self) -> bool | None:
        """Whether the runs decayed below and grew above the limit; None without runs."""
        if self.below is None or self.above is None:
            return None
        return not self.below.grows and self.above.grows

    def content(self) -> dict[str, object]:
        """For JSON."""
        return {
            "method": self.method.name,
            "title": self.method.title,
            "solver": self.method.solver,
            "order": self.method.order,
            "explicit": self.method.explicit,
            "largest_step": self.largest_step,
            "usable_step": self.usable_step,
            "amplification_at_infinity": None if self.method.explicit else self.rings,
            "stiffly_accurate": self.method.stiffly_accurate,
            "limited_by": None if self.mode is None else self.mode.content(),
            "below": None if self.below is None else self.below.content(),
            "above": None if self.above is None else self.above.content(),
            "confirmed": self.confirmed,
        }


def limits(run: Trajectory, locals: Sequence[Local], check: bool = True) -> tuple[Limit, ...]:
    """Stability limits of all methods; with `check` those of explicit ones are verified by runs."""
    problem = Problem(run.compiled, run.p, run.u, False)
    found = []
    for method in METHODS:
        limit = _limit(run, locals, method)
        if check and limit.mode is not None and 0.0 < limit.largest_step < math.inf:
            point = next(local.point for local in locals if local.point.t == limit.mode.t)
            tried = [
                _verify(run, problem, method, point, limit.mode.eigenvalue, fraction * limit.largest_step)
                for fraction in (BELOW, ABOVE)
            ]
            limit = replace(limit, below=tried[0], above=tried[1])
        found.append(limit)
    return tuple(found)


def _limit(run: Trajectory, locals: Sequence[Local], method: Method) -> Limit:
    worst, limiting, where = math.inf, 0j, None
    usable, by, at = math.inf, 0j, None
    if method.explicit:
        for local in locals:
            step, eigenvalue = method.largest_step(local.eigenvalues)
            if step < worst:
                worst, limiting, where = step, eigenvalue, local
            step, eigenvalue = method.usable_step(local.eigenvalues[:20], run.span)
            if step < usable:
                usable, by, at = step, eigenvalue, local
    found = None if where is None else mode(run, where, limiting)
    return Limit(method, worst, usable, found, None if at is None else mode(run, at, by), method.at_infinity)


def _verify(
    run: Trajectory, problem: Problem, method: Method, point: Point, eigenvalue: complex, step: float
) -> Check | None:
    """Verify a step by two runs from a point, one of them disturbed in a mode; None if this is impossible."""
    matrix = StateMatrix(point.compiled, run.p, run.u)
    if matrix.size > LARGEST_DENSE or point.compiled is not run.compiled:
        return None  # `problem` has the equations of the model, which are not those of a sliding mode
    found = matrix.at(point.t, point.x, point.z, point.m)
    if found is None:
        return None
    right, left = eigenvectors(found, eigenvalue)
    predicted = float(np.abs(method.amplification(step * eigenvalue)))
    # enough steps for a factor of a hundred either way, within limits
    steps = int(np.clip(math.log(100.0) / max(abs(math.log(max(predicted, 1e-12))), 1e-12), 4, _MOST_STEPS))
    tried: list[Check] = []
    while steps >= 1:
        measured = _measured_growth(problem, method, point, (right, left), step, steps)
        if measured is not None:
            tried.append(Check(step, steps, measured, predicted))
            if abs(measured / predicted - 1.0) < 0.02:
                break
        # the mode changes along the run: fewer steps show its effect at this point
        steps //= 4
    return min(tried, key=lambda c: abs(math.log(c.measured / c.predicted)), default=None)


def _measured_growth(
    problem: Problem,
    method: Method,
    point: Point,
    vectors: tuple[NDArray[np.complex128], NDArray[np.complex128]],
    step: float,
    steps: int,
) -> float | None:
    """Growth factor per step of the disturbance in a mode with these right and left eigenvectors; None on failure."""
    right, left = vectors
    n = problem.n_dynamic
    scale = np.abs(point.x[:n]) + problem.scale_x
    direction = (right / np.max(np.abs(right) / scale)).real
    ends = []
    for size in (0.0, _SIZE):
        x = point.x.copy()
        x[:n] += size * direction
        end = _end(problem, method, replace(point, x=x), step, steps)
        if end is None:
            return None
        ends.append(end[:n])
    with np.errstate(all="ignore"):
        before, after = left.conj() @ (_SIZE * direction), left.conj() @ (ends[1] - ends[0])
    if before == 0.0 or not np.isfinite(after) or after == 0.0:
        return None
    return float(abs(complex(after / before)) ** (1.0 / steps))


def _end(problem: Problem, method: Method, point: Point, step: float, steps: int) -> Vector | None:
    """States, shape (nx,), after `steps` steps, by the solver of acausal if it has the method."""
    if method.solver is None:
        return _euler(problem, point, step, steps)
    segment = Segment(
        start=point.t,
        times=np.array([point.t + step * steps]),
        x=point.x,
        z=point.z,
        p=point.m,
        tolerances=Tolerances(1e-6),
        step=step,
    )
    with contextlib.redirect_stderr(io.StringIO()):
        try:
            return np.asarray(solver_named(method.solver).integrate(problem, segment).x[:, -1])
        except RuntimeError:
            return None


def _euler(problem: Problem, point: Point, step: float, steps: int) -> Vector:
    n = problem.n_dynamic
    x = point.x[:n] / problem.scale_x
    p = problem.vector(point.m, point.x, 0.0)
    if problem.compiled.algebraic:
        p = np.concatenate([p, point.z / problem.scale_z])
    for k in range(steps):
        if not np.isfinite(x).all():
            break
        with np.errstate(all="ignore"):
            x = x + step * np.array(problem.scaled.ode(point.t + k * step, x, [], p, [])[0]).ravel()
    return np.concatenate([x * problem.scale_x, point.x[n:]])
