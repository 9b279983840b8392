"""Initial guess of an optimal-control problem: a simulation of the model, divided at the ends of the phases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import OptimizationError
from acausal.lower.casadi_model import Ports
from acausal.optimal_control.declare import PhaseSpec
from acausal.optimal_control.problem import StatedProblem
from acausal.result.result import Result
from acausal.simulate.run import simulate

# A guess need not be accurate: points per interval, their minimum number in total, and the tolerance of the run.
_ROWS, _FEWEST, _TOLERANCE = 10, 100, 1e-5
# Length of the part of the run after the last phase that is used, relative to the duration of that phase.
_BEYOND = 0.1


@dataclass(frozen=True, eq=False)
class PhaseGuess:
    """Guess of one phase: its duration [s], and its trajectories.

    `at` maps n fractions of the phase in [0, 1] to x, z, u of shapes (nx, n), (nz, n), (nu, n). `following` is the part
    of the run after the last phase if a switch ends it, else None.
    """

    duration: float
    at: Callable[[Vector], tuple[Vector, Vector, Vector]]
    following: PhaseGuess | None = None


def initial_guess(problem: StatedProblem) -> list[PhaseGuess]:
    """Guess of every phase.

    Raises OptimizationError: AC705 if the run does not reach the end of a phase.
    """
    lines = _lines(problem)
    run = problem.guess_run or _run(problem)
    q, found, first = problem.quantities, [], float(run.time[0])
    rows = [_sampled(run, q.states.names), _algebraic(run, q.z), _sampled(run, q.u.names)]
    # convert before the run is divided, so that angles are continuous from phase to phase
    rows[0] = q.coordinates.of(rows[0])
    whole = sum(spec.expected for spec in problem.specs)
    elapsed = 0.0
    for k, spec in enumerate(problem.specs):
        last = first + spec.expected if spec.switch is None else _end(problem, run, spec, first)
        if k == len(problem.specs) - 1 and spec.switch is None and problem.guess_run is not None:
            last = float(run.time[-1])
        last = min(last, float(run.time[-1]))
        if last <= first:
            raise _not_reached(problem, run, spec, first)
        extent = (elapsed / whole, (elapsed + spec.expected) / whole)
        found.append(PhaseGuess(last - first, _interpolant(rows, run, first, last, lines, extent)))
        beyond = min(last + _BEYOND * (last - first), float(run.time[-1]))
        if k == len(problem.specs) - 1 and spec.switch is not None and beyond > last:
            later = PhaseGuess(beyond - last, _interpolant(rows, run, last, beyond, {}, extent))
            found[-1] = replace(found[-1], following=later)
        first, elapsed = last, elapsed + spec.expected
    return found


def _lines(problem: StatedProblem) -> dict[int, tuple[float, float]]:
    """Lines given by the user, and the constant rates of those coordinates whose rates are coordinates as well."""
    given = problem.guess_lines
    if not given:
        return {}
    rates = problem.quantities.rates()
    whole = sum(spec.expected for spec in problem.specs)
    slopes = {rates[k]: ((b - a) / whole, (b - a) / whole) for k, (a, b) in given.items() if k in rates}
    return {**slopes, **given}


def _run(problem: StatedProblem) -> Result:
    """Simulation of the model with the inputs of the guess."""
    q = problem.quantities
    inputs: dict[str, Any] = {port.name: min(max(port.start, port.min), port.max) for port in q.u}
    inputs |= problem.guess_inputs
    begin = q.begin.t
    names = q.parameters.names
    declared = problem.compiled.parameter_values
    changed = {n: float(v) for n, v, d in zip(names, q.p, declared, strict=True) if v != d}
    changed.pop("stabilisation.rate", None)
    expected = sum(spec.expected for spec in problem.specs)
    rows = _ROWS * sum(len(spec.mesh) for spec in problem.specs)
    return simulate(
        problem.compiled,
        inputs=inputs,
        parameters=changed,
        start_time=begin,
        stop_time=begin + expected,
        output_interval=expected / max(rows, _FEWEST),
        tolerance=_TOLERANCE,
    )


def _interpolant(
    samples: Sequence[Vector],
    run: Result,
    first: float,
    last: float,
    lines: dict[int, tuple[float, float]],
    extent: tuple[float, float],
) -> Callable[[Vector], tuple[Vector, Vector, Vector]]:
    """The function `at` of the guess of a phase between the times `first` and `last` of a run.

    `samples`: x, z, u at the rows of the run, shapes (nx, rows), (nz, rows), (nu, rows).
    `lines`: coordinates that follow straight lines over all phases, with their values at both ends.
    `extent`: start and end of the phase as fractions of all phases.
    """

    def at(fractions: Vector) -> tuple[Vector, Vector, Vector]:
        # stay just inside the phase, because values at its ends may belong to the other side of an event
        times = first + (last - first) * np.clip(fractions, 1e-9, 1 - 1e-9)
        parts = [np.array([np.interp(times, run.time, row) for row in rows]) for rows in samples]
        x, z, u = (part.reshape(len(rows), len(times)) for part, rows in zip(parts, samples, strict=True))
        for k, (a, b) in lines.items():
            x[k] = a + (b - a) * (extent[0] + (extent[1] - extent[0]) * fractions)
        return x, z, u

    return at


def _sampled(run: Result, names: Sequence[str]) -> Vector:
    """Values of variables at the rows of a run, shape (names, rows)."""
    return np.array([run[name] for name in names]).reshape(len(names), len(run.time))


def _algebraic(run: Result, ports: Ports) -> Vector:
    """Values of algebraic variables at the rows of a run, shape (ports, rows).

    The derivatives of constraints among them are no signals of a run, and keep their values at the start.
    """
    rows = [run[port.name] if port.name in run.signals else np.full(len(run.time), port.start) for port in ports]
    return np.array(rows).reshape(len(ports), len(run.time))


def _end(problem: StatedProblem, run: Result, spec: PhaseSpec, first: float) -> float:
    """Time [s] after `first` at which the condition that ends the phase becomes true in the run."""
    assert spec.switch is not None
    guard = problem.guards[spec.switch]
    later = first + 1e-9 * (run.time[-1] - run.time[0])
    if guard.relation is not None:
        text = problem.compiled.events.texts[guard.relation]
        for event in run.events:
            if event.time > later and text in event.condition.split("; "):
                return event.time
    rows = np.flatnonzero(run.time > first)
    values = _guard_values(problem, spec.switch, run, rows)
    after = np.flatnonzero((values[:-1] <= 0.0) & (values[1:] > 0.0))
    if not len(after):
        raise _not_reached(problem, run, spec, first)
    k = int(after[0])
    low, high = run.time[rows[k]], run.time[rows[k + 1]]
    return float(low + (high - low) * values[k] / (values[k] - values[k + 1]))


def _guard_values(problem: StatedProblem, switch: int, run: Result, rows: Any) -> Vector:
    """Values of a guard at n rows of a run, shape (n,)."""
    q, guard = problem.quantities, problem.guards[switch]
    n = len(rows)
    if not n:
        return np.zeros(0)
    if guard.relation is not None:
        columns = [found[:, rows] for found in (_sampled(run, q.states.names), _algebraic(run, q.z))]
        columns.append(_sampled(run, q.u.names)[:, rows])
        point = [ca.DM(c) if c.size else ca.DM(c.shape[0], n) for c in (run.time[None, rows], *columns)]
        point.append(ca.repmat(ca.DM(q.p), 1, n))
        modes = q.compiled.all_modes.map(n)(*point)
        return np.asarray(np.array(q.compiled.events.distances.map(n)(*point, modes))[guard.relation])
    symbols = [q.time, *q.symbols, *(d[3] for d in q.decided)]
    function = ca.Function("guard", symbols, [guard.expression])
    columns = [run.time[rows], *_sampled(run, [o.name for o in q.outputs])[:, rows]]
    columns += [np.full(n, q.p[place]) for place, *_ in q.decided]
    return np.array(function.map(n)(*(c[None, :] for c in columns))).ravel()


def _not_reached(problem: StatedProblem, run: Result, spec: PhaseSpec, first: float) -> OptimizationError:
    """The error AC705."""
    text = problem.guards[spec.switch].text if spec.switch is not None else "its end"
    earlier = [e.time for e in run.events if text in e.condition.split("; ") and e.time <= first]
    seen = [f"{e.time:.4g} s  {e.condition}" for e in run.events[:6]]
    begins = f"phase '{spec.name}' starts at {first:.4g} s and is expected to take {spec.expected:.4g} s"
    cause = f"the run is as long as all phases together are expected to take, {run.time[-1] - run.time[0]:.4g} s: too "
    cause += "short for this end, or its inputs do not lead there"
    help_ = "give longer durations, phase(expected=...), or inputs that lead there, problem.guess(inputs={...})"
    if earlier:
        cause = f"this happens at {earlier[-1]:.4g} s, but the phase starts at {first:.4g} s"
        help_ = "declare phases in the order of the run; " + help_
    elif problem.guess_run is not None:
        cause, help_ = "the run given as a guess ends before it", "give one that reaches it, problem.guess(run=...)"
    return OptimizationError(
        "AC705",
        f"the run of the guess does not reach the end of phase '{spec.name}': {text}",
        evidence=[f"it goes from {run.time[0]:g} to {run.time[-1]:g} s; {begins}", *seen],
        cause=cause,
        help=help_,
    )
