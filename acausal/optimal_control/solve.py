"""From a problem to its optimum: guess, program, ipopt, and the mesh until IDAS agrees."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from acausal.errors import OptimizationError, UsageError
from acausal.optimal_control.error import interval_errors
from acausal.optimal_control.guess import guessed
from acausal.optimal_control.optimum import optimum_of
from acausal.optimal_control.phases import dynamics_of, verified
from acausal.optimal_control.polynomials import Basis
from acausal.optimal_control.problem import Problem
from acausal.optimal_control.radau import Program, transcribed
from acausal.optimal_control.shooting import Steps
from acausal.optimal_control.trajectory import Trajectory, trajectory_of

if TYPE_CHECKING:
    from acausal.optimal_control.optimum import Optimum

Vector = NDArray[np.float64]

_INFEASIBLE = ("Infeasible_Problem_Detected", "Restoration_Failed")
_UNBOUNDED = "Diverging_Iterates"
# Unknowns are divided by their magnitudes: what grows beyond this has no end.
_DIVERGING = 1e8
# Errors of an interval, by the magnitude of a state, that are worth a note.
_NOTED = 1e-3
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
    steps: Steps | None
    solver: str
    options: Mapping[str, Any]


def solved(problem: Problem, choices: Choices) -> Optimum:
    """See `Problem.solve`."""
    basis = Basis(choices.degree, choices.control) if choices.steps is None else Basis(1, 0)
    _check(problem, basis.degree, basis.control, choices.solver)
    accuracy, refinements = choices.accuracy, choices.refinements
    began = clock.perf_counter()
    guesses = guessed(problem)
    laws = dynamics_of(problem, guesses)
    meshes = [spec.mesh for spec in problem.specs]
    iterations: list[int] = []
    expected = problem.quantities.p
    while True:
        program = transcribed(problem, laws, guesses, meshes, basis, expected, steps=choices.steps)
        built = clock.perf_counter()
        values, count = _run(program, choices)
        finished = clock.perf_counter()
        iterations.append(count)
        trajectory = trajectory_of(problem, program, values)
        verified(problem, laws, trajectory)
        errors = interval_errors(problem, laws, trajectory)
        worst = max((float(e.max()) for e in errors), default=0.0)
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
        "interval_error": worst,
        "notes": (*problem.quantities.begin.notes, *_coarse(trajectory, errors, worst)),
        "build": built - began if len(iterations) == 1 else np.nan,
        "solve": finished - built,
    }
    for note in stats["notes"]:
        _log.warning("%s: %s", problem.compiled.name, note)
    return optimum_of(problem, program, values, trajectory, stats)


def _check(problem: Problem, degree: int, control: int, solver: str) -> None:
    if problem.objective is None:
        raise UsageError("AC053", f"{problem!r} minimizes nothing", help="problem.minimize(problem.duration)")
    if solver not in SOLVERS:
        raise UsageError("AC053", f"there is no solver '{solver}'", help=f"solvers: {', '.join(SOLVERS)}")
    if degree < 1 or degree > 9 or control < 0 or control > degree - 1:
        raise UsageError(
            "AC053",
            f"inputs of degree {control} with {degree} points in an interval",
            help="1 to 9 points, and inputs of a degree below their number",
        )


def _run(program: Program, choices: Choices) -> tuple[Any, int]:
    """The values that the solver finds, and the number of its iterations."""
    opti, name = program.opti, choices.solver
    inner = {"tol": choices.tolerance, **SOLVERS[name], **choices.options}
    # fatrop's own structure of stages has no place for durations and parameters that are decided: none is looked for
    more = {"detect_simple_bounds": True} if name == "ipopt" else {"structure_detection": "none"}
    opti.solver(name, {name: inner, "print_time": False, "show_eval_warnings": False, **more})
    try:
        found = opti.solve()
    except RuntimeError as error:
        status = str(opti.stats().get("return_status", "")) if _ran(opti) else ""
        raise _failure(program, status, error) from None
    return found.value, int(found.stats()["iter_count"])


def _ran(opti: Any) -> bool:
    try:
        opti.stats()
    except RuntimeError:
        return False
    return True


def _failure(program: Program, status: str, error: RuntimeError) -> OptimizationError:
    if status == _UNBOUNDED:
        return OptimizationError(
            "AC702",
            "the objective has no smallest value: ipopt's iterates grow without end",
            evidence=[f"largest: {name}" for name in _largest(program)],
            help="limit what grows: subject_to(name, min=..., max=...), or min and max of the inputs",
        )
    if status in _INFEASIBLE:
        return OptimizationError(
            "AC701",
            "the demands contradict each other, or the model: ipopt finds no point that fulfils all",
            evidence=[*_violated(program), f"they press most: {', '.join(_pressing(program))}"],
            help="relax them, allow more time, or begin elsewhere: problem.guess(...)",
        )
    said = status.replace("_", " ") or (str(error).strip().splitlines() or [""])[-1]
    return OptimizationError(
        "AC703",
        f"ipopt gives up: {said}",
        evidence=_violated(program),
        help="begin nearer to an answer (problem.guess), give magnitudes (nominal=) to variables, or more iterations: "
        'solve(options={"max_iter": 3000})',
    )


def _violated(program: Program) -> list[str]:
    """The demands that the last point violates most, worst first."""
    found = []
    for demand in program.demands:
        values = np.array(program.opti.debug.value(demand.value), dtype=float).ravel()
        c = demand.constraint
        off = np.maximum(np.maximum(c.lower - values, values - c.upper), 0.0) / demand.scale
        if off.size and (off.max() > 1e-6 or not np.isfinite(values).all()):
            k = int(np.argmax(off))
            place = f" in {program.phases[demand.phase].spec.name}" if demand.phase is not None else ""
            found.append((float(off[k]), f"{c.name}{place}: it is {values[k]:.4g}", c.where))
    return [text for _, text, _ in sorted(found, key=lambda item: -item[0])[:4]]


def _pressing(program: Program) -> list[str]:
    """The demands with the largest multipliers at the last point, as their magnitudes count."""
    found: dict[str, float] = {}
    for demand in program.demands:
        duals = np.array(program.opti.debug.value(program.opti.dual(demand.relation)), dtype=float)
        name = demand.constraint.name
        found[name] = max(found.get(name, 0.0), float(np.abs(duals).max(initial=0.0)))
    return sorted(found, key=lambda name: -found[name])[:4]


def _largest(program: Program) -> list[str]:
    """Names of what has grown most, against the guess."""
    found = []
    for phase in program.phases:
        for ports, unknown in zip(program.ports, (phase.x, phase.u), strict=True):
            if not len(ports):
                continue
            values = np.array(program.opti.debug.value(unknown), dtype=float).reshape(len(ports), -1)
            found += [(float(np.abs(v).max()) / p.nominal, p.name) for p, v in zip(ports, values, strict=True)]
        duration = float(program.opti.debug.value(phase.duration))
        found.append((duration, f"duration of {phase.spec.name}"))
    return list(dict.fromkeys(name for _, name in sorted(found, key=lambda item: -item[0])))[:3]


def _coarse(trajectory: Trajectory, errors: list[Vector], worst: float) -> tuple[str, ...]:
    """A note where the mesh is so coarse that the optimum may live on its errors."""
    if worst <= _NOTED:
        return ()
    phase = max(range(len(errors)), key=lambda k: float(errors[k].max(initial=0.0)))
    k = int(np.argmax(errors[phase]))
    where = f"interval {k + 1} of {len(errors[phase])} in {trajectory.phases[phase].name}"
    return (f"the mesh is coarse: IDAS ends {worst:.2g} of a state's magnitude off in {where}; solve(accuracy=1e-4)",)


def _too_coarse(trajectory: Trajectory, errors: list[Vector], accuracy: float) -> OptimizationError:
    worst = max(range(len(errors)), key=lambda k: float(errors[k].max()))
    k = int(np.argmax(errors[worst]))
    return OptimizationError(
        "AC707",
        f"the mesh is still too coarse after all refinements: an error of {errors[worst][k]:.2g} in one interval",
        evidence=[f"interval {k + 1} of {len(errors[worst])} in {trajectory.phases[worst].name}"],
        help=f"more intervals or refinements, or accuracy={10 * accuracy:g}",
    )
