"""A run of the model, and the points of it at which it is linearised."""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.errors import AcausalError, InitializationError, IntegrationError
from acausal.lower.compiled import CompiledModel
from acausal.result import Result
from acausal.simulate.run import input_vector, parameter_vector, simulate

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Point:
    """An instant of the run: states, algebraic variables, modes, and the stretch of time [s] it stands for."""

    t: float
    x: Vector
    z: Vector
    m: Vector
    reach: float


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A run, whole or up to where it failed.

    `p` and `u` are the values of parameters and inputs; `failure` is why it ended early; `failed` are (solver, time)
    of the solvers that were tried before and stopped there.
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
        """Seconds covered."""
        return float(self.result.time[-1] - self.result.time[0])


def trajectory(
    compiled: CompiledModel,
    count: int,
    solver: str | None,
    parameters: Mapping[str, float] | None,
    options: dict[str, Any],
) -> Trajectory:
    """Run the model and pick `count` points: half of them evenly, half denser towards the start.

    Without `solver` the model's own is used when it has no fixed steps, else `rosenbrock` and then `idas`. A run that
    fails counts as far as it came.

    Raises
    ------
    AcausalError
        When no solver leaves the start.
    """
    own = compiled.flat.experiment.solver
    first = "idas" if len(compiled.states) > 200 else "rosenbrock"
    tried = [solver] if solver else [*([own] if own in ("idas", "rosenbrock", "cvodes", "erk") else []), first, "idas"]
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
    p = parameter_vector(compiled, parameters or {})
    u = input_vector(compiled, options.get("inputs") or {})
    if compiled.solution.structure.rate is not None:
        p[-1] = _rate(compiled, result, p, u)
    return Trajectory(compiled, result, p, u, points(compiled, result, p, u, count), failure, tuple(failed))


def _interval(compiled: CompiledModel, options: dict[str, Any]) -> float | None:
    """Distance of the rows [s]; no simple fraction of the run, which may be many periods of something."""
    own = compiled.flat.experiment
    if own.output_interval is not None:
        return own.output_interval
    start, stop = (
        getattr(own, name) if options.get(name) is None else options[name] for name in ("start_time", "stop_time")
    )
    return float(stop - start) / (300.0 * 0.5 * (1.0 + math.sqrt(5.0)))


def _run(
    compiled: CompiledModel, solver: str, parameters: Mapping[str, float] | None, options: dict[str, Any]
) -> tuple[Result | None, AcausalError | None]:
    # what CasADi and SUNDIALS say of a failure is no news to whoever asked for its reason
    with contextlib.redirect_stderr(io.StringIO()):
        try:
            return simulate(compiled, solver=solver, parameters=parameters, **options), None
        except InitializationError:
            raise
        except (IntegrationError, AcausalError) as error:
            if error.code.startswith(("AC0", "AC1", "AC3")):
                raise
            return getattr(error, "result", None), error


def _rate(compiled: CompiledModel, result: Result, p: Vector, u: Vector) -> float:
    """The rate of stabilised constraints as a run chooses it from its start."""
    t = float(result.time[0])
    x, z = (np.array([float(result[name][0]) for name in names]) for names in (compiled.states, compiled.algebraic))
    m = np.array(compiled.all_modes(t, x, z, u, p)).ravel()
    ode = np.array(compiled.rhs(t, x, z, u, p, m)[0]).ravel()
    fastest = float(np.max(np.abs(ode) / (np.abs(x) + compiled.nominal_x)))
    return max(2.0 * fastest, 10.0 / float(result.time[-1] - t))


def points(compiled: CompiledModel, result: Result, p: Vector, u: Vector, count: int) -> tuple[Point, ...]:
    """At most `count` rows of a result, as points with their modes."""
    rows = len(result.time)
    even = np.linspace(0, rows - 1, max(2, (count + 1) // 2))
    early = np.geomspace(1, rows, max(2, count // 2)) - 1
    chosen = np.unique(np.concatenate([even, early]).round().astype(int))
    while len(chosen) < min(count, rows):  # some coincide: fill the widest gaps
        k = int(np.argmax(np.diff(chosen)))
        chosen = np.insert(chosen, k + 1, (chosen[k] + chosen[k + 1]) // 2)
    while len(chosen) > count:
        chosen = np.delete(chosen, 1 + int(np.argmin(chosen[2:] - chosen[:-2])))
    times = result.time[chosen]
    middle = 0.5 * (times[1:] + times[:-1])
    reach = np.diff(np.concatenate([times[:1], middle, times[-1:]]))
    x = np.array([result[name][chosen] for name in compiled.states]).reshape(len(compiled.states), len(chosen))
    z = np.array([result[name][chosen] for name in compiled.algebraic]).reshape(len(compiled.algebraic), len(chosen))
    found = []
    for k, t in enumerate(times):
        m = np.array(compiled.all_modes(t, x[:, k], z[:, k], u, p)).ravel()
        found.append(Point(float(t), x[:, k], z[:, k], m, float(reach[k])))
    return tuple(found)
