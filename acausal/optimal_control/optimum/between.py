"""What lies between the points of the mesh: path constraints there, and integrals along a run of the solution."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.optimal_control.optimum.integrals import integrals_of
from acausal.optimal_control.optimum.optimum import Optimum
from acausal.optimal_control.optimum.trajectory import PhaseTrajectory, Trajectory
from acausal.optimal_control.program.nlp import Solution
from acausal.optimal_control.program.points import key, symbols_in
from acausal.optimal_control.program.radau import Dynamics, Program, scalar_values
from acausal.result.result import Result

# Positions in each interval, and their weights (Gauss-Legendre); an interval may hold a switch.
_NODES, _WEIGHTS = (v / 2 for v in np.polynomial.legendre.leggauss(12))
# A constraint violated by more than this fraction of its largest magnitude is noted: less is the error of most meshes.
_VIOLATED = 1e-2
# Solvers meet constraints within such a fraction of their scale.
_EXACT = 1e-6


def violation_note(
    program: Program, solution: Solution, trajectory: Trajectory, best: Optimum, run: Result | None
) -> tuple[str, ...]:
    """A note on the path constraint that is violated most between the points.

    `run` is a replay of the solution, looked at instead of it if the solution itself is known at the points only.
    """
    shown = run if run is not None and (program.steps is not None or program.complementarity) else best
    worst, text = _VIOLATED, ""
    for number, phase in enumerate(trajectory.phases):
        stated = [
            c.constraint for c in program.constraints if c.phase == number and c.constraint.expression is not None
        ]
        if not stated:
            continue
        times, values = _values(program, solution, phase, shown, [c.expression for c in stated])
        keep = (
            best.away_from_events(run, times) if shown is run and run is not None else np.ones(len(times), dtype=bool)
        )
        for c, row in zip(stated, values, strict=True):
            excess = np.where(keep, np.maximum(c.lower - row, row - c.upper), 0.0)
            size = max(float(np.abs(row).max()), *(abs(v) for v in (c.lower, c.upper) if np.isfinite(v)))
            k = int(np.argmax(excess))
            if excess[k] > max(worst * size, _EXACT * c.scale):
                worst = float(excess[k]) / size
                text = (
                    f"{c.name} is violated between the points of the mesh: it is {row[k]:.4g} at t = {times[k]:.4g} s"
                )
    return (f"{text}; use more intervals (limits on an input itself hold everywhere)",) if text else ()


def run_integral_error(
    program: Program, laws: Sequence[Dynamics], solution: Solution, trajectory: Trajectory, run: Result
) -> float:
    """Largest error of the integrals in the program against those along a run, relative to their magnitudes."""
    worst, problem = 0.0, program.problem
    integrals = integrals_of(program, solution, [law.dae for law in laws])
    for number, (phase, own) in enumerate(zip(trajectory.phases, integrals, strict=True)):
        stated = [v.expression for v in problem.values if v.kind == "integral" and v.phase == number]
        if stated:
            _, values = _values(program, solution, phase, run, stated)
            weights = np.outer(np.diff(phase.borders) * phase.duration, _WEIGHTS).ravel()
            size = np.maximum(np.abs(values) @ weights, own.least)
            worst = max(worst, float(np.max(np.abs(own.values - values @ weights) / size)))
    return worst


def _values(
    program: Program, solution: Solution, phase: PhaseTrajectory, shown: Result, expressions: Sequence[Any]
) -> tuple[Vector, Vector]:
    """Times [s], shape (n,), and values of the scalars of expressions there, shape (scalars, n), in a result."""
    q = program.problem.quantities
    times = np.concatenate([phase.time(k, _NODES + 0.5) for k in range(len(phase.mesh))])
    times = np.clip(times, shown.time[0], shown.time[-1])
    column = ca.vertcat(*expressions)
    known = list(_known(program, solution, symbols_in(column)))
    used = [(s, o.name) for s, o in zip(q.symbols, q.outputs, strict=True) if key(s) in symbols_in(column)]
    rows = [times[None, :], *(np.asarray(shown.at(times, name))[None, :] for _, name in used)]
    rows += [np.tile(value, len(times)) for _, value in known]
    function = ca.Function("path", [q.time, *(s for s, _ in used), *(s for s, _ in known)], [column]).expand()
    values = function.map(len(times))(*map(ca.DM, rows))
    return times, np.array(values).reshape(column.numel(), len(times))


def _known(program: Program, solution: Solution, wanted: set[int]) -> Iterator[tuple[Any, Vector]]:
    """Decided parameters, durations and values among the symbols with the keys `wanted`, and their values."""
    pairs = [p for p in zip(*scalar_values(program, program.problem), strict=True) if key(p[0]) in wanted]
    for (symbol, _), value in zip(pairs, solution.values(*(v for _, v in pairs)) if pairs else [], strict=True):
        yield symbol, value.reshape(-1, 1)
