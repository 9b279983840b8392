"""Growth of small errors along a run, by the variational equation.

Variations of the states are propagated over the parts of a run, and through its events, by the linear maps of
`acausal.export.sensitivity`, each part starting from the unit vectors; the growth from an instant to the end is the
norm of the product of the maps between them. Eigenvalues of frozen matrices do not show this growth: along an orbit,
one of them has a positive real part all the time, while errors grow only in proportion to time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError
from acausal.export.forms import SENSITIVITIES, check
from acausal.export.sensitivity.chain import Chain
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.driver.run import Run
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.options import input_vector, parameter_vector
from acausal.simulate.options import options as run_options
from acausal.simulate.step_limit.state_matrix import StateMatrix
from acausal.study.repeated import unheard
from acausal.study.stability.trajectory import points

# Number of parts of a run.
_PARTS = 40
# Up to this many states the maps are computed completely; beyond it, along a few random directions.
_WHOLE, _DIRECTIONS = 24, 6
_MOST_EVENTS = 300
_KEEPS_DIGITS = 30.0
# Number of points at which the fastest mode is searched, and decades between the parts that resolve it.
_POINTS, _RATIO = 12, 1.5
# States smaller than this fraction of their nominal magnitude count as that size (`bench.distance`).
_LEAST = 1e-3
_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Growth:
    """Largest growth of an error until the end of a run."""

    factor: float  # states scaled by their largest magnitude from that instant on; at least 1
    relative: float  # states scaled by their magnitude at the time: growth of the relative error
    since: float  # instant [s] of the error with the growth `factor`
    names: tuple[str, ...]  # states with the largest error at the end

    @property
    def text(self) -> str:
        """The growth as a sentence without its subject."""
        digits = f", but only {self.relative:.2g} times relative to the solution" if self.keeps_digits else ""
        shown = f"{self.factor:.2g}"
        return (
            "do not grow until the end of the run"
            if shown == "1"
            else f"grow up to {shown} times until the end of the run{digits}"
        )

    @property
    def keeps_digits(self) -> bool:
        """Whether the solution grows with its errors, so that the relative error does not grow."""
        return self.factor > _KEEPS_DIGITS * self.relative

    def content(self) -> dict[str, object]:
        """For JSON."""
        return {
            "factor": self.factor,
            "relative": self.relative,
            "since": self.since,
            "states": list(self.names),
        }


def growth(
    compiled: CompiledModel, parameters: Mapping[str, float] | None, run_as: Mapping[str, Any], span: float
) -> Growth | None:
    """The growth of errors in the first `span` seconds of a run; None if it cannot be measured.

    Parameters
    ----------
    run_as
        Options of `simulate`, of which the start time and the inputs are used.

    Beyond 24 states errors are propagated in six random directions from the start, which soon align with the fastest
    growth. Returns None for delays, for sliding modes without derivatives, and for runs that fail.
    """
    try:
        check(compiled, SENSITIVITIES, [])
        n = compiled.n_dynamic
        if not n:
            return None
        run, result = _traced(compiled, parameters, run_as, span)
        if len(run.hybrid.passages) > _MOST_EVENTS:  # type: ignore[union-attr]
            return None
        chain = Chain(run, [], [], _TOLERANCE)
        chain.stiffness.stiff = True  # use the stiff method, which damps directions off the slow solution
        rows = np.abs([np.asarray(result[name], dtype=float) for name in compiled.states[:n]])
        least = _LEAST * compiled.nominal_x[:n]
        floor = np.clip(rows.max(axis=1), least, compiled.nominal_x[:n])
        times, maps = _maps(chain, n, span, _fastest(run, result))
        if not all(np.isfinite(part).all() for part in maps):
            return None
    except (AcausalError, RuntimeError, np.linalg.LinAlgError):
        return None
    values = np.array([np.asarray(result.at(times, name), dtype=float) for name in compiled.states[:n]])
    moving = floor[:, None] + np.abs(values)
    sizes = [_sizes(result, rows, float(t), least) for t in times]
    largest, first, errors = _largest(maps, lambda k: (sizes[k], sizes[k]))
    relative, *_ = _largest(maps, lambda k: (moving[:, k], moving[:, -1]))
    order = np.argsort(-errors, kind="stable")[:3]
    names = tuple(compiled.states[k] for k in order if errors[k] >= 0.1 * errors[order[0]])
    return Growth(largest, relative, float(times[first]), names)


def _traced(
    compiled: CompiledModel, parameters: Mapping[str, float] | None, run_as: Mapping[str, Any], span: float
) -> tuple[Run, Result]:
    opts = run_options(compiled.flat.experiment, start_time=run_as.get("start_time"), tolerance=_TOLERANCE)
    opts = run_options(
        compiled.flat.experiment,
        start_time=opts.start_time,
        stop_time=opts.start_time + span,
        tolerance=_TOLERANCE,
        solver="rosenbrock",
        output_interval=span / 500,
    )
    p, u = parameter_vector(compiled, parameters or {}), input_vector(compiled, run_as.get("inputs") or {})
    run = Run(compiled, opts, p, Inputs(u), None, traced=True)
    with unheard():
        return run, run.result()


def _maps(chain: Chain, n: int, span: float, fastest: float) -> tuple[Vector, list[Vector]]:
    """(Instants, maps of variations of the first n states from each instant to the next, events in between included).

    Maps have shape (n, n); beyond 24 states they are the variations themselves, shape (n, 6), at later instants.
    """
    whole = n <= _WHOLE
    unit = np.eye(chain.size, n)
    x = unit if whole else np.random.default_rng(1).standard_normal((chain.size, _DIRECTIONS))
    times, maps = [chain.passages[0].time], [x[:n]] if not whole else []
    for k in range(len(chain.passages)):
        stretch = chain.stretch(k)
        if k:
            x = chain.event(k)[0] @ x
        if stretch.end <= stretch.start:
            continue
        count = max(1, round(_PARTS * (stretch.end - stretch.start) / span))
        ends = np.linspace(stretch.start, stretch.end, count + 1)
        for end, linear_map in stretch.parts(_resolve(ends, fastest, whole)):
            x = linear_map @ x
            if end not in ends:
                continue
            times.append(end)
            maps.append(x[:n])
            # variations of the other states are dropped here: discrete ones change at the next event
            x = unit if whole else x
    return np.array(times), maps


def _sizes(result: Result, rows: Vector, t: float, least: Vector) -> Vector:
    """Largest magnitude of each state, shape (n,), from instant `t` on, at the latest from the middle of the run on.

    Earlier values are not a scale for later errors: some states decay through ten decades.
    """
    first, last = float(result.time[0]), float(result.time[-1])
    later = result.time >= min(t, 0.5 * (first + last))
    return np.asarray(np.maximum(rows[:, later].max(axis=1), least))


def _resolve(ends: Vector, fastest: float, again: bool) -> Vector:
    """Ends of parts, with short parts that resolve the fastest mode [1/s] at the start of the first, or of all parts.

    A unit vector points away from the slow solution, and a long step would not damp this component, because the matrix
    of the method is a different one there.
    """
    resolved = []
    for k, (a, b) in enumerate(pairwise(ends)):
        length = float(b - a)
        decades = math.log10(max(1.0, fastest * length)) if again or not k else 0.0
        resolved += [a + length * 10.0**-d for d in np.arange(decades, 0.5, -_RATIO).tolist()]
        resolved.append(b)
    return np.array(resolved)


def _fastest(run: Run, result: Result) -> float:
    """Largest |eigenvalue| at some points of the run [1/s]."""
    c, p = run.compiled, run.p
    found = (
        StateMatrix(at.compiled, p, run.u).eigenvalues(at.t, at.x, at.z, at.m)
        for at in points(c, result, p, run.u, _POINTS)
    )
    return max((float(np.abs(v).max(initial=0.0)) for v in found if v is not None), default=0.0)


def _largest(maps: list[Vector], scales: Callable[[int], tuple[Vector, Vector]]) -> tuple[float, int, Vector]:
    """(Largest growth from an instant to the end, index of that instant, error of each state at the end, shape (n,)).

    `scales(k)` returns the scales of the states, shape (n,), at instant k and at the end.
    """
    n, columns = maps[0].shape
    last = len(maps) if n == columns else len(maps) - 1
    best = (1.0, last, np.ones(n))
    product = np.eye(n)
    for first in range(last - 1, -1, -1):
        before, after = scales(first)
        if n == columns:
            product = product @ maps[first]
            scaled = product * before / after[:, None]
            size, errors = float(np.linalg.norm(scaled, 2)), np.linalg.norm(scaled, axis=1)
        else:
            scaled = maps[last] / after[:, None]
            ratios = np.linalg.norm(scaled, axis=0) / np.linalg.norm(maps[first] / before[:, None], axis=0)
            size, errors = float(ratios.max()), np.abs(scaled[:, int(np.argmax(ratios))])
        if size > best[0]:
            best = size, first, errors
    return best
