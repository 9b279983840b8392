"""Consistent start values: a problem of its own, solved before any integrator is made."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.errors import InitializationError
from acausal.lower.compiled import CompiledModel
from acausal.lower.diagnosis.words import counted, listed, made_at
from acausal.simulate.finite import UNDEFINED, first_undefined
from acausal.simulate.kept import kept
from acausal.simulate.start_errors import contradicting, left_open, not_found, undefined
from acausal.simulate.torn_start import torn_start
from acausal.simulate.truth import truths

Vector = NDArray[np.float64]

_MOST_BLOCKS = 200
_LARGEST_RANK = 200
# Newton steps before the thorough search begins, at the start and at events: after a jump there is little hope.
_MOST, _AT_ONCE = 30, 8


@dataclass(frozen=True, eq=False)
class Start:
    """A consistent point: states, algebraic variables, and sentences about what was chosen."""

    x: Vector
    z: Vector
    notes: tuple[str, ...]


def initialize(compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector) -> Start:
    """Solve the start conditions together with the algebraic equations; decides relations of variables within `m`.

    Raises
    ------
    InitializationError
        AC301 when Newton's method and continuation both fail, AC304 when that is because conditions depend on each
        other, AC302 when conditions contradict each other, AC303 when the equations are not defined at the start
        (division by zero, root of a negative number).
    """
    start = _decided(compiled, t, p, u, m) if compiled.state_events else _initialized(compiled, t, p, u, m, {})
    _check_surplus(compiled, t, start.x, start.z, u, p, m)
    return start


def _decided(compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector) -> Start:
    """The start together with relations and discrete equations, which are decided by the solution they lead to."""
    x, z = kept(compiled).guess(p)
    events, nodes = compiled.state_events, compiled.solution.structure.reduced.pool.nodes
    memories = compiled.n_timely + len(events.samples)
    flags = memories + len(events.memories)
    relations = flags + len(events.flags)
    reactions = kept(compiled).reactions
    m[memories:flags] = reactions(t, x, z, u, p, m)[4]
    m[flags:relations] = [float(nodes[n][0] == "initial") for n in events.flags]
    m[relations:] = truths(compiled, t, x, z, u, p, m)
    places = [a.position for a in events.assignments]
    given: dict[int, float] = {k: x[k] for k in places}
    seen: set[bytes] = set()
    start = Start(x, z, ())
    while (key := m.tobytes() + np.array(list(given.values())).tobytes()) not in seen:
        seen.add(key)
        start = _initialized(compiled, t, p, u, m, given)
        m[relations:] = truths(compiled, t, start.x, start.z, u, p, m)
        given = dict(zip(places, reactions(t, start.x, start.z, u, p, m)[1], strict=True))
    m[flags:relations] = 0.0
    return start


def _initialized(
    compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector, assigned: dict[int, float]
) -> Start:
    x, z = kept(compiled).guess(p)
    x[list(assigned)] = list(assigned.values())
    free = [k for k, v in enumerate(compiled.state_variables) if v not in compiled.start.direct]
    free = [k for k in free if compiled.state_variables[k] not in compiled.start.defaulted]
    notes = _defaulted(compiled, x)
    if free or len(z):
        newton = kept(compiled).newton(tuple(free))
        found = None if newton is None else newton.solve(t, x, z, u, p, m, _MOST)
        if found is None:
            _check_defined(compiled, t, x, z, u, p, m)
            found = _thorough(compiled, t, x, z, u, p, m, free, assigned)
        x, z = found
        notes += _left_open(compiled, t, x, z, u, p, m, free)
    _check_defined(compiled, t, x, z, u, p, m)
    return Start(x, z, notes)


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
    newton = kept(compiled).newton(tuple(free))
    if not free or newton is None or len(newton.scale) > _LARGEST_RANK:
        return ()
    near = 0.01 * newton.scale * np.random.default_rng(3).standard_normal(len(newton.scale))
    beside = x.copy()
    beside[free] += near[: len(free)]
    there = beside, z + near[len(free) :]
    return left_open(compiled, free, [newton.quick_slope(t, *at, u, p, m)[0] for at in ((x, z), there)])


def _solved(
    assigned: dict[int, float], compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector
) -> tuple[Vector, Vector]:
    start = _initialized(compiled, t, p, u, m, assigned)
    return start.x, start.z


def consistent(compiled: CompiledModel, t: float, start: Start, p: Vector, u: Vector, m: Vector) -> Start:
    """Algebraic variables for given states, after an event: the restart problem, never the initial one."""
    if not len(start.z):
        return start
    newton = kept(compiled).newton()
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


def _last_step(residual: Any, y: Vector) -> float:
    """Length of the Newton step that is left at `y`, relative to its entries; infinite where there is none."""
    matrix = np.array(residual.factory("slope", ["y"], ["jac:r:y"])(y))
    try:
        step = np.linalg.solve(matrix, np.array(residual(y)).ravel())
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
            "abstol": 1e-13,
            "abstolStep": 1e-11,
            "max_iter": 400,
            "error_on_fail": False,
            "show_eval_warnings": False,
        }
        try:  # CasADi refuses a structurally singular Jacobian when the rootfinder is made: a mass of 0 kg
            found = np.array(ca.rootfinder("start", "newton", residual, settings)(y0)).ravel()
        except RuntimeError:
            return None
        at = np.abs(np.array(residual(found)).ravel())
        good = np.isfinite(found).all() and np.isfinite(at).all()
        if not good:
            return None
        size = 1.0 + np.abs(np.array(residual(y0)).ravel())
        if (at <= 1e-8 * np.nan_to_num(size, nan=1.0)).all():
            return found
        # Large terms that cancel, a stiff spring over a long way, leave more than that by rounding alone.
        return found if _last_step(residual, found) <= 1e-10 else None

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
        return not_found(self.compiled, self.free, y0 * self.scale, residuals, [slope(y0), slope(near)])


def _check_surplus(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> None:
    if not compiled.start.surplus:
        return
    off = np.array(compiled.conditions(t, x, z, u, p, m)[1]).ravel()
    for condition, residual in zip(compiled.start.surplus, off, strict=True):
        if abs(residual) > 1e-7:
            raise contradicting(compiled, condition, float(residual), x, p)


def _check_defined(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> None:
    """Refuse a start at which an equation has no finite value, naming the first one."""
    found = first_undefined(compiled, t, x, z, u, p, m)
    if found is not None:
        raise undefined(compiled, t, found)
    ode, alg = kept(compiled).rhs(t, x, z, u, p, m)
    is_finite = bool(np.isfinite(ode).all() and np.isfinite(alg).all())
    if is_finite:
        return
    names = [
        n for n, v in zip((*compiled.states, *compiled.algebraic), (*ode, *alg), strict=True) if not np.isfinite(v)
    ]
    raise InitializationError(
        "AC303",
        f"{compiled.name}: the equations for {listed(names, 4)} have no finite value at the start (t = {t:g} s)",
        where=made_at(compiled.flat, ""),
        cause=UNDEFINED,
    )
