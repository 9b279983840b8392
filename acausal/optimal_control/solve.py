"""Solution of an optimal-control problem: guess, transcription, ipopt, and mesh refinement, checked by IDAS."""

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
from acausal.optimal_control.guess import initial_guess
from acausal.optimal_control.optimum.arbitrary import arbitrary_note
from acausal.optimal_control.optimum.between import run_integral_error, violation_note
from acausal.optimal_control.optimum.error import interval_errors, replayed
from acausal.optimal_control.optimum.optimum import Optimum, optimum_of
from acausal.optimal_control.optimum.trajectory import Trajectory, trajectory_of
from acausal.optimal_control.phases import bias, check_optimum, dynamics_of, kinks
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.nlp import STATIONARY, Solution, displaced, solve_nlp, stopped_note
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import Dynamics, PhaseProgram, Program, transcribe
from acausal.optimal_control.program.shooting import Steps

_INFEASIBLE = ("Infeasible_Problem_Detected", "Restoration_Failed")
_UNBOUNDED = "Diverging_Iterates"
# Iterates beyond this limit diverge, because unknowns are scaled to 1.
_DIVERGING = 1e8
# A larger error of an interval, relative to the magnitude of a state, is noted.
_NOTED = 1e-3
# If a run deviates by more than this many times the accumulated errors of the intervals and the bias of smoothing, an
# effect between the collocation points has been missed.
_BLIND = 10.0
# A solution that is better by a smaller fraction is the same.
_BETTER = 1e-6
# Distance by which ipopt moves a simulated guess away from limits. Such a guess often reaches them, and unknowns at a
# limit shorten the first steps of all unknowns. A solution on a coarser mesh is not moved.
_INSIDE = {"bound_push": 0.1, "bound_frac": 0.1}
# Largest degree of inputs that the series of an optimum reproduce.
_CUBIC = 3
_log = logging.getLogger(__name__)
SOLVERS: Mapping[str, Mapping[str, Any]] = {
    "ipopt": {"print_level": 0, "sb": "yes", "diverging_iterates_tol": _DIVERGING},
    "fatrop": {"print_level": 0},
}
"""Solvers shipped with CasADi, with their default options."""


@dataclass(frozen=True)
class Choices:
    """Settings of a solution; see `Problem.solve`."""

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


class _Stopwatch:
    """Processor time of the stages of a solution: guess, build, solve, check [s]."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(("guess", "build", "solve", "check"), 0.0)
        self._last = clock.process_time()

    def lap(self, name: str) -> None:
        """Add the time since the last call to a stage."""
        now = clock.process_time()
        self.seconds[name] += now - self._last
        self._last = now


def solve_problem(problem: StatedProblem, choices: Choices) -> Optimum:
    """The optimum of a problem; see `Problem.solve`."""
    basis = Basis(choices.degree, choices.control) if choices.steps is None else Basis(1, 0)
    _check(problem, basis.degree, basis.control, choices)
    problem = problem.opened() if choices.steps is None else problem
    accuracy, refinements = choices.accuracy, choices.refinements
    stopwatch = _Stopwatch()
    guesses = initial_guess(problem)
    stopwatch.lap("guess")
    first_guesses = guesses
    is_relaxed = choices.complementarity
    # for selectors, the "widths" are the magnitudes of the quantities that decide the branches
    smooth = 1.0 if is_relaxed else choices.smooth
    widths = kinks(problem, first_guesses, smooth, often=True) if smooth else []
    laws = dynamics_of(problem, first_guesses, widths, is_relaxed)
    meshes = [spec.mesh for spec in problem.specs]
    iterations: list[int] = []
    expected = problem.quantities.p
    first: Program | None = None
    while True:
        program = transcribe(problem, laws, guesses, meshes, basis, expected, steps=choices.steps)
        # use magnitudes of the first guess: an input or objective whose minimum is zero has none in later guesses
        program.nlp.weight = program.nlp.objective_weight() if first is None else first.nlp.weight
        first = first or program
        stopwatch.lap("build")
        solution = _run(program, choices, guesses is first_guesses)
        stopwatch.lap("solve")
        iterations.append(solution.iterations)
        trajectory = trajectory_of(program, solution)
        wider = _with_new_branches(problem, trajectory, widths, smooth) if smooth else widths
        if wider != widths and len(iterations) <= refinements:
            widths, guesses, expected = wider, trajectory.guesses(), trajectory.p
            laws = dynamics_of(problem, first_guesses, widths, is_relaxed)
            continue
        best = optimum_of(problem, program, solution, trajectory, first.input_sizes)
        errors, drift, is_blind, seen = _errors(problem, program, laws, solution, trajectory, best)
        worst = max((float(e.max()) for e in errors), default=0.0)
        stopwatch.lap("check")
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
        **({} if program.complementarity else {"interval_error": worst}),
        "replay_error": drift,
        "bias": max(smoothing_bias := bias(laws, trajectory)),
        **stopwatch.seconds,
    }
    notes = _switch_note(worst) if program.complementarity else _mesh_note(trajectory, errors, worst, drift, is_blind)
    stats["notes"] = (
        *problem.quantities.begin.notes,
        *stopped_note(solution.status, choices.tolerance),
        *arbitrary_note(program, solution),
        *notes,
        *seen,
        *(_smoothing_note(widths, smoothing_bias) if choices.smooth else ()),
    )
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
) -> tuple[list[Vector], float, bool, tuple[str, ...]]:
    """(Errors of the intervals of each phase, error of the replay, whether the points miss its cause, notes).

    Each array of errors has shape (intervals,).
    """
    if not program.complementarity:
        check_optimum(problem, laws, trajectory)
    replay = replayed(best, [len(phase.mesh) for phase in program.phases])
    drift, run = replay.drift, replay.run
    notes = (*replay.notes, *violation_note(program, solution, trajectory, best, run))
    if program.complementarity:
        off = run_integral_error(program, laws, solution, trajectory, run) if run is not None else drift
        return _switch_errors(program, solution, max(drift, off)), drift, False, notes
    errors, accumulated = interval_errors(program, laws, solution, trajectory)
    if run is None:
        worst = max((float(e.max(initial=0.0)) for e in errors), default=0.0)
        notes += (
            f"a run with these inputs fails ({replay.failure}), so that only intervals are checked: IDAS deviates by "
            f"{worst:.2g} of the magnitude of a state or an integral in one; more intervals, or another guess",
        )
    is_blind = drift > max(_BLIND * max(accumulated, bias(laws, trajectory)[0]), _NOTED)
    if is_blind:
        errors = [np.maximum(*pair) for pair in zip(errors, replay.increases, strict=True)]
    return errors, drift, is_blind, notes


def _with_new_branches(
    problem: StatedProblem, trajectory: Trajectory, widths: list[Widths], smooth: float
) -> list[Widths]:
    """Widths of the smoothed branches, and of those that the solution takes both ways."""
    found = kinks(problem, trajectory.guesses(), smooth)
    return [{**new, **known} for new, known in zip(found, widths, strict=True)]


def _smoothing_note(widths: list[Widths], deviations: tuple[float, float]) -> tuple[str, ...]:
    """A note on the bias of smoothing."""
    count = sum(map(len, widths))
    if not count:
        return ()
    of_states, of_others = deviations
    others = f", and other variables of the problem by up to {of_others:.2g}" if of_others > of_states else ""
    return (f"{count} kinks are rounded, which changes states by up to {of_states:.2g} of their magnitude{others}",)


def _switch_note(worst: float) -> tuple[str, ...]:
    """A note if a run with the solution deviates from it."""
    if worst <= 10 * _NOTED:
        return ()
    return (
        f"switches lie within intervals: a run with these inputs deviates by {worst:.2g} of the magnitude of a state "
        "or an integral; solve(accuracy=1e-2)",
    )


def _check(problem: StatedProblem, degree: int, control: int, choices: Choices) -> None:
    """AC053 for invalid settings."""
    solver, smooth = choices.solver, choices.smooth
    if choices.complementarity and (smooth or choices.steps is not None or solver != "ipopt"):
        raise UsageError(
            "AC053",
            "complementarity requires collocation and ipopt, and excludes smoothing",
            help="leave out smooth=, shooting= and solver=",
        )
    if problem.objective is None:
        raise UsageError("AC053", f"{problem!r} has no objective", help="problem.minimize(problem.duration)")
    if solver not in SOLVERS:
        raise UsageError("AC053", f"there is no solver '{solver}'", help=f"solvers: {', '.join(SOLVERS)}")
    if not 0.0 <= smooth < 1.0:
        raise UsageError("AC053", f"kinks are not rounded by {smooth:g}", help="give a fraction: smooth=1e-3")
    if degree < 1 or degree > 9 or control < 0 or control > degree - 1:
        raise UsageError(
            "AC053",
            f"inputs of degree {control} with {degree} points in an interval",
            help="use 1 to 9 points, and inputs of a degree below their number",
        )
    if control > _CUBIC:
        raise UsageError(
            "AC053",
            f"inputs of degree {control}: results hold inputs as cubic splines, which a run would follow",
            help=f"use inputs of degree {_CUBIC} at most, and more intervals: problem.phase(intervals=...)",
        )


def _run(program: Program, choices: Choices, first: bool) -> Solution:
    """Solution of the program; `first` if the guess is a simulation of the model. AC701 to AC703 if there is none."""
    name = choices.solver
    options = {"tol": choices.tolerance, **SOLVERS[name], **choices.options}
    found = solve_nlp(program.nlp, name, {**(_INSIDE if first and name == "ipopt" else {}), **options})
    if found.success and not found.is_curved and not program.complementarity:
        found = _from_beside(program, found, name, options)
    if found.success and program.complementarity:
        found = tighten(program, found, options)
    if not found.success:
        raise _failure(program, found, name)
    return found


def _from_beside(program: Program, solution: Solution, solver: str, options: Mapping[str, Any]) -> Solution:
    """The solution found from beside a stationary point if it is better, or none is the best; else the point itself."""
    program.nlp.begin = [displaced(solution.x)]
    found = solve_nlp(program.nlp, solver, options)
    if not found.success and found.status != _UNBOUNDED:
        return replace(solution, status=STATIONARY)
    is_better = found.objective < solution.objective - _BETTER * abs(solution.objective)
    return replace(found, iterations=solution.iterations + found.iterations) if is_better else solution


def _failure(program: Program, solution: Solution, solver: str) -> OptimizationError:
    """The error AC701, AC702 or AC703 of a failed solution, with the constraints involved."""
    status = solution.status
    if status == _UNBOUNDED:
        return OptimizationError(
            "AC702",
            "the objective has no minimum: ipopt's iterates grow without bound",
            evidence=[f"largest: {name}" for name in _largest_unknowns(program, solution)],
            help="limit what grows: subject_to(name, min=..., max=...), or min and max of the inputs",
        )
    if status in _INFEASIBLE:
        return OptimizationError(
            "AC701",
            "the constraints contradict each other, or the model: ipopt finds no point that satisfies all",
            evidence=[
                *_most_violated(program, solution),
                f"largest multipliers: {', '.join(_largest_multipliers(program, solution))}",
            ],
            help="relax them, allow more time, or start from another guess: problem.guess(...)",
        )
    return OptimizationError(
        "AC703",
        f"{solver} fails: {status.replace('_', ' ')}",
        evidence=_most_violated(program, solution),
        help="give a guess closer to the solution (problem.guess), magnitudes (nominal=) of variables, or more "
        'iterations: solve(options={"max_iter": 3000}); round kinks of where, maximum and the like: solve(smooth=1e-3)',
    )


def _most_violated(program: Program, solution: Solution) -> list[str]:
    """The four constraints most violated at the last iterate."""
    found = []
    for entry in program.constraints:
        values = solution.g[entry.rows.start : entry.rows.stop] * entry.scale
        c = entry.constraint
        violation = np.maximum(np.maximum(c.lower - values, values - c.upper), 0.0) / entry.scale
        if violation.size and (violation.max() > 1e-6 or not np.isfinite(values).all()):
            k = int(np.argmax(violation))
            phase = f" in {program.phases[entry.phase].spec.name}" if entry.phase is not None else ""
            found.append((float(violation[k]), f"{c.name}{phase}: it is {values[k]:.4g}", c.where))
    return [text for _, text, _ in sorted(found, key=lambda item: -item[0])[:4]]


def _largest_multipliers(program: Program, solution: Solution) -> list[str]:
    """The four constraints with the largest scaled multipliers at the last iterate."""
    found: dict[str, float] = {}
    for entry in program.constraints:
        duals, name = solution.duals[entry.rows.start : entry.rows.stop], entry.constraint.name
        found[name] = max(found.get(name, 0.0), float(np.abs(duals).max(initial=0.0)))
    return sorted(found, key=lambda name: -found[name])[:4]


def _largest_unknowns(program: Program, solution: Solution) -> list[str]:
    """Names of the three unknowns with the largest scaled values."""
    found = []
    for phase in program.phases:
        x, u, duration = solution.values(phase.x, phase.u, phase.duration)
        for ports, values in zip(program.ports, (x, u), strict=True):
            rows = values.reshape(len(ports), -1) if len(ports) else values
            found += [(float(np.abs(v).max()) / p.nominal, p.name) for p, v in zip(ports, rows, strict=True)]
        found.append((duration.item(), f"duration of {phase.spec.name}"))
    return list(dict.fromkeys(name for _, name in sorted(found, key=lambda item: -item[0])))[:3]


def _mesh_note(
    trajectory: Trajectory, errors: list[Vector], worst: float, drift: float, is_blind: bool
) -> tuple[str, ...]:
    """A note if the optimum may exploit the errors of a coarse mesh, or if a run deviates from the solution."""
    if not np.isfinite(drift):
        return ()  # it fails, which has been noted
    if is_blind:
        return (
            "the points of the mesh miss an effect between them: a run with these inputs deviates by "
            f"{drift:.2g} of a state's magnitude from {_worst_interval(trajectory, errors)} on; "
            "solve(accuracy=1e-3), or more intervals there",
        )
    if worst <= _NOTED and drift <= 10 * _NOTED:
        return ()
    if worst <= _NOTED:
        enough = 10.0 ** np.floor(np.log10(max(worst * min(10 * _NOTED / drift, 1.0), 1e-9)))
        return (
            f"errors grow along the motion: at most {worst:.2g} of a state's magnitude in one interval, but a run with "
            f"these inputs deviates by {drift:.2g}; solve(accuracy={enough:g}), or follow it with a controller",
        )
    where = _worst_interval(trajectory, errors)
    return (
        f"the mesh is coarse: IDAS deviates by {worst:.2g} of the magnitude of a state or an integral in {where}; "
        "solve(accuracy=1e-4)",
    )


def _worst_interval(trajectory: Trajectory, errors: list[Vector]) -> str:
    """Text of the interval with the largest error."""
    phase = max(range(len(errors)), key=lambda k: float(errors[k].max(initial=0.0)))
    k = int(np.argmax(errors[phase]))
    return f"interval {k + 1} of {len(errors[phase])} in {trajectory.phases[phase].name}"


def _too_coarse(trajectory: Trajectory, errors: list[Vector], accuracy: float) -> OptimizationError:
    """The error AC707."""
    worst = max(float(e.max(initial=0.0)) for e in errors)
    return OptimizationError(
        "AC707",
        f"the mesh is still too coarse after all refinements: an error of {worst:.2g} in one interval",
        evidence=[_worst_interval(trajectory, errors)],
        help=f"more intervals or refinements, or accuracy={10 * accuracy:g}",
    )


# Relaxations of the scaled complementarity conditions after the first solution, whose relaxation is 1.
_RELAXATIONS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
# Smaller relaxations may fail where friction sticks; the last optimum is then as accurate as the mesh.
_SMALL_ENOUGH = 1e-4
# A larger change of a selector from one point to the next counts as a switch.
_SWITCH = 0.05


def tighten(program: Program, solution: Solution, options: Mapping[str, Any]) -> Solution:
    """The solution with the smallest feasible relaxation of the complementarity conditions (homotopy)."""
    nlp, iterations = program.nlp, solution.iterations
    for relaxed in _RELAXATIONS:
        for number in program.complementarity:
            nlp.lower[number][:] = -relaxed
            nlp.upper[number + 1][:] = relaxed
        nlp.begin = [solution.x]
        found = solve_nlp(nlp, "ipopt", {**options, "mu_init": 0.1 * relaxed})
        iterations += found.iterations
        if not found.success:
            if relaxed < _SMALL_ENOUGH:
                break
            return replace(found, iterations=iterations)
        solution = found
    return replace(solution, iterations=iterations)


def _switch_errors(program: Program, solution: Solution, drift: float) -> list[Vector]:
    """The error of the replay, assigned to the intervals with a switch, for each phase of shape (intervals,).

    Without a switch the mesh is too coarse for the smooth motion, and the error is assigned to all intervals.
    """
    marked = [_switch_intervals(program, phase, solution) for phase in program.phases]
    if not any(m.any() for m in marked):
        marked = [np.ones_like(m) for m in marked]
    return [np.where(m, drift, 0.0) for m in marked]


def _switch_intervals(program: Program, phase: PhaseProgram, solution: Solution) -> NDArray[np.bool_]:
    """Mask of the intervals next to a change of a selector, shape (intervals,)."""
    intervals, degree = len(phase.mesh), program.basis.degree
    if not phase.law.selectors:
        return np.zeros(intervals, dtype=bool)
    (selectors,) = solution.values(phase.selectors)
    changed = np.abs(np.diff(selectors, axis=1)).max(axis=0) > _SWITCH
    places = np.flatnonzero(changed)
    found = np.zeros(intervals, dtype=bool)
    found[places // degree] = True
    found[(places + 1) // degree] = True
    return found
