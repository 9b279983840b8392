"""From a problem to its optimum: guess, program, ipopt, and the mesh until IDAS agrees."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import OptimizationError, UsageError
from acausal.optimal_control.branches import Widths
from acausal.optimal_control.guess import guessed
from acausal.optimal_control.optimum.error import interval_errors
from acausal.optimal_control.optimum.optimum import Optimum, optimum_of
from acausal.optimal_control.optimum.replayed import elsewhere
from acausal.optimal_control.optimum.trajectory import Trajectory, trajectory_of
from acausal.optimal_control.phases import bias, dynamics_of, kinks, verified
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.nlp import Solution, minimized
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import Dynamics, PhaseProgram, Program, transcribed
from acausal.optimal_control.program.shooting import Steps

_INFEASIBLE = ("Infeasible_Problem_Detected", "Restoration_Failed")
_UNBOUNDED = "Diverging_Iterates"
# Unknowns are divided by their magnitudes: what grows beyond this has no end.
_DIVERGING = 1e8
# Errors of an interval, by the magnitude of a state, that are worth a note.
_NOTED = 1e-3
# A run that goes elsewhere by so many times what the intervals one behind the other do, and what is rounded explains,
# meets what they do not see.
_BLIND = 10.0
# How far ipopt moves the guess of a run inside of limits: such a run drives into them, and what lies at a limit
# shortens the first steps of all unknowns. The answer of a coarser mesh stays where it is.
_INSIDE = {"bound_push": 0.1, "bound_frac": 0.1}
_log = logging.getLogger(__name__)
SOLVERS: Mapping[str, Mapping[str, Any]] = {
    "ipopt": {"print_level": 0, "sb": "yes", "diverging_iterates_tol": _DIVERGING},
    "fatrop": {"print_level": 0},
}
"""Solvers that CasADi ships, with the options that they are given."""


@dataclass(frozen=True)
class Choices:
    """How a problem is solved; see `Problem.solve`."""

    tolerance: float
    degree: int
    control: int
    accuracy: float | None
    refinements: int
    smooth: float
    complementarity: bool
    steps: Steps | None
    solver: str
    options: Mapping[str, Any]


class _Laps:
    """Processor time of what a solution is made of: guess, build, solve, check [s]."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(("guess", "build", "solve", "check"), 0.0)
        self._last = clock.process_time()

    def lap(self, name: str) -> None:
        """Count what has passed since the last lap."""
        now = clock.process_time()
        self.seconds[name] += now - self._last
        self._last = now


def solved(problem: StatedProblem, choices: Choices) -> Optimum:
    """See `Problem.solve`."""
    basis = Basis(choices.degree, choices.control) if choices.steps is None else Basis(1, 0)
    _check(problem, basis.degree, basis.control, choices)
    problem = problem.opened() if choices.steps is None else problem
    accuracy, refinements = choices.accuracy, choices.refinements
    taken = _Laps()
    guesses = guessed(problem)
    taken.lap("guess")
    first = guesses
    free = choices.complementarity
    # by the size of what decides a branch, a share of 1
    smooth = 1.0 if free else choices.smooth
    widths = kinks(problem, first, smooth, often=True) if smooth else []
    laws = dynamics_of(problem, first, widths, free)
    meshes = [spec.mesh for spec in problem.specs]
    iterations: list[int] = []
    expected = problem.quantities.p
    while True:
        program = transcribed(problem, laws, guesses, meshes, basis, expected, steps=choices.steps)
        taken.lap("build")
        solution = _run(program, choices, guesses is first)
        taken.lap("solve")
        iterations.append(solution.iterations)
        trajectory = trajectory_of(program, solution)
        others = _others(problem, trajectory, widths, smooth) if smooth else widths
        if others != widths and len(iterations) <= refinements:
            widths, guesses, expected = others, trajectory.guesses(), trajectory.p
            laws = dynamics_of(problem, first, widths, free)
            continue
        best = optimum_of(problem, program, solution, trajectory, {})
        errors, drift, is_blind = _errors(problem, program, laws, solution, trajectory, best)
        worst = max((float(e.max()) for e in errors), default=0.0)
        taken.lap("check")
        if accuracy is None or worst <= accuracy:
            break
        if len(iterations) > refinements:
            raise _too_coarse(trajectory, errors, accuracy)
        meshes = [
            mesh.refined(set(np.flatnonzero(e > accuracy).tolist())) for mesh, e in zip(meshes, errors, strict=True)
        ]
        guesses = trajectory.guesses()
        expected = trajectory.p
    stats: dict[str, Any] = {
        "solver": choices.solver,
        "iterations": iterations[0] if len(iterations) == 1 else tuple(iterations),
        "intervals": sum(map(len, meshes)),
        **({} if program.relaxed else {"interval_error": worst}),
        "replay_error": drift,
        "bias": (off := bias(laws, trajectory)),
        **taken.seconds,
    }
    own = _switching(worst) if program.relaxed else _coarse(trajectory, errors, worst, drift, is_blind)
    stats["notes"] = (*problem.quantities.begin.notes, *own, *(_rounded(widths, off) if choices.smooth else ()))
    for note in stats["notes"]:
        _log.warning("%s: %s", problem.compiled.name, note)
    return replace(best, stats=stats)


def _errors(
    problem: StatedProblem,
    program: Program,
    laws: Sequence[Dynamics],
    solution: Solution,
    trajectory: Trajectory,
    best: Optimum,
) -> tuple[list[Vector], float, bool]:
    """Errors of all intervals, how far a run goes elsewhere, and whether that is more than the points can tell."""
    if not program.relaxed:
        verified(problem, laws, trajectory)
    drift, farther = elsewhere(best, [len(phase.mesh) for phase in program.phases])
    if program.relaxed:
        return _of_switches(program, solution, drift), drift, False
    errors, foretold = interval_errors(problem, laws, trajectory)
    is_blind = drift > max(_BLIND * max(foretold, bias(laws, trajectory)), _NOTED)
    if is_blind:
        errors = [np.maximum(*both) for both in zip(errors, farther, strict=True)]
    return errors, drift, is_blind


def _others(problem: StatedProblem, trajectory: Trajectory, widths: list[Widths], smooth: float) -> list[Widths]:
    """The branches that are rounded, and those that the answer goes both ways at."""
    found = kinks(problem, trajectory.guesses(), smooth)
    return [{**more, **known} for more, known in zip(found, widths, strict=True)]


def _rounded(widths: list[Widths], off: float) -> tuple[str, ...]:
    count = sum(map(len, widths))
    if not count:
        return ()
    return (f"{count} kinks are rounded, which leads states away by up to {off:.2g} of their magnitude",)


def _switching(worst: float) -> tuple[str, ...]:
    """A note where a run with the answer goes elsewhere."""
    if worst <= 10 * _NOTED:
        return ()
    return (
        f"switches lie within intervals: a run with these inputs goes {worst:.2g} of a state's magnitude elsewhere; "
        "solve(accuracy=1e-2)",
    )


def _check(problem: StatedProblem, degree: int, control: int, choices: Choices) -> None:
    solver, smooth = choices.solver, choices.smooth
    if choices.complementarity and (smooth or choices.steps is not None or solver != "ipopt"):
        raise UsageError(
            "AC053",
            "complementarity goes with collocation and ipopt, and rounds nothing",
            help="leave out smooth=, shooting= and solver=",
        )
    if problem.objective is None:
        raise UsageError("AC053", f"{problem!r} minimizes nothing", help="problem.minimize(problem.duration)")
    if solver not in SOLVERS:
        raise UsageError("AC053", f"there is no solver '{solver}'", help=f"solvers: {', '.join(SOLVERS)}")
    if not 0.0 <= smooth < 1.0:
        raise UsageError("AC053", f"kinks are not rounded by {smooth:g}", help="smooth=1e-3: a share, from 0 to 1")
    if degree < 1 or degree > 9 or control < 0 or control > degree - 1:
        raise UsageError(
            "AC053",
            f"inputs of degree {control} with {degree} points in an interval",
            help="1 to 9 points, and inputs of a degree below their number",
        )


def _run(program: Program, choices: Choices, first: bool) -> Solution:
    """What the solver finds; `first` where it begins from a run of the model."""
    name = choices.solver
    options = {"tol": choices.tolerance, **SOLVERS[name], **choices.options}
    found = minimized(program.nlp, name, {**(_INSIDE if first and name == "ipopt" else {}), **options})
    if found.success and program.relaxed:
        found = tightened(program, found, options)
    if not found.success:
        raise _failure(program, found, name)
    return found


def _failure(program: Program, solution: Solution, solver: str) -> OptimizationError:
    status = solution.status
    if status == _UNBOUNDED:
        return OptimizationError(
            "AC702",
            "the objective has no smallest value: ipopt's iterates grow without end",
            evidence=[f"largest: {name}" for name in _largest(program, solution)],
            help="limit what grows: subject_to(name, min=..., max=...), or min and max of the inputs",
        )
    if status in _INFEASIBLE:
        return OptimizationError(
            "AC701",
            "the demands contradict each other, or the model: ipopt finds no point that fulfils all",
            evidence=[*_violated(program, solution), f"they press most: {', '.join(_pressing(program, solution))}"],
            help="relax them, allow more time, or begin elsewhere: problem.guess(...)",
        )
    return OptimizationError(
        "AC703",
        f"{solver} gives up: {status.replace('_', ' ')}",
        evidence=_violated(program, solution),
        help="begin nearer to an answer (problem.guess), give magnitudes (nominal=) to variables, or more iterations: "
        'solve(options={"max_iter": 3000}); kinks of where, maximum and the like can be rounded: solve(smooth=1e-3)',
    )


def _violated(program: Program, solution: Solution) -> list[str]:
    """The demands that the last point violates most, worst first."""
    found = []
    for demand in program.demands:
        values = solution.g[demand.rows.start : demand.rows.stop] * demand.scale
        c = demand.constraint
        off = np.maximum(np.maximum(c.lower - values, values - c.upper), 0.0) / demand.scale
        if off.size and (off.max() > 1e-6 or not np.isfinite(values).all()):
            k = int(np.argmax(off))
            place = f" in {program.phases[demand.phase].spec.name}" if demand.phase is not None else ""
            found.append((float(off[k]), f"{c.name}{place}: it is {values[k]:.4g}", c.where))
    return [text for _, text, _ in sorted(found, key=lambda item: -item[0])[:4]]


def _pressing(program: Program, solution: Solution) -> list[str]:
    """The demands with the largest multipliers at the last point, as their magnitudes count."""
    found: dict[str, float] = {}
    for demand in program.demands:
        duals, name = solution.duals[demand.rows.start : demand.rows.stop], demand.constraint.name
        found[name] = max(found.get(name, 0.0), float(np.abs(duals).max(initial=0.0)))
    return sorted(found, key=lambda name: -found[name])[:4]


def _largest(program: Program, solution: Solution) -> list[str]:
    """Names of what has grown most, against the guess."""
    found = []
    for phase in program.phases:
        x, u, duration = solution.values(phase.x, phase.u, phase.duration)
        for ports, values in zip(program.ports, (x, u), strict=True):
            rows = values.reshape(len(ports), -1)
            found += [(float(np.abs(v).max()) / p.nominal, p.name) for p, v in zip(ports, rows, strict=True)]
        found.append((duration.item(), f"duration of {phase.spec.name}"))
    return list(dict.fromkeys(name for _, name in sorted(found, key=lambda item: -item[0])))[:3]


def _coarse(
    trajectory: Trajectory, errors: list[Vector], worst: float, drift: float, is_blind: bool
) -> tuple[str, ...]:
    """A note where the mesh is so coarse that the optimum may live on its errors, or a run go elsewhere."""
    if is_blind:
        return (
            "something acts between the points of the mesh that they do not see: a run with these inputs goes "
            f"{drift:.2g} of a state's magnitude elsewhere from {_place(trajectory, errors)} on; solve(accuracy=1e-3), "
            "or more intervals there",
        )
    if worst <= _NOTED and drift <= 10 * _NOTED:
        return ()
    if worst <= _NOTED:
        enough = 10.0 ** np.floor(np.log10(max(worst * min(10 * _NOTED / drift, 1.0), 1e-9)))
        return (
            f"errors grow along the motion: {worst:.2g} of a state's magnitude in one interval at most, a run with "
            f"these inputs goes {drift:.2g} elsewhere; solve(accuracy={enough:g}), or keep to it with a controller",
        )
    where = _place(trajectory, errors)
    return (f"the mesh is coarse: IDAS ends {worst:.2g} of a state's magnitude off in {where}; solve(accuracy=1e-4)",)


def _place(trajectory: Trajectory, errors: list[Vector]) -> str:
    """The interval with the largest error."""
    phase = max(range(len(errors)), key=lambda k: float(errors[k].max(initial=0.0)))
    k = int(np.argmax(errors[phase]))
    return f"interval {k + 1} of {len(errors[phase])} in {trajectory.phases[phase].name}"


def _too_coarse(trajectory: Trajectory, errors: list[Vector], accuracy: float) -> OptimizationError:
    worst = max(float(e.max(initial=0.0)) for e in errors)
    return OptimizationError(
        "AC707",
        f"the mesh is still too coarse after all refinements: an error of {worst:.2g} in one interval",
        evidence=[_place(trajectory, errors)],
        help=f"more intervals or refinements, or accuracy={10 * accuracy:g}",
    )


# How far complementarity is relaxed, by the size of what decides a branch, after the first solution at 1.
_RELAXED = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
# The last of these may fail where friction sticks: the optimum of the one before is as good as the mesh.
_ENOUGH = 1e-4
# By how much an answer has to change from one point to the next to be a switch.
_SWITCH = 0.05


def tightened(program: Program, solution: Solution, options: Mapping[str, Any]) -> Solution:
    """The solution with complementarity tightened step by step, each from the last; the tightest that is found."""
    nlp, iterations = program.nlp, solution.iterations
    for relaxed in _RELAXED:
        for number in program.relaxed:
            nlp.lower[number][:] = -relaxed
            nlp.upper[number + 1][:] = relaxed
        nlp.begin = [solution.x]
        found = minimized(nlp, "ipopt", {**options, "mu_init": 0.1 * relaxed})
        iterations += found.iterations
        if not found.success:
            if relaxed < _ENOUGH:
                break
            return replace(found, iterations=iterations)
        solution = found
    return replace(solution, iterations=iterations)


def _of_switches(program: Program, solution: Solution, drift: float) -> list[Vector]:
    """Where a run with the answer goes elsewhere: in intervals with a switch.

    Where there is none the mesh is too coarse for what is smooth, and all intervals have the error.
    """
    marked = [_switched(program, phase, solution) for phase in program.phases]
    if not any(m.any() for m in marked):
        marked = [np.ones_like(m) for m in marked]
    return [np.where(m, drift, 0.0) for m in marked]


def _switched(program: Program, phase: PhaseProgram, solution: Solution) -> NDArray[np.bool_]:
    """Which intervals hold a switch, with those beside."""
    intervals, degree = len(phase.mesh), program.basis.degree
    if not phase.law.answers:
        return np.zeros(intervals, dtype=bool)
    (answers,) = solution.values(phase.answers)
    changed = np.abs(np.diff(answers, axis=1)).max(axis=0) > _SWITCH
    places = np.flatnonzero(changed)
    found = np.zeros(intervals, dtype=bool)
    found[places // degree] = True
    found[(places + 1) // degree] = True
    return found
