"""Starts that leave states open or say something twice: decided by numbers, not by structure.

Structure matches conditions with states (`analyse/start.py`). It does not see that the voltage and the current of a
resistor are one condition, nor that of two capacitors and a source one voltage follows; and which state is left at its
guess would depend on which variables are states. Here all conditions are satisfied together, the surplus ones too, by
the shortest steps (`nearest.py`). What is then still open is looked for in the null space of their slopes: variables
that could be states keep their guesses as long as these are independent of each other, those with a declared guess
first, then those that are preferred as states, then by name. So the start does not depend on the order in which parts
are declared, nor on the choice of states.
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

_MOST = 400  # unknowns: matrices are dense
_RANK = 1e-9  # smallest singular value that counts, by the largest
_CLEAR, _SOME = 1e-2, 1e-6  # share of a slope that is new beside those chosen: at first, and where too few are
_AT_GUESS = 1e-9
_BEST = 1e-11  # last step to where declared starts are met best
_WEAK = 1e-3  # weight of what has no declared start, where all declared ones are met best
_WIDE = 0.1  # the same where it is asked whether another root is nearer: an angle turned round and round
_MOST_TRIALS = 60
_ROUNDING = 1e-13  # a slope that is left of terms that cancel


@dataclass(frozen=True)
class _Candidate:
    """A variable that could be a state: its column of the trajectories and what it should be."""

    variable: int
    name: str
    column: int
    size: float


@dataclass(frozen=True, eq=False)
class OpenStart:
    """The conditions of one model at its start, in states that none of them gives outright and algebraic variables."""

    places: tuple[int, ...]  # of these states
    scale: Vector  # nominal magnitudes of them, then of z
    is_ambiguous: bool  # whether other states could have been left at their guesses than those that were
    candidates: tuple[_Candidate, ...]
    # `(t, x, z, u, p, m) -> (conditions and equations, slope, candidates, slope)`, dense, slopes by these states and
    # then by z.
    functions: BufferedFunction
    guesses: BufferedFunction  # `(p) -> ` the guesses of the candidates
    # `(t, x, z, u, p, m) -> (misses, slope)`: how far all variables with a declared start are off it, by their nominal
    # magnitudes.
    hints: BufferedFunction

    @classmethod
    def of(cls, compiled: CompiledModel) -> OpenStart | None:
        """Made of a model; None where its start is decided outright, or it is too large."""
        if compiled.solution.structure.invariants:
            # Orientations in a closed loop follow from its joints, up to the length of their quaternions: an entry that
            # keeps its guess of zero takes the others along, to a length of nothing. What is nearest to all does not.
            return None
        start, reduced = compiled.start, compiled.solution.structure.reduced
        places = [k for k, v in enumerate(compiled.state_variables[: -compiled.discretes or None])]
        places = [k for k in places if compiled.state_variables[k] not in start.direct]
        if not (places or start.surplus) or len(places) + len(compiled.algebraic) > _MOST:
            return None
        candidates = _candidates(compiled)
        s = Symbols(compiled)
        unknowns = ca.vertcat(*(s.x[k] for k in places), s.z)
        values = ca.vertcat(*compiled.conditions(*s.inputs), compiled.rhs(*s.inputs)[1])
        led = compiled.observe(*s.inputs)[[c.column for c in candidates]]
        parts = [values, ca.jacobian(values, unknowns), led, ca.jacobian(led, unknowns)]
        functions = ca.Function("open_start", s.inputs, [ca.densify(part) for part in parts])
        p = ca.SX.sym("p", len(compiled.parameters))
        builder = Builder(reduced.pool, ca.SX(0), p, {})
        nodes = [start.guesses.get(c.variable, reduced.pool.zero) for c in candidates]
        guesses = ca.Function("guesses", [p], [ca.densify(ca.vertcat(*builder.lower(nodes), ca.SX(0, 1)))])
        hints = BufferedFunction(_hints(compiled, s, unknowns))
        scale = np.concatenate([compiled.nominal_x[places], compiled.nominal_z])
        ambiguous = _is_ambiguous(compiled, candidates)
        return cls(
            tuple(places), scale, ambiguous, candidates, BufferedFunction(functions), BufferedFunction(guesses), hints
        )

    def misses(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, first: Vector) -> float:
        """Largest distance of a variable from its declared start, by nominal magnitude and the size of that start.

        A state without any may be farther from the state in `first`, where the search began.
        """
        declared = np.abs(self.hints(t, x, z, u, p, m)[0]).max(initial=0.0)
        moved = np.abs(x - first)[list(self.places)] / self.scale[: len(self.places)]
        return float(max(declared, _WIDE * moved.max(initial=0.0)))

    def near(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> tuple[Vector, Vector]:
        """States and algebraic variables with which all declared starts, of whatever variables, are met best."""
        from scipy.optimize import least_squares  # a tenth of a second, which only a start like this has to wait for

        places, first = list(self.places), np.concatenate([x[list(self.places)], z])
        scale = self.scale

        def at(y: Vector) -> tuple[Vector, Vector]:
            here = x.copy()
            here[places] = y[: len(places)] * scale[: len(places)]
            return here, y[len(places) :] * scale[len(places) :]

        def misses(y: Vector) -> Vector:
            return np.concatenate([self.hints(t, *at(y), u, p, m)[0], _WEAK * (y - first / scale)])

        def slope(y: Vector) -> Vector:
            own = self.hints(t, *at(y), u, p, m)[1].reshape(-1, len(y)) * scale
            return np.vstack([own, _WEAK * np.eye(len(y))])

        if not (len(first) and np.isfinite(misses(first / scale)).all() and np.isfinite(slope(first / scale)).all()):
            return x, z
        jac: Any = slope
        found = least_squares(misses, first / scale, jac=jac, max_nfev=_MOST_TRIALS).x
        return at(found) if np.isfinite(found).all() else (x, z)

    def met_best(
        self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: Collection[int]
    ) -> tuple[Vector, Vector, tuple[str, ...]] | None:
        """The same as `solve`, where nothing can keep its guess: all declared starts, of whatever variables, met best.

        Least squares under all conditions, from a point near a solution. None where the declared starts do not decide.
        """
        places, scale = list(self.places), self.scale
        free = [k for k, place in enumerate(self.places) if place not in held]
        free += range(len(places), len(places) + len(z))

        def at(y: Vector) -> tuple[Vector, ...]:
            here = x.copy()
            here[places] = y[: len(places)]
            point = t, here, y[len(places) :], u, p, m
            values, slope, *_ = self.functions(*point)
            misses, by = self.hints(*point)
            slope, by = (part.reshape(-1, len(y))[:, free] * scale[free] for part in (slope, by))
            size = sizes_of(slope)
            return values / size, slope / size[:, None], misses, by

        y, merit = np.concatenate([x[places], z]), np.inf
        if not (free and self.hints(t, x, z, u, p, m)[0].size):
            return None
        for _ in range(_MOST_TRIALS):
            values, slope, misses, by = at(y)
            if not all(np.isfinite(part).all() for part in (values, slope, misses, by)):
                return None
            step = _step(values, slope, misses, by)
            if step is None:
                return None
            merit, size = _merit(values, misses), 1.0
            if np.abs(step).max(initial=0.0) <= _BEST * (1.0 + np.abs(y[free] / scale[free]).max(initial=0.0)):
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
        found[places] = y[: len(places)]
        led = self.functions(t, found, y[len(places) :], u, p, m)[2]
        return found, y[len(places) :], tuple(f"{c.name} = {led[k]:g}" for k, c in enumerate(self.candidates))

    def solve(
        self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: Collection[int]
    ) -> tuple[Vector, Vector, tuple[str, ...]] | None:
        """States, algebraic variables, and the names of what keeps its guess; from a point near a solution.

        None where no point satisfies all conditions, or where something is open that is no state.
        """
        free = [k for k, place in enumerate(self.places) if place not in held]
        free += range(len(self.places), len(self.places) + len(z))
        places = list(self.places)
        scale = self.scale

        def parts(y: Vector) -> list[Vector]:
            here = x.copy()
            here[places] = y[: len(places)]
            values, slope, led, led_slope = self.functions(t, here, y[len(places) :], u, p, m)
            n = len(y)
            return [values, slope.reshape(len(values), n), led, led_slope.reshape(len(led), n)]

        def conditions(y: Vector) -> tuple[Vector, Vector]:
            values, slope, *_ = parts(y)
            return values, slope

        y = shortest(conditions, np.concatenate([x[places], z]), free, scale[free])
        if y is None:
            return None
        _, slope, led, led_slope = parts(y)
        chosen = self._chosen(slope[:, free] * scale[free], led_slope[:, free] * scale[free])
        if chosen is None:
            return None
        wanted = self.guesses(p)[0]
        sizes = np.array([c.size for c in self.candidates])
        off = np.abs(led - wanted)[chosen] > _AT_GUESS * (sizes + np.abs(wanted))[chosen]
        if off.any():

            def all_conditions(y: Vector) -> tuple[Vector, Vector]:
                values, slope, led, led_slope = parts(y)
                return np.concatenate([values, (led - wanted)[chosen]]), np.vstack([slope, led_slope[chosen]])

            y = shortest(all_conditions, y, free, scale[free])
            if y is None:
                return None
        found = x.copy()
        found[places] = y[: len(places)]
        names = tuple(f"{self.candidates[k].name} = {wanted[k]:g}" for k in chosen)
        return found, y[len(places) :], names

    def _chosen(self, slope: Vector, led: Vector) -> list[int] | None:
        """Candidates that together move with everything that the conditions leave open."""
        length = np.linalg.norm(slope, axis=1)
        size = np.where(length > _ROUNDING * min(1.0, length.max(initial=0.0)), length, 1.0)[:, None]
        if not (np.isfinite(slope).all() and np.isfinite(led).all()):
            return None
        count = slope.shape[1]
        values, ways = np.zeros(0), np.eye(count)
        if len(slope):
            _, values, ways = np.linalg.svd(slope / size)
        rank = int(np.count_nonzero(values > _RANK * max(values.max(initial=0.0), 1.0)))
        null = ways[rank:]
        moved = led @ null.T / np.array([[c.size] for c in self.candidates]).reshape(-1, 1)
        found: list[int] = []
        basis = np.zeros((0, len(null)))
        for least in (_CLEAR, _SOME):
            for k, row in enumerate(moved):
                moving = float(np.linalg.norm(row))
                if len(found) == len(null) or k in found or moving <= _SOME:
                    continue
                new = row - basis.T @ (basis @ row)
                if np.linalg.norm(new) > least * moving:
                    found.append(k)
                    basis = np.vstack([basis, new / np.linalg.norm(new)])
        return sorted(found) if len(found) == len(null) else None


def _step(values: Vector, slope: Vector, misses: Vector, by: Vector) -> Vector | None:
    """The Gauss-Newton step that meets conditions and, of what they leave open, declared starts; else None."""
    own, sizes, ways = np.linalg.svd(slope)
    rank = int(np.count_nonzero(sizes > _RANK * max(sizes.max(initial=0.0), 1.0)))
    step = ways[:rank].T @ (own[:, :rank].T @ -values / sizes[:rank])
    null = ways[rank:].T
    found, _, left, _ = np.linalg.lstsq(by @ null, -(misses + by @ step), rcond=_SOME)
    return step + null @ found if left == null.shape[1] else None


def _merit(values: Vector, misses: Vector) -> float:
    return float(misses @ misses + 10.0 * np.abs(values).sum())


def _is_ambiguous(compiled: CompiledModel, candidates: Iterable[_Candidate]) -> bool:
    start, states = compiled.start, set(compiled.state_variables)
    if not start.defaulted:
        return False
    prefer = preference(compiled.solution.structure.reduced)
    least = min(prefer(v) for v in start.defaulted)
    others = [c.variable for c in candidates if c.variable not in states]
    return bool(start.conditions) or any(v in start.guesses or prefer(v) >= least for v in others)


def _hints(compiled: CompiledModel, s: Symbols, unknowns: Any) -> Any:
    reduced = compiled.solution.structure.reduced
    column = {node: k for k, node in enumerate(compiled.columns)}
    nodes = {v: node for v, node in compiled.start.guesses.items() if reduced.pool.var(v) in column}
    wanted = ca.vertcat(*Builder(reduced.pool, ca.SX(0), s.p, {}).lower(list(nodes.values())), ca.SX(0, 1))
    sizes = ca.DM([abs(nominal(reduced, v)) or 1.0 for v in nodes])
    columns = compiled.observe(*s.inputs)[[column[reduced.pool.var(v)] for v in nodes]]
    misses = (columns - wanted) / (sizes + ca.fabs(wanted)) if nodes else ca.SX(0, 1)
    return ca.Function("hints", s.inputs, [ca.densify(misses), ca.densify(ca.jacobian(misses, unknowns))])


def _candidates(compiled: CompiledModel) -> tuple[_Candidate, ...]:
    """In the order in which they keep their guesses."""
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
    """The shortest of a variable's names, of these the first by the alphabet: the same in any order of declaration."""
    names = [reduced.flat.scalar_name(s) for s in reduced.aliases.get(variable, ())]
    return min(names, key=lambda n: (n.count("."), n), default=reduced.name(variable))
