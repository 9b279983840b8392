"""A run of the model, and the points at which it is linearised."""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, InitializationError, IntegrationError
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.driver.run import Run
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.options import input_vector, parameter_vector
from acausal.simulate.options import options as run_options
from acausal.simulate.record.record import Dense
from acausal.simulate.run import simulate

# Maximum number of stretches between events that get a row, and of combinations of modes added to the points.
_MOST_STRETCHES, _MOST_MODES = 200, 20


@dataclass(frozen=True, eq=False)
class Point:
    """A point of the run: t [s], x (nx,), z (nz,), m (nm,), and the time [s] that it represents.

    `compiled` are the equations of the run there: those of a sliding mode are others than those of the model.
    """

    t: float
    x: Vector
    z: Vector
    m: Vector
    reach: float
    compiled: CompiledModel


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A run, complete or up to its failure.

    `p`, shape (np,), and `u`, shape (nu,), are parameters and inputs; `failure` is the error that ended the run early;
    `failed` are (solver, time [s]) of solvers that were tried before and stopped there.
    """

    compiled: CompiledModel
    result: Result
    p: Vector
    u: Vector
    points: tuple[Point, ...]
    failure: AcausalError | None
    failed: tuple[tuple[str, float], ...]

    @property
    def span(self) -> float:
        """Duration of the run [s]."""
        return float(self.result.time[-1] - self.result.time[0])


def trajectory(
    compiled: CompiledModel,
    count: int,
    solver: str | None,
    parameters: Mapping[str, float] | None,
    options: dict[str, Any],
) -> Trajectory:
    """Run the model and pick `count` points: half of them evenly, half denser towards the start.

    Without `solver`, the solver of the model is used if it is implicit and has no fixed steps, else `rosenbrock` and
    then `idas`. A run that fails is used up to its failure. A run with events closer together than its rows is repeated
    with a row between any two of them, because short contacts limit the steps.

    Raises AcausalError if no solver gets beyond the start.
    """
    declared = compiled.flat.experiment.solver
    first = "idas" if len(compiled.states) > 200 else "rosenbrock"
    # explicit methods do not show how many steps accuracy requires: stability may have limited theirs
    implicit = [declared] if declared in ("idas", "rosenbrock", "cvodes") else []
    tried = [solver] if solver else [*implicit, first, "idas"]
    tried += ["erk"] if declared == "erk" else []
    failure: AcausalError | None = None
    result: Result | None = None
    failed = []
    options = {**options, "output_interval": _interval(compiled, options)}
    for name in dict.fromkeys(tried):
        found, error = _run(compiled, name, parameters, options)
        if error is None:
            result, failure = found, None
            break
        failed.append((name, math.nan if found is None else float(found.time[-1])))
        if failure is None or (found is not None and (result is None or found.time[-1] > result.time[-1])):
            result, failure = found, error
    if result is None or len(result.time) < 2:
        assert failure is not None
        raise failure
    result = _closer(compiled, result, parameters, options)
    p = parameter_vector(compiled, parameters or {})
    u = input_vector(compiled, options.get("inputs") or {})
    if compiled.solution.structure.rate is not None:
        p[-1] = _rate(compiled, result, p, u)
    return Trajectory(compiled, result, p, u, points(compiled, result, p, u, count), failure, tuple(failed))


def _interval(compiled: CompiledModel, options: dict[str, Any]) -> float | None:
    """Distance of the rows [s]; an irrational fraction of the run, so as not to sample an oscillation in phase."""
    experiment = compiled.flat.experiment
    if experiment.output_interval is not None:
        return experiment.output_interval
    start, stop = (
        getattr(experiment, name) if options.get(name) is None else options[name]
        for name in ("start_time", "stop_time")
    )
    return float(stop - start) / (300.0 * 0.5 * (1.0 + math.sqrt(5.0)))


def _run(
    compiled: CompiledModel, solver: str, parameters: Mapping[str, float] | None, options: dict[str, Any]
) -> tuple[Result | None, AcausalError | None]:
    # suppress the messages of CasADi and SUNDIALS about a failure, which is reported anyway
    with contextlib.redirect_stderr(io.StringIO()):
        try:
            return simulate(compiled, solver=solver, parameters=parameters, **options), None
        except InitializationError:
            raise
        except (IntegrationError, AcausalError) as error:
            if error.code.startswith(("AC0", "AC1", "AC3")):
                raise
            return getattr(error, "result", None), error


def _stretches(compiled: CompiledModel, result: Result, p: Vector) -> tuple[Vector, Vector]:
    """(Starts, ends) of the stretches between events, shape (k,), without those as short as rounding errors of time.

    Instants at which sources switch end a stretch, too, although a result does not list them as events.
    """
    times = result.time
    instants = [*(e.time for e in result.events), *np.array(compiled.instants(p)).ravel().tolist()]
    edges = np.unique([times[0], times[-1], *(t for t in instants if times[0] < t < times[-1])])
    wide = np.diff(edges) > 1e-9 * (times[-1] - times[0])
    return edges[:-1][wide], edges[1:][wide]


def _closer(
    compiled: CompiledModel, result: Result, parameters: Mapping[str, float] | None, options: dict[str, Any]
) -> Result:
    """The run, repeated with a row inside every stretch between events if one has none."""
    p, u = parameter_vector(compiled, parameters or {}), input_vector(compiled, options.get("inputs") or {})
    starts, ends = _stretches(compiled, result, p)
    inside = np.searchsorted(result.time, ends, "left") > np.searchsorted(result.time, starts, "right")
    empty = np.flatnonzero(~inside)[:_MOST_STRETCHES]
    if not len(empty):
        return result
    grid = np.union1d(result.time, 0.5 * (starts + ends)[empty])
    repeated = {key: value for key, value in options.items() if key != "inputs"}
    repeated |= {"solver": str(result.stats["solver"]), "stop_time": float(result.time[-1])}
    opts = run_options(compiled.flat.experiment, **repeated)
    try:
        return Run(compiled, opts, p, Inputs(u), None, outputs=grid).result()
    except AcausalError:
        return result


def _rate(compiled: CompiledModel, result: Result, p: Vector, u: Vector) -> float:
    """Stabilisation rate [1/s] as a run chooses it at its start."""
    t = float(result.time[0])
    x, z = (np.array([float(result[name][0]) for name in names]) for names in (compiled.states, compiled.algebraic))
    m = np.array(compiled.all_modes(t, x, z, u, p)).ravel()
    ode = np.array(compiled.rhs(t, x, z, u, p, m)[0]).ravel()
    fastest = float(np.max(np.abs(ode) / (np.abs(x) + compiled.nominal_x)))
    return max(2.0 * fastest, 10.0 / float(result.time[-1] - t))


def points(compiled: CompiledModel, result: Result, p: Vector, u: Vector, count: int) -> tuple[Point, ...]:
    """`count` rows of a result as points, and one more for each combination of modes that these do not contain.

    `p`: shape (np,); `u`: shape (nu,).
    """
    rows = len(result.time)
    even = np.linspace(0, rows - 1, max(2, (count + 1) // 2))
    early = np.geomspace(1, rows, max(2, count // 2)) - 1
    chosen = np.unique(np.concatenate([even, early]).round().astype(int))
    while len(chosen) < min(count, rows):  # some rows coincide: fill the widest gaps
        k = int(np.argmax(np.diff(chosen)))
        chosen = np.insert(chosen, k + 1, (chosen[k] + chosen[k + 1]) // 2)
    while len(chosen) > count:
        chosen = np.delete(chosen, 1 + int(np.argmin(chosen[2:] - chosen[:-2])))
    times = result.time[chosen]
    middle = 0.5 * (times[1:] + times[:-1])
    reach = np.diff(np.concatenate([times[:1], middle, times[-1:]]))
    states = np.array([result[name] for name in compiled.states]).reshape(len(compiled.states), rows)
    algebraic = np.array([result[name] for name in compiled.algebraic]).reshape(len(compiled.algebraic), rows)

    def point(row: int, span: float) -> Point:
        t, x, z = float(result.time[row]), states[:, row], algebraic[:, row]
        held = result.dense.held(t) if isinstance(result.dense, Dense) else None
        own = compiled, np.array(compiled.all_modes(t, x, z, u, p)).ravel()
        equations, m = own if held is None or held[0].states != compiled.states else held
        return Point(t, x, z, m, span, equations)

    found = [point(int(row), float(span)) for row, span in zip(chosen, reach, strict=True)]
    visited = {(at.m.tobytes(), id(at.compiled)) for at in found}
    if not compiled.n_modes:
        return tuple(found)
    missed: dict[tuple[bytes, int], list[Point]] = {}
    for a, b in zip(*_stretches(compiled, result, p), strict=True):
        row = (np.searchsorted(result.time, a, "right") + np.searchsorted(result.time, b, "left")) // 2
        if len(missed) < _MOST_MODES and a < result.time[row] < b:
            at = point(int(row), float(b - a))
            if (key := (at.m.tobytes(), id(at.compiled))) not in visited:
                missed.setdefault(key, []).append(at)
    # one point for each combination of modes, which represents all the time spent in it
    found += [replace(several[0], reach=sum(at.reach for at in several)) for several in missed.values()]
    return tuple(sorted(found, key=lambda at: at.t))
