"""Integrals of a solution, interval by interval, for comparison with those of an integrator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.optimal_control.optimum.trajectory import PhaseTrajectory
from acausal.optimal_control.program.nlp import Solution
from acausal.optimal_control.program.points import key
from acausal.optimal_control.program.radau import Program, scalar_values

# Integrals below this fraction of their magnitude where the unknowns are as large as their scales count as zero.
_ZERO = 1e-3


@dataclass(frozen=True, eq=False)
class Integrals:
    """The integrals over one phase.

    `rates`, the function `(t, x, z, u, p) -> integrands`, takes the equations that the phase was solved with. `values`
    are the integrals in the program, and `least` the magnitudes below which they count as zero, shapes (integrals,).
    """

    rates: Any
    values: Vector
    least: Vector

    @property
    def sizes(self) -> Vector:
        """Magnitudes by which an integrator divides the integrals, shape (integrals,)."""
        return np.maximum(np.abs(self.values), self.least)

    def errors(self, phase: PhaseTrajectory, p: Vector, exact: Vector, stepped: bool) -> Vector:
        """Errors of the intervals, shape (intervals,); `exact` are their integrals, shape (intervals, integrals).

        They are relative to the sum of the magnitudes of all intervals. Shooting (`stepped`) knows only the sum over
        the phase, whose error every interval then has.
        """
        if not exact.shape[1]:
            return np.zeros(len(exact))
        size = np.maximum(np.abs(exact).sum(axis=0), self.least)
        if stepped:
            found = np.broadcast_to(np.abs(self.values - exact.sum(axis=0)), exact.shape)
        else:
            found = np.abs([self._interval(phase, p, k) for k in range(len(exact))] - exact)
        return np.asarray(np.max(found / size, axis=1))

    def _interval(self, phase: PhaseTrajectory, p: Vector, k: int) -> Vector:
        """Quadrature of the collocation over interval k, shape (integrals,)."""
        at = phase.basis.points
        times, length = phase.time(k, at), float(np.ptp(phase.time(k, np.array([0.0, 1.0]))))
        x, z, u = phase.interval(k, at)
        columns = [ca.DM(v) if v.size else ca.DM(v.shape[0], len(at)) for v in (times[None, :], x, z, u)]
        rates = np.array(self.rates.map(len(at))(*columns, ca.repmat(ca.DM(p), 1, len(at))))
        return np.asarray(length * rates @ phase.basis.weights)


def integrals_of(program: Program, solution: Solution, daes: Sequence[Any]) -> list[Integrals]:
    """The integrals of each phase; `daes` are the equations `(t, x, z, u, p) -> (ode, alg, y)` of the phases."""
    problem, q = program.problem, program.problem.quantities
    symbols, scalars = scalar_values(program, problem)
    known = [ca.DM(v) for v in solution.values(*scalars)] if scalars else []
    found = []
    for number, dae in enumerate(daes):
        own = [v for v in problem.values if v.kind == "integral" and v.phase == number]
        integrands = ca.Function(
            "integrands", [q.time, *q.symbols, *symbols], [ca.vertcat(*(v.expression for v in own))]
        )
        point = [ca.SX.sym(dae.name_in(k), dae.numel_in(k)) for k in range(5)]
        rates = ca.SX(0, 1)
        if own:
            outputs = ca.vertsplit(dae(*point)[2]) if q.symbols else []
            rates = integrands.expand()(point[0], *outputs, *known)
        expressions = [program.known[key(v.symbol)] for v in own]
        values = solution.values(ca.veccat(*expressions))[0].ravel() if own else np.zeros(0)
        function = ca.Function("rates", point, [ca.densify(rates)])
        found.append(Integrals(function, values, _least(program, expressions, solution.p)))
    return found


def _least(program: Program, expressions: Sequence[Any], p: Vector) -> Vector:
    """Magnitudes below which integrals count as zero, shape (integrals,): an optimum may be a square that vanishes.

    Unknowns are scaled to 1, so values where those near zero are 1 are the magnitudes of the integrals.
    """
    if not expressions:
        return np.zeros(0)
    begin = np.concatenate(program.nlp.begin)
    shown = np.where(np.abs(begin) < 0.5, 1.0, begin)
    seen = np.abs([np.ravel(program.nlp.values([ca.veccat(*expressions)], at, p)) for at in (begin, shown)])
    largest = np.where(np.isfinite(seen), seen, 0.0).max(axis=0)
    return np.asarray(np.where(largest > 0.0, _ZERO * largest, 1.0))
