"""Eigenvalues along a run, and the states that participate in each mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Complex
from acausal.simulate.step_limit.limit import participation
from acausal.simulate.step_limit.state_matrix import LARGEST_DENSE, StateMatrix
from acausal.study.stability.trajectory import Point, Trajectory

# Smallest participation for which a state is named.
_LEAST_PARTICIPATION = 0.05


@dataclass(frozen=True)
class Mode:
    """An eigenvalue [1/s] at a time [s]; `states` are (name, participation), the largest first."""

    eigenvalue: complex
    t: float
    states: tuple[tuple[str, float], ...]

    @property
    def damping(self) -> float:
        """Damping ratio: 1 for a decay without oscillation, 0 for an undamped one, below 0 for a growing one."""
        size = abs(self.eigenvalue)
        return -self.eigenvalue.real / size if size else 1.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the participating states."""
        return tuple(name for name, _ in self.states)

    @property
    def text(self) -> str:
        """Text of the eigenvalue."""
        v = self.eigenvalue
        # parts below a millionth of the magnitude are rounding errors
        real = 0.0 if abs(v.real) < 1e-6 * abs(v) else v.real
        return f"{real:.4g} 1/s" if abs(v.imag) <= 1e-6 * abs(v) else f"{real:.4g} +- {abs(v.imag):.4g}i 1/s"

    def content(self) -> dict[str, object]:
        """For JSON."""
        return {
            "eigenvalue": [self.eigenvalue.real, self.eigenvalue.imag],
            "t": self.t,
            "damping_ratio": self.damping,
            "time_constant": 1.0 / abs(self.eigenvalue) if self.eigenvalue else None,
            "states": [name for name, _ in self.states],
            "participation": dict(self.states),
        }


@dataclass(frozen=True, eq=False)
class Local:
    """The linearised model at one point."""

    point: Point
    eigenvalues: Complex  # [1/s], the fastest first; all of them, or the fastest of a large system
    # Rate of change of the solution [1/s]: |x''| / |x'|, each state scaled by its range along the run; nan at rest.
    activity: float
    # `regularity`, `orientation`: reciprocal condition and sign of the determinant of the algebraic equations; 1
    # without any.
    regularity: float = 1.0
    orientation: float = 1.0


def along(run: Trajectory) -> tuple[tuple[Local, ...], tuple[float, ...]]:
    """(Linearised models at the points of a run, times [s] of points without one)."""
    n = run.compiled.n_dynamic
    values = np.array([point.x[:n] for point in run.points]).reshape(len(run.points), n)
    moved = np.ptp(values, axis=0)
    moved = np.where(moved > 0.0, moved, 1e-6 * np.maximum(np.abs(values).max(axis=0, initial=0.0), 1e-300))
    found, none = [], []
    for point in run.points:
        matrix = StateMatrix(point.compiled, run.p, run.u)
        modes = matrix.eigenvalues(point.t, point.x, point.z, point.m)
        if modes is None:
            none.append(point.t)
            continue
        first, second = (v / moved for v in matrix.rates(point.t, point.x, point.z, point.m))
        regular = matrix.regularity(point.t, point.x, point.z, point.m)
        size = float(np.linalg.norm(first))
        quiet = not np.isfinite(first).all() or size * run.span < 1e-6
        activity = float("nan") if quiet else float(np.linalg.norm(second)) / size
        found.append(Local(point, modes[np.argsort(-np.abs(modes), kind="stable")], activity, *regular))
    return tuple(found), tuple(none)


def mode(run: Trajectory, local: Local, eigenvalue: complex) -> Mode:
    """The mode of an eigenvalue, with its participating states."""
    point = local.point
    matrix = StateMatrix(point.compiled, run.p, run.u)
    if matrix.size > LARGEST_DENSE:
        return Mode(complex(eigenvalue), point.t, ())
    found = matrix.at(point.t, point.x, point.z, point.m)
    if found is None:
        return Mode(complex(eigenvalue), point.t, ())
    parts = participation(found, eigenvalue)
    order = np.argsort(-parts, kind="stable")
    states = tuple((matrix.names[k], float(parts[k])) for k in order[:6] if parts[k] >= _LEAST_PARTICIPATION)
    return Mode(complex(eigenvalue), point.t, states)
