"""Consistent start values: a problem of its own, solved before any integrator is made."""

from __future__ import annotations

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
from acausal.simulate.start.errors import contradicting, left_open, not_found, off_constraint, undefined
from acausal.simulate.start.finite import UNDEFINED, first_undefined
from acausal.simulate.start.nearest import nearest_start, unreachable

_MOST_BLOCKS = 200
_LARGEST_RANK = 200
# Newton steps before the thorough search begins, at the start and at events: after a jump there is little hope.
_MOST, _AT_ONCE = 30, 8
# How far a start may be off stabilised constraints, by the size of what moves them.
_CLOSED = 1e-7
# What a condition may be off by; and how far from its guess a variable is looked for again, by its size.
_HOLDS, _FAR = 1e-7, 0.1


@dataclass(frozen=True, eq=False)
class Start:
    """A consistent point: states, algebraic variables, and sentences about what was chosen."""

    x: Vector
    z: Vector
    notes: tuple[str, ...]


def initialize(compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector) -> Start:
    """Solve the start conditions together with the algebraic equations.

    Modes of relations of variables, and states of discrete variables, are decided on the way and written into `m`.

    Raises InitializationError: AC301 when Newton's method and continuation both fail, AC304 when that is because
    conditions depend on each other, AC302 when conditions contradict each other, or no state satisfies all constraints
    with them, AC303 when the equations are not defined at the start (division by zero, root of a negative number).
    """
    start = _decided(compiled, t, p, u, m) if compiled.state_events else _initialized(compiled, t, p, u, m, {})
    _check_surplus(compiled, t, start.x, start.z, u, p, m)
    _check_constraints(compiled, t, start.x, start.z, u, p, m)
    return start


def _decided(compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector) -> Start:
    """The start together with relations and discrete equations, which are decided by the solution they lead to."""
    x, z = functions_of(compiled).guess(p)
    events, nodes = compiled.state_events, compiled.solution.structure.reduced.pool.nodes
    memories = compiled.n_timely + len(events.samples)
    flags = memories + len(events.memories)
    relations = flags + len(events.flags)
    reactions = functions_of(compiled).reactions
    m[memories:flags] = reactions(t, x, z, u, p, m)[4]
    m[flags:relations] = [float(nodes[n][0] == "initial") for n in events.flags]
    m[relations:] = truths(compiled, t, x, z, u, p, m)
    places = [a.position for a in events.assignments]
    given: dict[int, float] = {k: x[k] for k in places}
    seen: set[bytes] = set()
    start = Start(x, z, ())
    shares = functions_of(compiled).shares
    while (key := m.tobytes() + np.array(list(given.values())).tobytes()) not in seen:
        seen.add(key)
        solved = m if shares is None else _creeping(shares, t, start, p, u, m, given)
        start = _initialized(compiled, t, p, u, solved, given)
        m[relations:] = truths(compiled, t, start.x, start.z, u, p, m)
        given = dict(zip(places, reactions(t, start.x, start.z, u, p, m)[1], strict=True))
    m[flags:relations] = 0.0
    return start if shares is None else _exactly(compiled, shares, t, start, p, u, m, given)


def _creeping(
    shares: Shares, t: float, start: Start, p: Vector, u: Vector, m: Vector, assigned: dict[int, float]
) -> Vector:
    """Modes under which elements of friction creep: the first guess is that all of them stick, which may contradict."""
    x, m = start.x.copy(), m.copy()
    x[list(assigned)] = list(assigned.values())
    m[shares.place] = shares.creep(t, x, start.z, u, p, m)
    return m


def _exactly(
    compiled: CompiledModel,
    shares: Shares,
    t: float,
    start: Start,
    p: Vector,
    u: Vector,
    m: Vector,
    assigned: dict[int, float],
) -> Start:
    """The start without creep: states that are solved for have felt it, algebraic variables are found again anyway."""
    if not _free(compiled):
        return start
    border = shares.border(compiled, t, start.x, start.z, u, p, m)
    return _initialized(compiled if border is None else border.compiled, t, p, u, m, assigned)


def _free(compiled: CompiledModel) -> list[int]:
    """Places of the states that the start conditions are solved for."""
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
    lost = False
    if free or len(z):
        newton = functions_of(compiled).newton(tuple(free))
        found = None if newton is None else newton.solve(t, x, z, u, p, m, _MOST)
        if found is None:
            lost = bool(free)
            _check_defined(compiled, t, x, z, u, p, m)
            try:
                found = _thorough(compiled, t, x, z, u, p, m, free, assigned)
            except InitializationError as error:
                failure, lost = error, True
        if found is not None:
            x, z = found
    left = _left_open(compiled, t, x, z, u, p, m, free) if failure is None else ()
    opened = _opened(compiled, t, guess, (x, z), u, p, m, set(assigned), lost or bool(left))
    if opened is not None:
        return replace(opened, notes=left) if left else opened
    if failure is not None or _is_off(compiled, t, x, z, u, p, m):
        # of two roots Newton's method has taken the one that a condition it was not given excludes
        start = _nearest(compiled, t, *guess, u, p, m, set(assigned)) if failure is None else None
        start = start or _nearest(compiled, t, x, z, u, p, m, set(assigned))
        if start is None and failure is not None:
            raise failure
        if start is not None:
            return start
    _check_defined(compiled, t, x, z, u, p, m)
    return Start(x, z, notes + left)


def _opened(
    compiled: CompiledModel,
    t: float,
    guess: tuple[Vector, Vector],
    reached: tuple[Vector, Vector],
    u: Vector,
    p: Vector,
    m: Vector,
    held: set[int],
    lost: bool,
) -> Start | None:
    """The start in which all conditions hold and what they leave open is at its guess, in any order of declaration.

    None where structure has found it, or nobody does; `lost` says that it has not, or with effort, or one of many.
    """
    if not (lost or compiled.start.defaulted or compiled.start.conditions or compiled.start.surplus):
        return None
    opened = functions_of(compiled).open_start
    if opened is None:
        return None
    numbers = u, p, m
    far = opened.misses(t, *reached, *numbers, guess[0])
    lost = lost or opened.is_ambiguous or _is_off(compiled, t, *reached, *numbers)
    found = opened.solve(t, *reached, *numbers, held) if lost else None
    if (found is None and lost) or far > _FAR:
        other = opened.solve(t, *opened.near(t, *guess, *numbers), *numbers, held)
        if other is not None:
            is_nearer = opened.misses(t, *other[:2], *numbers, guess[0]) < 0.5 * far
            found = other if is_nearer or (lost and found is None) else found
    if found is None and lost:
        found = opened.met_best(t, *opened.near(t, *guess, *numbers), *numbers, held)
    if found is None:
        return None
    x, z, names = found
    _check_defined(compiled, t, x, z, u, p, m)
    count = counted(len(names), "start value")
    note = (
        f"{count} not given; taken: {', '.join(names[:6])}{' ...' if len(names) > 6 else ''}  (say so with fixed(...))"
    )
    return Start(x, z, (note,) if names else ())


def _is_off(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> bool:
    """Whether a condition does not hold: structure took it as following from others, or Newton's method left it."""
    if not (compiled.start.conditions or compiled.start.surplus):
        return False
    return any(np.abs(np.array(part)).max(initial=0.0) > _HOLDS for part in compiled.conditions(t, x, z, u, p, m))


def _nearest(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: set[int]
) -> Start | None:
    """The start nearest to the guesses in which all conditions hold, where they leave states open, or say more than
    enough; None where they do not, or none is."""
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


def _thorough(
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
    """States and algebraic variables where Newton's method alone does not find them."""
    try:
        return _System(compiled, t, x, z, u, p, m, free).solve()
    except InitializationError:
        near = torn_start(compiled, t, p, u, m, partial(_solved, assigned))
        if near is None:
            raise
        return _System(compiled, t, *near, u, p, m, free).solve()


def _left_open(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, free: list[int]
) -> tuple[str, ...]:
    """A note when the solution that was found is one of many, so that the guesses have decided."""
    newton = functions_of(compiled).newton(tuple(free)) if free else None
    if newton is None or len(newton.scale) > _LARGEST_RANK:
        return ()
    near = 0.01 * newton.scale * np.random.default_rng(3).standard_normal(len(newton.scale))
    beside = x.copy()
    beside[free] += near[: len(free)]
    there = beside, z + near[len(free) :]
    return left_open(compiled, free, [newton.buffered_slope(t, *at, u, p, m)[0] for at in ((x, z), there)])


def _solved(
    assigned: dict[int, float], compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector
) -> tuple[Vector, Vector]:
    start = _initialized(compiled, t, p, u, m, assigned)
    return start.x, start.z


def consistent(compiled: CompiledModel, t: float, start: Start, p: Vector, u: Vector, m: Vector) -> Start:
    """Algebraic variables for the states of `start`, which stay: the problem after an event, not that of the start."""
    if not len(start.z):
        return start
    newton = functions_of(compiled).newton()
    found = None if newton is None else newton.solve(t, start.x, start.z, u, p, m, _AT_ONCE)
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


def _last_step(matrix: Vector, residual: Vector, y: Vector) -> float:
    """Length of the Newton step that is left at `y`, relative to its entries; infinite where there is none."""
    try:
        step = np.linalg.solve(matrix, residual)
    except np.linalg.LinAlgError:
        return np.inf
    length = float(np.max(np.abs(step) / (1.0 + np.abs(y))))
    return length if np.isfinite(length) else np.inf


class _System:
    """Unknowns: the free states and the algebraic variables, each divided by its nominal magnitude."""

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
        """Newton from the guesses, of all, then block by block; the model's homotopy; continuation from the guesses."""
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
            "abstol": 0.0,  # equations have units of their own, and one of picocoulombs is small anywhere: steps decide
            "abstolStep": 1e-11,
            "max_iter": 400,
            "error_on_fail": False,
            "show_eval_warnings": False,
        }
        try:  # CasADi refuses a structurally singular Jacobian when the rootfinder is made: a mass of 0 kg
            found = np.array(ca.rootfinder("start", "newton", residual, settings)(y0)).ravel()
        except RuntimeError:
            return None
        off = np.array(residual(found)).ravel()
        at = np.abs(off)
        good = np.isfinite(found).all() and np.isfinite(at).all()
        if not good:
            return None
        matrix = residual.factory("slope", ["y"], ["jac:r:y"])(found)
        # unknowns that a singular matrix has driven far off would make any residual small: those at the guesses count
        size = np.array(ca.fabs(matrix) @ (1.0 + np.abs(y0)) + ca.fabs(residual(y0))).ravel()
        if (at <= 1e-8 * np.nan_to_num(size, nan=1.0)).all():
            return found
        # Large terms that cancel, a stiff spring over a long way, leave more than that by rounding alone.
        return found if _last_step(np.array(matrix), off, found) <= 1e-10 else None

    def _by_blocks(self, y0: Vector) -> Vector | None:
        """Newton's method on one block of the triangular form after the other, each with what is known by then.

        A step of all unknowns together is shortened as the worst of them demands, also of those that only follow: a
        rate whose factor passes through zero on the way keeps a harmless position from being found.
        """
        if self.residual.numel_out(0) != len(y0):
            return None
        count, rows, columns, first_row, first_column, *_ = self.residual.jac_sparsity(0, 0).btf()
        if not 1 < count <= _MOST_BLOCKS:
            return None
        y = y0.copy()
        for k in reversed(range(count)):
            own_rows = rows[first_row[k] : first_row[k + 1]]
            own = columns[first_column[k] : first_column[k + 1]]
            part = ca.SX.sym("y", len(own))
            whole = ca.SX(ca.DM(y))
            whole[own] = part
            found = self._newton(ca.Function("block", [part], [self.residual(whole)[own_rows]], ["y"], ["r"]), y[own])
            if found is None:
                return None
            y[own] = found
        return y

    def _homotopy(self, y0: Vector) -> Vector | None:
        """From the simplified system that the model states by `homotopy(...)` to the actual one."""
        if self.compiled.homotopy is None or self.residual.numel_out(0) != len(y0):
            return None
        y, _ = self.symbols
        s = ca.SX.sym("s")
        used, alg = self.compiled.homotopy(*self.arguments, s)
        moved = ca.Function("moved", [y, s], [ca.vertcat(used, alg) if self.free else alg])
        simplified = self._newton(ca.Function("partial", [y], [moved(y, 0.0)], ["y"], ["r"]), y0)
        return None if simplified is None else self._follow(moved, simplified)

    def _continuation(self, y0: Vector) -> Vector | None:
        """F(y) - (1 - s) F(y0) = 0 from s = 0, where y0 is the answer, to s = 1."""
        start = np.array(self.residual(y0)).ravel()
        if not np.isfinite(start).all() or self.residual.numel_out(0) != len(y0):
            return None
        y, full = self.symbols
        s = ca.SX.sym("s")
        return self._follow(ca.Function("moved", [y, s], [full - (1 - s) * ca.DM(start)]), y0)

    def _follow(self, moved: Any, y0: Vector) -> Vector | None:
        """The solution of `moved(y, s) = 0` led from y0 at s = 0 to s = 1, in steps that adapt."""
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
        left = [k for k, v in enumerate(self.compiled.state_variables) if v in self.compiled.start.defaulted]
        places = {*self.free, *left}
        off = unreachable(self.compiled, t, self.x, self.z, u, p, m, places) if self.free else None
        return not_found(self.compiled, self.free, y0 * self.scale, residuals, [slope(y0), slope(near)], off)


def _check_surplus(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> None:
    if not compiled.start.surplus:
        return
    off = np.array(compiled.conditions(t, x, z, u, p, m)[1]).ravel()
    for condition, residual in zip(compiled.start.surplus, off, strict=True):
        if abs(residual) > _HOLDS:
            raise contradicting(compiled, condition, float(residual), x, p)


def _check_constraints(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> None:
    """Refuse a start off the stabilised constraints, of positions and of velocities.

    A residual that is small beside what it was at the guesses, or beside unknowns that have run away, is not enough.
    """
    structure = compiled.solution.structure
    if not structure.invariants:
        return
    g, slope = constraints(compiled, np.array([t]), x[:, None], z[:, None], u, p, m)
    size = np.abs(slope[0]) @ (np.abs(x) + compiled.nominal_x)
    off = np.abs(g[0]) / np.maximum(size, 1e-300)
    worst = int(np.argmax(off))
    if not off[worst] <= _CLOSED:
        nodes = {c.node: c for c in (*compiled.start.conditions, *compiled.start.surplus)}
        raise off_constraint(compiled, nodes[structure.invariants[worst][1]], float(g[0][worst]), x, p)


def _check_defined(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> None:
    """Refuse a start at which an equation has no finite value, naming the first one."""
    functions = functions_of(compiled)
    if functions.are_finite(t, x, z, u, p, m):
        return
    found = first_undefined(compiled, t, x, z, u, p, m)
    if found is not None:
        raise undefined(compiled, t, found)
    ode, alg = functions.rhs(t, x, z, u, p, m)
    names = [
        n for n, v in zip((*compiled.states, *compiled.algebraic), (*ode, *alg), strict=True) if not np.isfinite(v)
    ]
    # the last of p, the rate of stabilisation, has no name
    endless = [f"{n} = {v:g}" for n, v in zip(compiled.parameters, p, strict=False) if not np.isfinite(v)]
    raise InitializationError(
        "AC303",
        f"{compiled.name}: the equations for {listed(names, 4)} have no finite value at the start (t = {t:g} s)"
        + (f" for {listed(endless, 2)}" if endless else ""),
        where=made_at(compiled.flat, ""),
        cause="an infinite value, times zero or less another one" if endless else UNDEFINED,
        help="give finite values, or leave out what they belong to" if endless else None,
    )


Starter = Callable[[CompiledModel, float, Vector, Vector, Vector], tuple[Vector, Vector]]
"""`(compiled, t, p, u, m) -> (x, z)`: the start problem; raises InitializationError."""


def torn_start(
    compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector, start: Starter
) -> tuple[Vector, Vector] | None:
    """States and algebraic variables as the torn form of the same model starts; None where there is no such help."""
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
    found = [known.get(pool.var(v), np.nan) for v in (*compiled.state_variables, *solution.algebraic)]
    if not np.isfinite(found).all():
        return None
    return np.array(found[: len(x)]), np.array(found[len(x) :])


def _relations(compiled: CompiledModel) -> tuple[object, ...]:
    events = compiled.state_events
    return compiled.time_events.relations, events.samples, events.memories, events.flags, events.relations
