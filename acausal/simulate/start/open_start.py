"""Starts with open states or redundant conditions: decided by numbers and not by structure.

Structure matches conditions with states (`analyse/start.py`). It does not show that the voltage and the current of a
resistor are one condition, nor that one voltage follows from those of two capacitors and a source; and which state
keeps its guess would depend on the choice of states. Here all conditions are satisfied together, redundant ones
included, by the shortest steps (`nearest.py`). The directions that remain open are the null space of their slopes.
Variables that could be states keep their guesses as long as these are independent of each other: those with a declared
guess first, then those that are preferred as states, then by name. So the start depends neither on the order in which
components are declared, nor on the choice of states.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.analyse.analyse import preference
from acausal.analyse.events.state_events import discrete_variables
from acausal.arrays import Vector
from acausal.flatten.reduced import ReducedSystem, nominal
from acausal.lower.build import Builder, Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.start.nearest import shortest, sizes_of

_MOST_UNKNOWNS = 400  # largest number of unknowns, because matrices are dense
_RANK = 1e-9  # smallest singular value that counts, relative to the largest
# Fraction of the slope of a candidate that must be independent of those chosen: at first, and if too few were found.
_CLEARLY_NEW, _LEAST_NEW = 1e-2, 1e-6
_AT_GUESS = 1e-9
_LAST_STEP = 1e-11  # convergence limit for the least deviations from declared starts
# Weight of unknowns without a declared start: in the least deviations, and in the comparison of two roots, where it
# keeps angles from making whole turns.
_WEAK_WEIGHT, _STATE_WEIGHT = 1e-3, 0.1
_MOST_TRIALS = 60
_ROUNDING = 1e-13  # relative size of a slope that remains of terms that cancel


@dataclass(frozen=True)
class _Candidate:
    """A variable that could be a state: its column among the observed variables, and its nominal magnitude."""

    variable: int
    name: str
    column: int
    size: float


@dataclass(frozen=True, eq=False)
class OpenStart:
    """The start conditions of one model, as functions of algebraic variables and of states without a fixed start."""

    indices: tuple[int, ...]  # those of these states
    scale: Vector  # their nominal magnitudes, then those of z
    is_ambiguous: bool  # whether other states might have kept their guesses
    candidates: tuple[_Candidate, ...]
    # `(t, x, z, u, p, m) -> (conditions and equations, slope, candidates, slope)`, dense; slopes are by these states
    # and then by z.
    functions: BufferedFunction
    guesses: BufferedFunction  # `(p) -> guesses of the candidates`
    # `(t, x, z, u, p, m) -> (deviations, slope)`: the differences of all variables from their declared starts, relative
    # to the size of these and the nominal magnitudes.
    deviations: BufferedFunction

    @classmethod
    def of(cls, compiled: CompiledModel) -> OpenStart | None:
        """The conditions of a model; None if all its states have a fixed start, or if it is too large."""
        if compiled.solution.structure.invariants:
            # Orientations in a closed loop follow from its joints, up to the lengths of their quaternions. If one entry
            # kept its guess of zero, the others would follow, to the length zero; the nearest start has no such defect.
            return None
        start, reduced = compiled.start, compiled.solution.structure.reduced
        indices = [k for k, v in enumerate(compiled.state_variables[: -compiled.discretes or None])]
        indices = [k for k in indices if compiled.state_variables[k] not in start.direct]
        if not (indices or start.surplus) or len(indices) + len(compiled.algebraic) > _MOST_UNKNOWNS:
            return None
        candidates = _candidates(compiled)
        s = Symbols(compiled)
        unknowns = ca.vertcat(*(s.x[k] for k in indices), s.z)
        values = ca.vertcat(*compiled.conditions(*s.inputs), compiled.rhs(*s.inputs)[1])
        tracked = compiled.observe(*s.inputs)[[c.column for c in candidates]]
        parts = [values, ca.jacobian(values, unknowns), tracked, ca.jacobian(tracked, unknowns)]
        functions = ca.Function("open_start", s.inputs, [ca.densify(part) for part in parts])
        p = ca.SX.sym("p", len(compiled.parameters))
        builder = Builder(reduced.pool, ca.SX(0), p, {})
        nodes = [start.guesses.get(c.variable, reduced.pool.zero) for c in candidates]
        guesses = ca.Function("guesses", [p], [ca.densify(ca.vertcat(*builder.lower(nodes), ca.SX(0, 1)))])
        deviations_of = BufferedFunction(_deviations(compiled, s, unknowns))
        scale = np.concatenate([compiled.nominal_x[indices], compiled.nominal_z])
        ambiguous = _is_ambiguous(compiled, candidates)
        return cls(
            tuple(indices),
            scale,
            ambiguous,
            candidates,
            BufferedFunction(functions),
            BufferedFunction(guesses),
            deviations_of,
        )

    def largest_deviation(
        self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, first: Vector
    ) -> float:
        """The largest deviation of a variable from its declared start, relative as in `deviations`.

        States count with a smaller weight, by their distance from `first`, where the search began.
        """
        declared = np.abs(self.deviations(t, x, z, u, p, m)[0]).max(initial=0.0)
        moved = np.abs(x - first)[list(self.indices)] / self.scale[: len(self.indices)]
        return float(max(declared, _STATE_WEIGHT * moved.max(initial=0.0)))

    def closest_to_starts(
        self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
    ) -> tuple[Vector, Vector]:
        """States and algebraic variables with the least deviations from all declared starts, conditions aside."""
        from scipy.optimize import least_squares  # an import of 0.1 s, needed only by such starts

        indices, first = list(self.indices), np.concatenate([x[list(self.indices)], z])
        scale = self.scale

        def at(y: Vector) -> tuple[Vector, Vector]:
            here = x.copy()
            here[indices] = y[: len(indices)] * scale[: len(indices)]
            return here, y[len(indices) :] * scale[len(indices) :]

        def deviations(y: Vector) -> Vector:
            return np.concatenate([self.deviations(t, *at(y), u, p, m)[0], _WEAK_WEIGHT * (y - first / scale)])

        def slope(y: Vector) -> Vector:
            declared = self.deviations(t, *at(y), u, p, m)[1].reshape(-1, len(y)) * scale
            return np.vstack([declared, _WEAK_WEIGHT * np.eye(len(y))])

        if not (
            len(first) and np.isfinite(deviations(first / scale)).all() and np.isfinite(slope(first / scale)).all()
        ):
            return x, z
        jac: Any = slope
        found = least_squares(deviations, first / scale, jac=jac, max_nfev=_MOST_TRIALS).x
        return at(found) if np.isfinite(found).all() else (x, z)

    def least_deviations(
        self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: Collection[int]
    ) -> tuple[Vector, Vector, tuple[str, ...]] | None:
        """The same as `solve` if no variable can keep its guess: the least deviations from all declared starts.

        By constrained least squares, from a point near a solution. None if the declared starts do not determine it.
        """
        indices, scale = list(self.indices), self.scale
        free = [k for k, index in enumerate(self.indices) if index not in held]
        free += range(len(indices), len(indices) + len(z))

        def at(y: Vector) -> tuple[Vector, ...]:
            here = x.copy()
            here[indices] = y[: len(indices)]
            point = t, here, y[len(indices) :], u, p, m
            values, slope, *_ = self.functions(*point)
            deviations, deviation_slope = self.deviations(*point)
            slope, deviation_slope = (
                part.reshape(-1, len(y))[:, free] * scale[free] for part in (slope, deviation_slope)
            )
            size = sizes_of(slope)
            return values / size, slope / size[:, None], deviations, deviation_slope

        y, merit = np.concatenate([x[indices], z]), np.inf
        if not (free and self.deviations(t, x, z, u, p, m)[0].size):
            return None
        for _ in range(_MOST_TRIALS):
            values, slope, deviations, deviation_slope = at(y)
            if not all(np.isfinite(part).all() for part in (values, slope, deviations, deviation_slope)):
                return None
            step = _step(values, slope, deviations, deviation_slope)
            if step is None:
                return None
            merit, size = _merit(values, deviations), 1.0
            if np.abs(step).max(initial=0.0) <= _LAST_STEP * (1.0 + np.abs(y[free] / scale[free]).max(initial=0.0)):
                break
            while size > 1e-4:
                trial = y.copy()
                trial[free] += size * scale[free] * step
                tried = at(trial)
                if _merit(tried[0], tried[2]) < merit:
                    break
                size /= 2
            else:
                break
            y = trial
        if not np.abs(at(y)[0]).max(initial=0.0) <= _AT_GUESS:
            return None
        found = x.copy()
        found[indices] = y[: len(indices)]
        tracked = self.functions(t, found, y[len(indices) :], u, p, m)[2]
        return found, y[len(indices) :], tuple(f"{c.name} = {tracked[k]:g}" for k, c in enumerate(self.candidates))

    def solve(
        self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: Collection[int]
    ) -> tuple[Vector, Vector, tuple[str, ...]] | None:
        """States, algebraic variables, and the variables that keep their guesses; from a point near a solution.

        None if no point satisfies all conditions, or if something is open that no candidate determines.
        """
        free = [k for k, index in enumerate(self.indices) if index not in held]
        free += range(len(self.indices), len(self.indices) + len(z))
        indices = list(self.indices)
        scale = self.scale

        def parts(y: Vector) -> list[Vector]:
            here = x.copy()
            here[indices] = y[: len(indices)]
            values, slope, tracked, tracked_slope = self.functions(t, here, y[len(indices) :], u, p, m)
            n = len(y)
            return [values, slope.reshape(len(values), n), tracked, tracked_slope.reshape(len(tracked), n)]

        def conditions(y: Vector) -> tuple[Vector, Vector]:
            values, slope, *_ = parts(y)
            return values, slope

        y = shortest(conditions, np.concatenate([x[indices], z]), free, scale[free])
        if y is None:
            return None
        _, slope, tracked, tracked_slope = parts(y)
        chosen = self._chosen(slope[:, free] * scale[free], tracked_slope[:, free] * scale[free])
        if chosen is None:
            return None
        wanted = self.guesses(p)[0]
        sizes = np.array([c.size for c in self.candidates])
        off = np.abs(tracked - wanted)[chosen] > _AT_GUESS * (sizes + np.abs(wanted))[chosen]
        if off.any():

            def all_conditions(y: Vector) -> tuple[Vector, Vector]:
                values, slope, tracked, tracked_slope = parts(y)
                return np.concatenate([values, (tracked - wanted)[chosen]]), np.vstack([slope, tracked_slope[chosen]])

            y = shortest(all_conditions, y, free, scale[free])
            if y is None:
                return None
        found = x.copy()
        found[indices] = y[: len(indices)]
        names = tuple(f"{self.candidates[k].name} = {wanted[k]:g}" for k in chosen)
        return found, y[len(indices) :], names

    def _chosen(self, slope: Vector, slope_of_candidates: Vector) -> list[int] | None:
        """Candidates that determine together all directions that the conditions leave open; None if they cannot."""
        length = np.linalg.norm(slope, axis=1)
        size = np.where(length > _ROUNDING * min(1.0, length.max(initial=0.0)), length, 1.0)[:, None]
        if not (np.isfinite(slope).all() and np.isfinite(slope_of_candidates).all()):
            return None
        count = slope.shape[1]
        values, directions = np.zeros(0), np.eye(count)
        if len(slope):
            _, values, directions = np.linalg.svd(slope / size)
        rank = int(np.count_nonzero(values > _RANK * max(values.max(initial=0.0), 1.0)))
        null = directions[rank:]
        moved = slope_of_candidates @ null.T / np.array([[c.size] for c in self.candidates]).reshape(-1, 1)
        found: list[int] = []
        basis = np.zeros((0, len(null)))
        for least in (_CLEARLY_NEW, _LEAST_NEW):
            for k, row in enumerate(moved):
                moving = float(np.linalg.norm(row))
                if len(found) == len(null) or k in found or moving <= _LEAST_NEW:
                    continue
                new = row - basis.T @ (basis @ row)
                if np.linalg.norm(new) > least * moving:
                    found.append(k)
                    basis = np.vstack([basis, new / np.linalg.norm(new)])
        return sorted(found) if len(found) == len(null) else None


def _step(values: Vector, slope: Vector, deviations: Vector, deviation_slope: Vector) -> Vector | None:
    """The Gauss-Newton step to the conditions and, in their null space, to the declared starts; None if it is open."""
    left, sizes, directions = np.linalg.svd(slope)
    rank = int(np.count_nonzero(sizes > _RANK * max(sizes.max(initial=0.0), 1.0)))
    step = directions[:rank].T @ (left[:, :rank].T @ -values / sizes[:rank])
    null = directions[rank:].T
    found, _, lstsq_rank, _ = np.linalg.lstsq(
        deviation_slope @ null, -(deviations + deviation_slope @ step), rcond=_LEAST_NEW
    )
    return step + null @ found if lstsq_rank == null.shape[1] else None


def _merit(values: Vector, deviations: Vector) -> float:
    return float(deviations @ deviations + 10.0 * np.abs(values).sum())


def _is_ambiguous(compiled: CompiledModel, candidates: Iterable[_Candidate]) -> bool:
    start, states = compiled.start, set(compiled.state_variables)
    if not start.defaulted:
        return False
    prefer = preference(compiled.solution.structure.reduced)
    least = min(prefer(v) for v in start.defaulted)
    others = [c.variable for c in candidates if c.variable not in states]
    return bool(start.conditions) or any(v in start.guesses or prefer(v) >= least for v in others)


def _deviations(compiled: CompiledModel, s: Symbols, unknowns: Any) -> Any:
    reduced = compiled.solution.structure.reduced
    column = {node: k for k, node in enumerate(compiled.columns)}
    nodes = {v: node for v, node in compiled.start.guesses.items() if reduced.pool.var(v) in column}
    wanted = ca.vertcat(*Builder(reduced.pool, ca.SX(0), s.p, {}).lower(list(nodes.values())), ca.SX(0, 1))
    sizes = ca.DM([abs(nominal(reduced, v)) or 1.0 for v in nodes])
    columns = compiled.observe(*s.inputs)[[column[reduced.pool.var(v)] for v in nodes]]
    deviations = (columns - wanted) / (sizes + ca.fabs(wanted)) if nodes else ca.SX(0, 1)
    return ca.Function("hints", s.inputs, [ca.densify(deviations), ca.densify(ca.jacobian(deviations, unknowns))])


def _candidates(compiled: CompiledModel) -> tuple[_Candidate, ...]:
    """The candidates of a model, in the order in which they keep their guesses."""
    reduced = compiled.solution.structure.reduced
    pool, discrete = reduced.pool, discrete_variables(reduced)
    column = {node: k for k, node in enumerate(compiled.columns)}
    prefer, declared = preference(reduced), compiled.start.guesses
    found = []
    for v in pool.derivative_of:
        if v in discrete or v in reduced.inputs or pool.var(v) not in column:
            continue
        name = first_name(reduced, v)
        key = v not in declared, -prefer(v), name.count("."), name
        found.append((key, _Candidate(v, name, column[pool.var(v)], abs(nominal(reduced, v)) or 1.0)))
    return tuple(c for _, c in sorted(found, key=lambda item: item[0]))


def first_name(reduced: ReducedSystem, variable: int) -> str:
    """The shortest name of a variable, or the first of these in the alphabet; independent of declaration order."""
    names = [reduced.flat.scalar_name(s) for s in reduced.aliases.get(variable, ())]
    return min(names, key=lambda n: (n.count("."), n), default=reduced.name(variable))
