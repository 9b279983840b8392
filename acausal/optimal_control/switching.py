"""Branches whose answers the program chooses: complementarity made tighter, and where the answer switches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.errors import AcausalError
from acausal.optimal_control.optimum.optimum import optimum_of
from acausal.optimal_control.optimum.trajectory import Trajectory
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.nlp import Solution, minimized
from acausal.optimal_control.program.radau import PhaseProgram, Program

Vector = NDArray[np.float64]

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


def switching_errors(
    problem: StatedProblem, program: Program, solution: Solution, trajectory: Trajectory
) -> list[Vector]:
    """Where a run with the answer goes elsewhere, by the largest magnitude of a state: in intervals with a switch.

    Where there is none the mesh is too coarse for what is smooth, and all intervals have the error.
    """
    best = optimum_of(problem, program, solution, trajectory, {})
    try:
        worst = max(best.error(best.replay()).values(), default=0.0)
    except AcausalError:
        worst = np.inf  # the run does not get to the end
    marked = [_switched(program, phase, solution) for phase in program.phases]
    if not any(m.any() for m in marked):
        marked = [np.ones_like(m) for m in marked]
    return [np.where(m, worst, 0.0) for m in marked]


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
