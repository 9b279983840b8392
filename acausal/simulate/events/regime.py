"""What is integrated between two events: the equations of fixed modes, and relations that are held at their guard.

A held relation is one of two things. In a *sliding mode* both sides of a relation lead back to it, a relay at its
switching point: its mode is then a number between 0 and 1, the one that keeps the distance to the guard constant
(A. F. Filippov, Differential Equations with Discontinuous Righthand Sides, 1988; V. I. Utkin, Sliding Modes in Control
and Optimization, 1992). At *rest* a `when` that resets a velocity has acted ever sooner, a ball on the floor: the rate
of that velocity is then the one that keeps distance and approach at zero, until it would have to pull.

The set of held relations is the active set. Its functions are made once for all runs of a model: a ball that comes to
rest does so in each of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary, ref

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.lower.events.functions import guard_rates
from acausal.recent import Recent
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.equations.shares import Border
from acausal.simulate.native.policy import Library


@dataclass(frozen=True, eq=False)
class Regime:
    """What is integrated by one run for one set of held relations; `free` is the problem of the free model.

    With a `border` the equations of the mode leave loads open (`simulate/equations/shares.py`).

    The guards are positive while the regime lasts: the directed distance of each relation that is free, then for each
    held one what must not become negative: mode and one minus mode, or the force that keeps it at rest.
    """

    free: Problem
    holds: tuple[Hold, ...] = ()
    border: Border | None = None
    _constants: Vector | None = None

    @cached_property
    def active_set(self) -> ActiveSet:
        """The functions, which all runs share."""
        return active_set(self.free.compiled, self.holds, self.border)

    @cached_property
    def problem(self) -> Problem:
        """The problem to integrate."""
        if not self.holds and self.border is None:
            return self.free
        return Problem(self.active_set.compiled, self.free.p, self.free.u, self.free.wanted_native)

    def constants(self, library: Library[Any]) -> Vector:
        """What parameters and inputs alone determine, for compiled code; computed once."""
        if self._constants is None:
            (found,) = library.constants(self.free.p, self.free.u)
            object.__setattr__(self, "_constants", found)
            return found
        return self._constants

    @cached_property
    def compiled(self) -> CompiledModel:
        """The model of `problem`."""
        return self.active_set.compiled

    def relaxed(self, *given: Any, near: NDArray[np.intp]) -> Vector:
        """See `ActiveSet.relaxed`: of some guards."""
        if len(near) == 1:
            return self.active_set.buffered_relaxed(*given, near)[0]
        rows = -(-len(near) // TOGETHER)
        blocks = np.resize(near, (rows, TOGETHER))  # filled up with guards that are asked for anyway
        return np.concatenate([self.active_set.buffered_relaxed_together(*given, block)[0] for block in blocks])[
            : len(near)
        ]

    def modes(self, t: Vector, x: Vector, z: Vector, m: Vector) -> Vector:
        """Modes along n instants, shape (nm, n) or, when none slides, (nm,)."""
        sliding = [(k, h.relation) for k, h in enumerate(self.holds) if h.target is None]
        if not sliding or not len(t):
            return m
        n = len(t)
        wide = [np.tile(v[:, None], (1, n)) for v in (self.free.u, self.free.p, m)]
        found = np.array(self.active_set.multipliers.map(n)(t[None, :], x, z, *wide))
        rows: Vector = wide[2]
        for k, relation in sliding:
            for other in (relation, *self.free.compiled.events.twins[relation]):
                rows[self.active_set.first + other] = found[k]
        return rows

    def is_solvable(self, t: float, x: Vector, z: Vector, m: Vector) -> bool:
        """Whether each multiplier has an effect at this point, in proportion to its size."""
        count = len(self.holds)
        slope, other = (v.reshape(count, count) for v in self.active_set.effect(t, x, z, self.free.u, self.free.p, m))
        size = np.abs(slope).max(axis=1)
        if not np.isfinite(slope).all() or not (size > 0).all():
            return False
        affine = (np.abs(slope - other) <= 1e-9 * size[:, None]).all()
        return bool(affine and np.linalg.cond(slope / size[:, None]) < 1e12)


# Sets of held relations whose equations are kept for one model.
_MOST = 64
TOGETHER = 16
"""Guards that share a factorisation: hundreds of bodies touch the ground in one instant."""
# Entries of a Jacobian of guards of which one row is chosen.
_MOST_SLOPES = 10_000
# From an end of the interval of a multiplier to a number inside of it.
_INSIDE = 2.0**-53


@dataclass(frozen=True)
class Hold:
    """A relation that is held at its guard: by its own mode, or by the rate of the state at position `target`."""

    relation: int
    target: int | None = None


class ActiveSet:
    """Functions of `(t, x, z, u, p, m)` for one set of held relations of a model, perhaps none."""

    def __init__(self, free: CompiledModel, holds: tuple[Hold, ...], border: Border | None) -> None:
        self._free = ref(free)  # what is kept for a model must not keep it alive
        self.holds, self.border = holds, border
        self.first = free.n_modes - len(free.state_events.relations)
        """Position of the first relation among the modes."""

    @property
    def free(self) -> CompiledModel:
        """The model with no relation held."""
        model = self._free()
        assert model is not None, "only who holds the model asks"
        return model

    @property
    def compiled(self) -> CompiledModel:
        """The model with these equations."""
        return self.free if not self.holds and self.border is None else self._variant

    @cached_property
    def taken(self) -> frozenset[int]:
        """Relations that are held, and twins of those that slide, whose modes are the same multiplier."""
        twins = self.free.events.twins if self.holds else ()
        return frozenset(r for h in self.holds for r in (h.relation, *(twins[h.relation] if h.target is None else ())))

    @cached_property
    def owners(self) -> tuple[tuple[int, int], ...]:
        """Of each guard the relation, and -1 for its distance, 0 and 1 for the lower and the upper end of a hold."""
        held = self.taken
        count = len(self.free.state_events.relations)
        ends = [(h.relation, side) for h in self.holds for side in ((0, 1) if h.target is None else (0,))]
        return (*((k, -1) for k in range(count) if k not in held), *ends)

    @cached_property
    def owner(self) -> NDArray[np.int64]:
        """The relation of each guard."""
        return np.array([relation for relation, _ in self.owners], dtype=np.int64)

    @cached_property
    def side(self) -> NDArray[np.int64]:
        """-1, 0 or 1 for each guard, see `owners`."""
        return np.array([side for _, side in self.owners], dtype=np.int64)

    @cached_property
    def watch(self) -> Any:
        """`(t, x, z, u, p, m) -> g`: the guards."""
        if not self.holds:
            return self.free.events.watch  # made once for all runs
        e = self._equations
        s = e.s
        distances = self.free.events.signed_at_rest(ca.vertsplit(self.free.events.distances(*s.inputs)))
        held = self.taken
        signs = 2 * s.m[self.first :] - 1
        parts = [signs[k] * g for k, g in enumerate(distances) if k not in held]
        for k, hold in enumerate(self.holds):
            parts += [e.solved[k], 1 - e.solved[k]] if hold.target is None else [-e.forces[k]]
        g = ca.densify(ca.vertcat(*parts)) if parts else ca.SX(0, 1)
        return ca.Function("watch", s.inputs, [g], ["t", "x", "z", "u", "p", "m"], ["g"])

    @cached_property
    def guards(self) -> BufferedFunction:
        """`-> (g,)`."""
        return BufferedFunction(self.watch) if self.holds else functions_of(self.free).watch

    @cached_property
    def rates(self) -> BufferedFunction:
        """Time derivatives of the guards and how far these can be wrong, as `guard_rates` says."""
        if not self.holds and self.border is None:
            return functions_of(self.free).rates
        return BufferedFunction(guard_rates(self.compiled, self.watch))

    @cached_property
    def judged(self) -> BufferedFunction:
        """Distances of all guards, then their rates, then their noise, of equations without algebraic variables.

        Arguments are those of `rates`; one call where `guards` and `rates` are two.
        """
        rates = self.rates.function
        inputs = [ca.MX.sym(rates.name_in(k), rates.numel_in(k)) for k in range(rates.n_in())]
        own, noise = rates(*inputs)[:2]
        return BufferedFunction(ca.Function("judged", inputs, [ca.vertcat(self.watch(*inputs[:-2]), own, noise)]))

    @cached_property
    def relaxed(self) -> Any:
        """`(t, x, z, u, p, m, e, h, k) -> |dg/dx (I - h J)^-1| e` of guard k, its error when those of states relaxed.

        J are the slopes of the rates with algebraic variables that follow the states; e are errors of the states, and
        h is the step over which they relax, as an implicit step lets them. One guard at a time: of hundreds, few are
        near zero.
        """
        return self._relaxed(1)

    def _relaxed(self, count: int) -> Any:
        """`relaxed` of so many guards k, whose errors share one factorisation."""
        s = Symbols(self.compiled)
        ode, alg = self.compiled.rhs(*s.inputs)
        n, nx, which = self.compiled.n_dynamic, s.x.numel(), ca.SX.sym("which")
        own = _slopes(self.watch(*s.inputs), ca.vertcat(s.x, s.z), which)
        # discrete variables act on rates and have none, integrals have rates and act on nothing: neither is solved for
        first = nx - self.compiled.discretes
        x, held, rates = s.x[:n], s.x[first:], ca.vertcat(ode[:n], alg)
        # transposed, as symbols are for nothing: values would be copied at each call
        parts = [ca.jacobian(f, v).T for v in (x, s.z) for f in (ode[:n], alg)]
        inputs = [ca.MX.sym(name, v.numel()) for name, v in zip("txzupm", s.inputs, strict=True)]
        e, h, k = ca.MX.sym("e", nx), ca.MX.sym("h"), ca.MX.sym("k", count)
        fx, ax, fz, az = ca.Function("slopes", s.inputs, parts).call(inputs)
        slope = ca.Function("slope", [*s.inputs, which], [own])
        g = ca.horzcat(*(slope(*inputs, k[i]) for i in range(count)))
        matrix = ca.blockcat([[ca.MX.eye(n) - h * fx, ax], [-h * fz, az]])
        # a pivot may be zero that no Jacobian has
        solved: Any = ca.solve(matrix, ca.vertcat(g[:n, :], g[nx:, :]), "qr")
        errors = ca.fabs(solved[:n, :]).T @ e[:n]
        if first < nx:
            # a product, as the matrix has 40 000 entries where a hundred clutches act on one shaft
            seeds = ca.SX.sym("seeds", rates.numel(), count)
            moved = ca.densify(ca.jtimes(rates, held, seeds, True))
            product = ca.Function("held", [*s.inputs, seeds], [moved])
            follows = product(*inputs, ca.vertcat(-h * solved[:n, :], solved[n:, :]))
            errors += ca.fabs(g[first:nx, :] - follows).T @ e[first:]
        return ca.Function("relaxed", [*inputs, e, h, k], [errors])

    @cached_property
    def buffered_relaxed(self) -> BufferedFunction:
        """`relaxed`, for single points."""
        return BufferedFunction(self.relaxed)

    @cached_property
    def buffered_relaxed_together(self) -> BufferedFunction:
        """`relaxed` of `TOGETHER` guards at once, for single points."""
        return BufferedFunction(self._relaxed(TOGETHER))

    @cached_property
    def multipliers(self) -> Any:
        """`(t, x, z, u, p, m) -> mu`: modes of the sliding relations, added rates of the resting states."""
        e = self._equations
        return ca.Function("multipliers", e.s.inputs, [e.solved], ["t", "x", "z", "u", "p", "m"], ["mu"])

    @cached_property
    def is_possible(self) -> bool:
        """Whether the guards are known from the states, so that their rates need no rates of algebraic variables."""
        return not any(ca.depends_on(v, self._equations.s.z) for v in self._equations.kept)

    @cached_property
    def effect(self) -> BufferedFunction:
        """`-> (slope, slope elsewhere)`: what the multipliers do to what is held, at two values of theirs."""
        e = self._equations
        return BufferedFunction(ca.Function("slope", e.s.inputs, [ca.densify(e.slope), ca.densify(e.other_slope)]))

    @cached_property
    def kept_of(self) -> Any:
        """`(t, x, z, u, p, m) -> k`: what the holds keep at zero."""
        e = self._equations
        return ca.Function("kept_of", e.s.inputs, [ca.densify(ca.vertcat(*e.kept))])

    @cached_property
    def kept(self) -> BufferedFunction:
        """`-> (k, dk/dx, d)`: what the holds keep at zero, and the directions in which states may move for it.

        At rest those are the held state itself and what it drives, so that nobody else moves: the ball, not the floor.
        """
        e = self._equations
        k = ca.vertcat(*e.kept)
        slope = ca.jacobian(k, e.s.x)
        scale = ca.DM(self.free.nominal_x)
        ways, row = [], 0
        for hold in self.holds:
            if hold.target is None:
                ways.append(scale**2 * slope[row, :].T)
            else:
                own = ca.SX(len(self.free.states), 1)
                own[hold.target] = 1
                ways += [ca.jacobian(e.ode, e.s.x[hold.target]), own]
            row += 1 if hold.target is None else 2
        outputs = [ca.densify(v) for v in (k, slope, ca.horzcat(*ways))]
        return BufferedFunction(ca.Function("kept", e.s.inputs, outputs))

    @cached_property
    def _variant(self) -> CompiledModel:
        if not self.holds and self.border is not None:
            return self.border.compiled  # the same for all runs
        e = self._equations
        names = ["t", "x", "z", "u", "p", "m"]
        rhs = ca.Function("rhs", e.s.inputs, [e.ode, e.alg], names, ["ode", "alg"])
        return replace(self.free, rhs=rhs, varied=True)

    @cached_property
    def _equations(self) -> _Equations:
        compiled = self.free
        s = Symbols(compiled)
        none = ca.SX(0, 1)
        if not self.holds:
            ode, alg = compiled.rhs(*s.inputs)
            return _Equations(s, ode, alg, none, none, none, none, ())
        mu = ca.SX.sym("mu", len(self.holds))
        m = ca.SX(s.m)
        for k, hold in enumerate(self.holds):
            if hold.target is None:
                for relation in (hold.relation, *compiled.events.twins[hold.relation]):
                    m[self.first + relation] = mu[k]
        free, alg = compiled.blended(s.t, s.x, s.z, s.u, s.p, m)
        if self.border is not None:
            alg = self.border.added(alg, s.m)
        ode = ca.SX(free)
        for k, hold in enumerate(self.holds):
            if hold.target is not None:
                ode[hold.target] += mu[k]
        distance = compiled.events.distances(*s.inputs)
        tx, rate = ca.vertcat(s.t, s.x), ca.vertcat(1, ode)
        kept, residuals = [], []
        for hold in self.holds:
            v = distance[hold.relation]
            kept.append(v)
            if hold.target is not None:  # the approach to the guard, which is to stay zero
                v = ca.jtimes(v, tx, ca.vertcat(1, free))
                kept.append(v)
            residuals.append(ca.jtimes(v, tx, rate))
        r = ca.vertcat(*residuals)
        # inside the interval a blend is affine, which its formula, safe against infinite branches, does not show
        slope, here = (ca.substitute(e, mu, ca.DM([0.5] * len(self.holds))) for e in (ca.jacobian(r, mu), r))
        solved = 0.5 - (ca.solve(slope, here) if len(self.holds) > 1 else here / slope)
        # where sliding ends a multiplier is 0 or 1, at which a blend has the slopes of one branch only
        within = solved + _INSIDE * ((solved == 0) - (solved == 1))
        ode, alg = (ca.densify(ca.substitute(e, mu, within)) for e in (ode, alg))
        other = ca.substitute(ca.jacobian(r, mu), mu, ca.DM([0.25] * len(self.holds)))
        return _Equations(s, ode, alg, ca.densify(solved), slope, other, ca.diag(slope) * solved, tuple(kept))


@dataclass(frozen=True, eq=False)
class _Equations:
    """Symbols, rates and residuals of a regime; its multipliers, their effect (at two values), and what they keep."""

    s: Symbols
    ode: Any
    alg: Any
    solved: Any
    slope: Any
    other_slope: Any
    forces: Any
    kept: tuple[Any, ...]


def _slopes(g: Any, v: Any, which: Any) -> Any:
    """The gradient of one of the guards g by v.

    Chosen among all gradients, as those of other guards may be infinite. In large models by a product with a vector of
    zeros and a one instead, whose cost grows with the equations: the gradient is nan there if another one is infinite.
    """
    if g.numel() * v.numel() > _MOST_SLOPES:
        return ca.densify(ca.jtimes(g, v, which == ca.DM(range(g.numel())), True))
    slopes = ca.jacobian(g, v)
    chosen = ca.if_else(which == ca.DM(slopes.sparsity().row()), ca.vertcat(*slopes.nonzeros()), 0)
    return ca.densify(ca.sum1(ca.SX(slopes.sparsity(), chosen)).T)


_MADE: WeakKeyDictionary[CompiledModel, Recent[ActiveSet]] = WeakKeyDictionary()


def active_set(free: CompiledModel, holds: tuple[Hold, ...], border: Border | None) -> ActiveSet:
    """The equations of a model for these holds, from those that were asked for before."""
    free = free.common
    made = _MADE.setdefault(free, Recent(_MOST))
    key = holds, border
    return made.get(key) or made.put(key, ActiveSet(free, holds, border))
