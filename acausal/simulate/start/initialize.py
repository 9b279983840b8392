"""Consistent start values: a separate problem, solved before any integrator is created."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from acausal.analyse.blocks.solve import solve
from acausal.arrays import Vector
from acausal.diagnose.words import listed, made_at
from acausal.errors import AcausalError, InitializationError, counted
from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.function_cache import functions_of, truths
from acausal.simulate.equations.shares import Shares
from acausal.simulate.record.project import constraints
from acausal.simulate.start.errors import (
    contradicting,
    left_open,
    not_found,
    off_constraint,
    start_not_finite,
    undefined,
)
from acausal.simulate.start.finite import UNDEFINED, first_undefined
from acausal.simulate.start.nearest import nearest_start, unreachable

_MOST_BLOCKS = 200
_LARGEST_RANK = 200
# Newton steps before the robust methods are tried, at the start and at events, after which they often fail.
_MOST_STEPS, _MOST_STEPS_AT_EVENT = 30, 8
# The largest error of stabilised constraints at the start, relative to the sizes of their terms.
_ON_CONSTRAINTS = 1e-7
# The largest residual of a condition; and the relative deviation from a guess beyond which another root is looked for.
_SATISFIED, _FAR = 1e-7, 0.1


@dataclass(frozen=True, eq=False)
class Start:
    """A consistent point: states, algebraic variables, and notes on what was chosen."""

    x: Vector
    z: Vector
    notes: tuple[str, ...]


def initialize(compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector) -> Start:
    """Solve the start conditions together with the algebraic equations.

    Modes of relations of variables, which are written into `m`, and discrete variables are determined as well.

    Raises InitializationError: AC301 if Newton's method and continuation both fail; AC304 if that is because conditions
    are redundant; AC302 if conditions contradict each other, or no state satisfies them and all constraints; AC303 if
    the equations are undefined at the start (division by zero, root of a negative number).
    """
    start = _with_relations(compiled, t, p, u, m) if compiled.state_events else _initialized(compiled, t, p, u, m, {})
    _check_surplus(compiled, t, start.x, start.z, u, p, m)
    _check_constraints(compiled, t, start.x, start.z, u, p, m)
    return start


def _with_relations(compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector) -> Start:
    """The start together with relations and discrete equations, by fixed-point iteration."""
    x, z = functions_of(compiled).guess(p)
    events, nodes = compiled.state_events, compiled.solution.structure.reduced.pool.nodes
    memories = compiled.n_timely + len(events.samples)
    flags = memories + len(events.memories)
    relations = flags + len(events.flags)
    reactions = functions_of(compiled).reactions
    m[memories:flags] = reactions(t, x, z, u, p, m)[4]
    m[flags:relations] = [float(nodes[n][0] == "initial") for n in events.flags]
    m[relations:] = truths(compiled, t, x, z, u, p, m)
    assigned_states = [a.position for a in events.assignments]
    assigned: dict[int, float] = {k: x[k] for k in assigned_states}
    seen: set[bytes] = set()
    start = Start(x, z, ())
    shares = functions_of(compiled).shares
    while (key := m.tobytes() + np.array(list(assigned.values())).tobytes()) not in seen:
        seen.add(key)
        solved = m if shares is None else _with_creep(shares, t, start, p, u, m, assigned)
        start = _initialized(compiled, t, p, u, solved, assigned)
        m[relations:] = truths(compiled, t, start.x, start.z, u, p, m)
        assigned = dict(zip(assigned_states, reactions(t, start.x, start.z, u, p, m)[1], strict=True))
    m[flags:relations] = 0.0
    return start if shares is None else _without_creep(compiled, shares, t, start, p, u, m, assigned)


def _with_creep(
    shares: Shares, t: float, start: Start, p: Vector, u: Vector, m: Vector, assigned: dict[int, float]
) -> Vector:
    """Modes with which friction elements creep, because the first guess, that all of them stick, may contradict."""
    x, m = start.x.copy(), m.copy()
    x[list(assigned)] = list(assigned.values())
    m[shares.place] = shares.creep(t, x, start.z, u, p, m)
    return m


def _without_creep(
    compiled: CompiledModel,
    shares: Shares,
    t: float,
    start: Start,
    p: Vector,
    u: Vector,
    m: Vector,
    assigned: dict[int, float],
) -> Start:
    """The start without creep, solved again if it affects states; algebraic variables are solved for later anyway."""
    if not _free(compiled):
        return start
    x = start.x.copy()
    x[list(assigned)] = list(assigned.values())
    border = shares.border(compiled, t, x, start.z, u, p, m)
    return _initialized(compiled if border is None else border.compiled, t, p, u, m, assigned)


def _free(compiled: CompiledModel) -> list[int]:
    """Indices of the states for which the start conditions are solved."""
    known = {*compiled.start.direct, *compiled.start.defaulted}
    return [k for k, v in enumerate(compiled.state_variables) if v not in known]


def _initialized(
    compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector, assigned: dict[int, float]
) -> Start:
    x, z = functions_of(compiled).guess(p)
    x[list(assigned)] = list(assigned.values())
    guess = x, z
    free = _free(compiled)
    notes = _defaulted(compiled, x)
    failure: InitializationError | None = None
    is_doubtful = False
    if free or len(z):
        newton = functions_of(compiled).newton(tuple(free))
        found = None if newton is None else newton.solve(t, x, z, u, p, m, _MOST_STEPS)
        if found is None:
            is_doubtful = bool(free)
            _check_defined(compiled, t, x, z, u, p, m)
            try:
                found = _robustly(compiled, t, x, z, u, p, m, free, assigned)
            except InitializationError as error:
                failure, is_doubtful = error, True
        if found is not None:
            x, z = found
    left = _left_open(compiled, t, x, z, u, p, m, free) if failure is None else ()
    open_start = _by_numbers(compiled, t, guess, (x, z), u, p, m, set(assigned), is_doubtful or bool(left))
    if open_start is not None:
        return replace(open_start, notes=left) if left else open_start
    if failure is not None or _is_violated(compiled, t, x, z, u, p, m):
        # Newton's method may have found a root that is excluded by a condition outside its system
        start = _nearest(compiled, t, *guess, u, p, m, set(assigned)) if failure is None else None
        start = start or _nearest(compiled, t, x, z, u, p, m, set(assigned))
        if start is None and failure is not None:
            raise failure
        if start is not None:
            return start
    _check_defined(compiled, t, x, z, u, p, m)
    return Start(x, z, notes + left)


def _by_numbers(
    compiled: CompiledModel,
    t: float,
    guess: tuple[Vector, Vector],
    reached: tuple[Vector, Vector],
    u: Vector,
    p: Vector,
    m: Vector,
    held: set[int],
    is_doubtful: bool,
) -> Start | None:
    """The start in which all conditions hold and open variables keep their guesses, in any order of declaration.

    None if the start that structure has found stands, or if none is found here either.

    `is_doubtful`: Whether structure has found no start, only one by robust methods, or one of many.
    """
    if not (is_doubtful or compiled.start.defaulted or compiled.start.conditions or compiled.start.surplus):
        return None
    open_start = functions_of(compiled).open_start
    if open_start is None:
        return None
    numbers = u, p, m
    deviation = open_start.largest_deviation(t, *reached, *numbers, guess[0])
    is_doubtful = is_doubtful or open_start.is_ambiguous or _is_violated(compiled, t, *reached, *numbers)
    found = open_start.solve(t, *reached, *numbers, held) if is_doubtful else None
    if (found is None and is_doubtful) or deviation > _FAR:
        other = open_start.solve(t, *open_start.closest_to_starts(t, *guess, *numbers), *numbers, held)
        if other is not None:
            is_nearer = open_start.largest_deviation(t, *other[:2], *numbers, guess[0]) < 0.5 * deviation
            found = other if is_nearer or (is_doubtful and found is None) else found
    if found is None and is_doubtful:
        found = open_start.least_deviations(t, *open_start.closest_to_starts(t, *guess, *numbers), *numbers, held)
    if found is None:
        return None
    x, z, names = found
    _check_defined(compiled, t, x, z, u, p, m)
    count = counted(len(names), "start value")
    note = (
        f"{count} not given; taken: {', '.join(names[:6])}{' ...' if len(names) > 6 else ''}  (say so with fixed(...))"
    )
    return Start(x, z, (note,) if names else ())


def _is_violated(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> bool:
    """Whether a condition is violated, which structure took for redundant or Newton's method did not satisfy."""
    if not (compiled.start.conditions or compiled.start.surplus):
        return False
    residuals = functions_of(compiled).conditions(t, x, z, u, p, m)
    return any(np.abs(part).max(initial=0.0) > _SATISFIED for part in residuals)


def _nearest(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: set[int]
) -> Start | None:
    """The start nearest to the guesses in which all conditions hold.

    None if the conditions leave no state open and are not redundant, or if no such start is found.
    """
    if not (compiled.start.defaulted or compiled.start.surplus):
        return None
    near = nearest_start(compiled, t, x, z, u, p, m, held)
    if near is None:
        return None
    count = counted(len(compiled.start.defaulted), "start value")
    moved = [f"{n} = {v:g}" for n, v, g in zip(compiled.states, near, x, strict=True) if v != g]
    note = f"{count} not given; taken, nearest to the guesses: {listed(moved, 6)}  (say so with fixed(...))"
    notes = (note,) if compiled.start.defaulted else ()
    try:
        return consistent(compiled, t, Start(near, z, notes), p, u, m)
    except InitializationError:
        return None


def _robustly(
    compiled: CompiledModel,
    t: float,
    x: Vector,
    z: Vector,
    u: Vector,
    p: Vector,
    m: Vector,
    free: list[int],
    assigned: dict[int, float],
) -> tuple[Vector, Vector]:
    """States and algebraic variables by more robust methods than Newton's alone."""
    try:
        return _System(compiled, t, x, z, u, p, m, free).solve()
    except InitializationError:
        near = torn_start(compiled, t, p, u, m, partial(_start_values, assigned))
        if near is None:
            raise
        return _System(compiled, t, *near, u, p, m, free).solve()


def _left_open(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, free: list[int]
) -> tuple[str, ...]:
    """A note if the solution is one of many, so that the guesses have decided."""
    newton = functions_of(compiled).newton(tuple(free)) if free else None
    if newton is None or len(newton.scale) > _LARGEST_RANK:
        return ()
    near = 0.01 * newton.scale * np.random.default_rng(3).standard_normal(len(newton.scale))
    beside = x.copy()
    beside[free] += near[: len(free)]
    there = beside, z + near[len(free) :]
    return left_open(compiled, free, [newton.buffered_slope(t, *at, u, p, m)[0] for at in ((x, z), there)])


def _start_values(
    assigned: dict[int, float], compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector
) -> tuple[Vector, Vector]:
    start = _initialized(compiled, t, p, u, m, assigned)
    return start.x, start.z


def consistent(compiled: CompiledModel, t: float, start: Start, p: Vector, u: Vector, m: Vector) -> Start:
    """Solve for the algebraic variables with the states of `start`, as after an event, where conditions do not count.

    Raises InitializationError: AC301, AC302, AC304 if there is no solution.
    """
    if not len(start.z):
        return start
    newton = functions_of(compiled).newton()
    found = None if newton is None else newton.solve(t, start.x, start.z, u, p, m, _MOST_STEPS_AT_EVENT)
    if found is None:
        found = _System(compiled, t, start.x, start.z, u, p, m, []).solve()
    return Start(*found, start.notes)


def _defaulted(compiled: CompiledModel, x: Vector) -> tuple[str, ...]:
    names = [
        f"{compiled.states[k]} = {x[k]:g}"
        for k, v in enumerate(compiled.state_variables)
        if v in compiled.start.defaulted
    ]
    if not names:
        return ()
    return (
        f"{counted(len(names), 'start value')} not given; taken: {', '.join(names[:6])}"
        + (" ..." if len(names) > 6 else "")
        + "  (say so with fixed(...))",
    )


def _remaining_step(matrix: Vector, residual: Vector, y: Vector) -> float:
    """Length of the next Newton step at `y`, relative to its entries; infinite if the matrix is singular."""
    try:
        step = np.linalg.solve(matrix, residual)
    except np.linalg.LinAlgError:
        return np.inf
    length = float(np.max(np.abs(step) / (1.0 + np.abs(y))))
    return length if np.isfinite(length) else np.inf


class _System:
    """The start system; its unknowns are the free states and the algebraic variables in nominal magnitudes."""

    def __init__(
        self, compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, free: list[int]
    ) -> None:
        self.compiled = compiled
        self.x, self.z, self.free = x, z, free
        self.scale = np.concatenate([compiled.nominal_x[free], compiled.nominal_z])
        y = ca.SX.sym("y", len(self.scale))
        scaled = y * ca.DM(self.scale)
        xs = ca.SX(ca.DM(x))
        for k, i in enumerate(free):
            xs[i] = scaled[k]
        arguments = (t, xs, scaled[len(free) :], u, p, m)
        residual = compiled.rhs(*arguments)[1]
        if free or compiled.start.conditions:
            residual = ca.vertcat(compiled.conditions(*arguments)[0], residual) if free else residual
        self.residual = ca.Function("start", [y], [residual], ["y"], ["r"])
        self.symbols = y, residual
        self.arguments = arguments

    def solve(self) -> tuple[Vector, Vector]:
        """Try in turn: Newton for all unknowns, then block by block, the homotopy of the model, and continuation."""
        y0 = np.concatenate([self.x[self.free], self.z]) / self.scale
        found = self._newton(self.residual, y0)
        if found is None:
            found = self._by_blocks(y0)
        if found is None:
            found = self._homotopy(y0)
        if found is None:
            found = self._continuation(y0)
        if found is None:
            raise self._failed(y0)
        values_ = found * self.scale
        x = self.x.copy()
        x[self.free] = values_[: len(self.free)]
        return x, values_[len(self.free) :]

    def _newton(self, residual: Any, y0: Vector) -> Vector | None:
        if residual.numel_out(0) != len(y0):
            return None
        settings = {
            "abstol": 0.0,  # only steps decide, because residuals have units, and picocoulombs are always small
            "abstolStep": 1e-11,
            "max_iter": 400,
            "error_on_fail": False,
            "show_eval_warnings": False,
        }
        try:  # CasADi refuses to create a rootfinder with a structurally singular Jacobian, as of a mass of 0 kg
            found = np.array(ca.rootfinder("start", "newton", residual, settings)(y0)).ravel()
        except RuntimeError:
            return None
        residuals = np.array(residual(found)).ravel()
        sizes_of_residuals = np.abs(residuals)
        is_finite = np.isfinite(found).all() and np.isfinite(sizes_of_residuals).all()
        if not is_finite:
            return None
        matrix = residual.factory("slope", ["y"], ["jac:r:y"])(found)
        # sizes at the guesses, because unknowns that a singular matrix has made huge would excuse any residual
        terms = np.array(ca.fabs(matrix) @ (1.0 + np.abs(y0)) + ca.fabs(residual(y0))).ravel()
        if (sizes_of_residuals <= 1e-8 * np.nan_to_num(terms, nan=1.0)).all():
            return found
        # Large terms that cancel, such as those of a stiff spring over a long distance, leave larger rounding errors.
        return found if _remaining_step(np.array(matrix), residuals, found) <= 1e-10 else None

    def _by_blocks(self, y0: Vector) -> Vector | None:
        """Newton's method on the blocks of the triangular form, one after the other.

        A step of all unknowns together is shortened as the worst of them requires, even if others do not depend on it:
        a rate whose factor passes through zero on the way would prevent a harmless position from being found.
        """
        if self.residual.numel_out(0) != len(y0):
            return None
        count, rows, columns, first_row, first_column, *_ = self.residual.jac_sparsity(0, 0).btf()
        if not 1 < count <= _MOST_BLOCKS:
            return None
        y = y0.copy()
        for k in reversed(range(count)):
            block_rows = rows[first_row[k] : first_row[k + 1]]
            block = columns[first_column[k] : first_column[k + 1]]
            unknowns = ca.SX.sym("y", len(block))
            all_unknowns = ca.SX(ca.DM(y))
            all_unknowns[block] = unknowns
            found = self._newton(
                ca.Function("block", [unknowns], [self.residual(all_unknowns)[block_rows]], ["y"], ["r"]), y[block]
            )
            if found is None:
                return None
            y[block] = found
        return y

    def _homotopy(self, y0: Vector) -> Vector | None:
        """Continuation from the simplified system that the model states by `homotopy(...)` to the actual one."""
        if self.compiled.homotopy is None or self.residual.numel_out(0) != len(y0):
            return None
        y, _ = self.symbols
        s = ca.SX.sym("s")
        used, alg = self.compiled.homotopy(*self.arguments, s)
        moved = ca.Function("moved", [y, s], [ca.vertcat(used, alg) if self.free else alg])
        simplified = self._newton(ca.Function("partial", [y], [moved(y, 0.0)], ["y"], ["r"]), y0)
        return None if simplified is None else self._follow(moved, simplified)

    def _continuation(self, y0: Vector) -> Vector | None:
        """Newton homotopy: F(y) - (1 - s) F(y0) = 0 from s = 0, with the solution y0, to s = 1."""
        start = np.array(self.residual(y0)).ravel()
        if not np.isfinite(start).all() or self.residual.numel_out(0) != len(y0):
            return None
        y, full = self.symbols
        s = ca.SX.sym("s")
        return self._follow(ca.Function("moved", [y, s], [full - (1 - s) * ca.DM(start)]), y0)

    def _follow(self, moved: Any, y0: Vector) -> Vector | None:
        """Follow the solution of `moved(y, s) = 0` from y0 at s = 0 to s = 1, with adaptive steps."""
        y, _ = self.symbols
        here, done, step = y0, 0.0, 0.1
        while done < 1.0 and step > 1e-5:
            target = min(1.0, done + step)
            partial = ca.Function("partial", [y], [moved(y, target)], ["y"], ["r"])
            found = self._newton(partial, here)
            if found is None:
                step /= 4
            else:
                here, done, step = found, target, step * 1.7
        return here if done >= 1.0 else None

    def _failed(self, y0: Vector) -> InitializationError:
        residuals = np.nan_to_num(np.array(self.residual(y0)).ravel(), nan=np.inf)
        slope = self.residual.factory("slope", ["y"], ["jac:r:y"])
        near = y0 + 0.01 * np.random.default_rng(3).standard_normal(len(y0))
        t, _, _, u, p, m = self.arguments
        defaulted = [k for k, v in enumerate(self.compiled.state_variables) if v in self.compiled.start.defaulted]
        movable = {*self.free, *defaulted}
        violation = unreachable(self.compiled, t, self.x, self.z, u, p, m, movable) if self.free else None
        return not_found(self.compiled, self.free, y0 * self.scale, residuals, [slope(y0), slope(near)], violation)


def _check_surplus(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> None:
    if not compiled.start.surplus:
        return
    residuals = functions_of(compiled).conditions(t, x, z, u, p, m)[1]
    for condition, residual in zip(compiled.start.surplus, residuals, strict=True):
        if abs(residual) > _SATISFIED:
            raise contradicting(compiled, condition, float(residual), x, p)


def _check_constraints(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> None:
    """Refuse a start that violates stabilised constraints of positions or velocities.

    Newton's method compares residuals with those at the guesses and with the unknowns, which may be large.
    """
    structure = compiled.solution.structure
    if not structure.invariants:
        return
    g, slope = constraints(compiled, np.array([t]), x[:, None], z[:, None], u, p, m)
    size = np.abs(slope[0]) @ (np.abs(x) + compiled.nominal_x)
    errors = np.abs(g[0]) / np.maximum(size, 1e-300)
    worst = int(np.argmax(errors))
    if not errors[worst] <= _ON_CONSTRAINTS:
        nodes = {c.node: c for c in (*compiled.start.conditions, *compiled.start.surplus)}
        raise off_constraint(compiled, nodes[structure.invariants[worst][1]], float(g[0][worst]), x, p)


def _check_defined(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> None:
    """Refuse a start at which an equation has no finite value, naming the first one."""
    functions = functions_of(compiled)
    if functions.are_finite(t, x, z, u, p, m):
        return
    for name, value in zip(compiled.states, x.tolist(), strict=True):
        if not math.isfinite(value):
            raise start_not_finite(compiled, name, value)
    found = first_undefined(compiled, t, x, z, u, p, m)
    if found is not None:
        raise undefined(compiled, t, found)
    ode, alg = functions.rhs(t, x, z, u, p, m)
    names = [
        n for n, v in zip((*compiled.states, *compiled.algebraic), (*ode, *alg), strict=True) if not np.isfinite(v)
    ]
    # the last of p, the rate of stabilisation, has no name
    infinite = [f"{n} = {v:g}" for n, v in zip(compiled.parameters, p, strict=False) if not np.isfinite(v)]
    raise InitializationError(
        "AC303",
        f"{compiled.name}: the equations for {listed(names, 4)} have no finite value at the start (t = {t:g} s)"
        + (f" for {listed(infinite, 2)}" if infinite else ""),
        where=made_at(compiled.flat, ""),
        cause="an infinite value, times zero or less another one" if infinite else UNDEFINED,
        help="give finite values, or leave out what they belong to" if infinite else None,
    )


Starter = Callable[[CompiledModel, float, Vector, Vector, Vector], tuple[Vector, Vector]]
"""`(compiled, t, p, u, m) -> (x, z)`: the start problem; raises InitializationError."""


def torn_start(
    compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector, start: Starter
) -> tuple[Vector, Vector] | None:
    """States and algebraic variables at the start of the torn form of a model; None if that does not help."""
    solution = compiled.solution
    if all(block.kind != "dae" for block in solution.blocks):
        return None
    try:
        torn = lower(solve(solution.structure))
        if _relations(torn) != _relations(compiled):
            return None
        x, z = start(torn, t, p, u, m)
    except AcausalError:
        return None
    pool = solution.structure.reduced.pool
    values = np.array(torn.observe(t, x, z, u, p, m)).ravel()
    known = dict(zip(torn.columns, values, strict=True))
    start_values = [known.get(pool.var(v), np.nan) for v in (*compiled.state_variables, *solution.algebraic)]
    if not np.isfinite(start_values).all():
        return None
    return np.array(start_values[: len(x)]), np.array(start_values[len(x) :])


def _relations(compiled: CompiledModel) -> tuple[object, ...]:
    events = compiled.state_events
    return compiled.time_events.relations, events.samples, events.memories, events.flags, events.relations
