"""Numerical solution of a problem: the polynomials of all phases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.optimal_control.declare import Mesh
from acausal.optimal_control.guess import PhaseGuess
from acausal.optimal_control.program.nlp import Solution
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import Program


@dataclass(frozen=True, eq=False)
class PhaseTrajectory:
    """Solution of one phase with n collocation points.

    `begin` and `duration` are in s. `x`, shape (nx, n + 1), are the states at the start and the points, `z`, shape
    (nz, n), the algebraic variables at the points, and `u`, shape (nu, intervals * (control + 1)), the Bernstein
    coefficients of the inputs.
    """

    name: str
    basis: Basis
    mesh: Mesh
    begin: float
    duration: float
    x: Vector
    z: Vector
    u: Vector

    @property
    def borders(self) -> Vector:
        """Ends of the intervals as fractions of the phase, shape (intervals + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.mesh.fractions)[:-1], [1.0]])

    def interval(self, k: int, at: Vector) -> tuple[Vector, Vector, Vector]:
        """x, z, u at m positions `at` in [0, 1] of interval k, shapes (nx, m), (nz, m), (nu, m)."""
        d, q = self.basis.degree, self.basis.control + 1
        x = self.x[:, k * d : (k + 1) * d + 1] @ self.basis.of_states(at)
        z = self.z[:, k * d : (k + 1) * d] @ self.basis.of_algebraic(at)
        u = self.u[:, k * q : (k + 1) * q] @ self.basis.bernstein(at)
        return x, z, u

    def time(self, k: int, at: Vector) -> Vector:
        """Times [s] of m positions `at` in [0, 1] of interval k, shape (m,)."""
        borders = self.borders
        return np.asarray(self.begin + self.duration * (borders[k] + (borders[k + 1] - borders[k]) * at))

    def at(self, fractions: Vector) -> tuple[Vector, Vector, Vector]:
        """x, z, u at m fractions of the phase, shapes (nx, m), (nz, m), (nu, m).

        At the border of two intervals, the values are those of the later one.
        """
        borders = self.borders
        number = np.clip(np.searchsorted(borders, fractions, side="right") - 1, 0, len(self.mesh) - 1)
        x, z, u = (np.empty((len(v), len(fractions))) for v in (self.x, self.z, self.u))
        for k in np.unique(number).tolist():
            own = number == k
            local = (fractions[own] - borders[k]) / (borders[k + 1] - borders[k])
            x[:, own], z[:, own], u[:, own] = self.interval(k, local)
        return x, z, u


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Solution of all phases, and the parameters of the model, shape (np,)."""

    phases: list[PhaseTrajectory]
    p: Vector

    def guesses(self) -> list[PhaseGuess]:
        """The solution as a guess for other meshes."""
        return [PhaseGuess(phase.duration, phase.at) for phase in self.phases]


def trajectory_of(program: Program, solution: Solution) -> Trajectory:
    """Trajectory from the solution of the program."""
    wanted = [v for phase in program.phases for v in (phase.begin, phase.duration, phase.x, phase.z, phase.u)]
    found = iter(solution.values(*wanted, program.p))
    phases = []
    for phase in program.phases:
        begin, duration, x, z, u = (next(found) for _ in range(5))
        phases.append(
            PhaseTrajectory(phase.spec.name, program.basis, phase.mesh, begin.item(), duration.item(), x, z, u)
        )
    p = next(found).reshape(-1)
    for place, lower, upper, _ in program.problem.quantities.decided:
        p[place] = np.clip(p[place], lower, upper)  # solvers exceed limits by their tolerance, which a run refuses
    return Trajectory(phases, p)
