"""The regime between two events: equations with fixed modes, and relations that are held at their guards.

There are two kinds of held relations. In a *sliding mode* both sides of a relation lead back to it, as with a relay at
its switching point: its mode is then the number between 0 and 1 that keeps the distance to the guard constant (A. F.
Filippov, Differential Equations with Discontinuous Righthand Sides, 1988; V. I. Utkin, Sliding Modes in Control and
Optimization, 1992). At *rest*, after a `when` that resets a velocity has acted in ever quicker succession, as with a
ball on the floor, the rate of that velocity is the one that keeps distance and approach at zero, until it would have to
pull.

The held relations form the active set. Its functions are created once for all runs of a model, because a ball that
comes to rest does so in each of them.
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


@dataclass(frozen=True, eq=False)
class Regime:
    """The equations of one run for one set of held relations; `free` is the problem in which none is held.

    With a `border`, the equations leave loads indeterminate (`simulate/equations/shares.py`).

    The guards are positive while the regime lasts: the directed distance of each free relation, and for each held one
    the quantities that must not become negative: the mode and one minus the mode, or the force that keeps it at rest.
    """

    free: Problem
    holds: tuple[Hold, ...] = ()
    border: Border | None = None

    @cached_property
    def active_set(self) -> ActiveSet:
        """The functions of the regime, shared by all runs of the model."""
        return active_set(self.free.compiled, self.holds, self.border)

    @cached_property
    def problem(self) -> Problem:
        """The problem to integrate."""
        if not self.holds and self.border is None:
            return self.free
        return Problem(self.active_set.compiled, self.free.p, self.free.u, self.free.wanted_native)

    @cached_property
    def compiled(self) -> CompiledModel:
        """The model of `problem`."""
        return self.active_set.compiled

    def relaxed(self, *given: Any, near: NDArray[np.intp]) -> Vector:
        """`ActiveSet.relaxed` of the guards `near`, shape (len(near),)."""
        if len(near) == 1:
            return self.active_set.buffered_relaxed(*given, near)[0]
        rows = -(-len(near) // TOGETHER)
        blocks = np.resize(near, (rows, TOGETHER))  # filled up with guards that are evaluated anyway
        return np.concatenate([self.active_set.buffered_relaxed_together(*given, block)[0] for block in blocks])[
            : len(near)
        ]

    def modes(self, t: Vector, x: Vector, z: Vector, m: Vector) -> Vector:
        """Modes at n instants, shape (nm, n) or, if no relation slides, (nm,)."""
        sliding = [(k, h.relation) for k, h in enumerate(self.holds) if h.target is None]
        if not sliding or not len(t):
            return m
        n = len(t)
        repeated = [np.tile(v[:, None], (1, n)) for v in (self.free.u, self.free.p, m)]
        multipliers = np.array(self.active_set.multipliers.map(n)(t[None, :], x, z, *repeated))
        modes: Vector = repeated[2]
        for k, relation in sliding:
            for other in (relation, *self.free.compiled.events.twins[relation]):
                modes[self.active_set.first + other] = multipliers[k]
        return modes

    def is_solvable(self, t: float, x: Vector, z: Vector, m: Vector) -> bool:
        """Whether the multipliers are determined at this point, and their effects are proportional to them."""
        count = len(self.holds)
        slope, other = (v.reshape(count, count) for v in self.active_set.effect(t, x, z, self.free.u, self.free.p, m))
        size = np.abs(slope).max(axis=1)
        if not np.isfinite(slope).all() or not (size > 0).all():
            return False
        affine = (np.abs(slope - other) <= 1e-9 * size[:, None]).all()
        return bool(affine and np.linalg.cond(slope / size[:, None]) < 1e12)


# The most sets of held relations whose equations are cached for one model.
_MOST_SETS = 64
TOGETHER = 16
"""The number of guards that share a factorisation, because hundreds of bodies may touch the ground at one instant."""
# The most entries of a Jacobian of guards from which single rows are selected.
_MOST_SLOPES = 10_000
# The distance by which a multiplier at an end of its interval is moved inside.
_INSIDE = 2.0**-53


@dataclass(frozen=True)
class Hold:
    """A relation that is held at its guard: by its own mode, or by the rate of the state at position `target`."""

    relation: int
    target: int | None = None


class ActiveSet:
    """Functions of `(t, x, z, u, p, m)` for one set of held relations of a model, perhaps none."""

    def __init__(self, free: CompiledModel, holds: tuple[Hold, ...], border: Border | None) -> None:
        self._free = ref(free)  # weak, because the cache must not keep the model alive
        self.holds, self.border = holds, border
        self.first = free.n_modes - len(free.state_events.relations)
        """Index of the first relation among the modes."""

    @property
    def free(self) -> CompiledModel:
        """The model with no relation held."""
        model = self._free()
        assert model is not None, "the caller holds the model"
        return model

    @property
    def compiled(self) -> CompiledModel:
        """The model with these equations."""
        return self.free if not self.holds and self.border is None else self._variant

    @cached_property
    def taken(self) -> frozenset[int]:
        """Relations that are held, and the twins of those that slide, which have the same multiplier."""
        twins = self.free.events.twins if self.holds else ()
        return frozenset(r for h in self.holds for r in (h.relation, *(twins[h.relation] if h.target is None else ())))

    @cached_property
    def owners(self) -> tuple[tuple[int, int], ...]:
        """The relation of each guard, and -1 for its distance, 0 or 1 for the lower or upper end of a hold."""
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
            return self.free.events.watch  # created once for all runs
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
        """Time derivatives of the guards, and their noise (`guard_rates`)."""
        if not self.holds and self.border is None:
            return functions_of(self.free).rates
        return BufferedFunction(guard_rates(self.compiled, self.watch))

    @cached_property
    def relaxed(self) -> Any:
        """`(t, x, z, u, p, m, e, h, k) -> |dg/dx (I - h J)^-1| e`: the error of guard k after errors of states relax.

        J is the Jacobian of the rates, with algebraic variables that follow the states; e are the errors of the states,
        and h is the step over which they relax, as in an implicit step. For one guard at a time, because few of
        hundreds are near zero.
        """
        return self._relaxed(1)

    def _relaxed(self, count: int) -> Any:
        """`relaxed` of `count` guards k, whose errors share one factorisation."""
        s = Symbols(self.compiled)
        ode, alg = self.compiled.rhs(*s.inputs)
        n, nx, chosen = self.compiled.n_dynamic, s.x.numel(), ca.SX.sym("which")
        gradient = _slopes(self.watch(*s.inputs), ca.vertcat(s.x, s.z), chosen)
        # discrete variables act on rates and have none; quadratures have rates and act on none: neither is solved for
        first = nx - self.compiled.discretes
        x, held, rates = s.x[:n], s.x[first:], ca.vertcat(ode[:n], alg)
        # transposed symbolically, which costs nothing, because values would be copied at each call
        jacobians = [ca.jacobian(f, v).T for v in (x, s.z) for f in (ode[:n], alg)]
        inputs = [ca.MX.sym(name, v.numel()) for name, v in zip("txzupm", s.inputs, strict=True)]
        e, h, k = ca.MX.sym("e", nx), ca.MX.sym("h"), ca.MX.sym("k", count)
        fx, ax, fz, az = ca.Function("slopes", s.inputs, jacobians).call(inputs)
        slope = ca.Function("slope", [*s.inputs, chosen], [gradient])
        g = ca.horzcat(*(slope(*inputs, k[i]) for i in range(count)))
        matrix = ca.blockcat([[ca.MX.eye(n) - h * fx, ax], [-h * fz, az]])
        # by QR, because a pivot of the matrix may be zero although no Jacobian is singular
        solved: Any = ca.solve(matrix, ca.vertcat(g[:n, :], g[nx:, :]), "qr")
        errors = ca.fabs(solved[:n, :]).T @ e[:n]
        if first < nx:
            # by a product, because the matrix has 40 000 entries if a hundred clutches act on one shaft
            seeds = ca.SX.sym("seeds", rates.numel(), count)
            slopes = ca.densify(ca.jtimes(rates, held, seeds, True))
            product = ca.Function("held", [*s.inputs, seeds], [slopes])
            indirect = product(*inputs, ca.vertcat(-h * solved[:n, :], solved[n:, :]))
            errors += ca.fabs(g[first:nx, :] - indirect).T @ e[first:]
        return ca.Function("relaxed", [*inputs, e, h, k], [errors])

    @cached_property
    def buffered_relaxed(self) -> BufferedFunction:
        """`relaxed`, for single points."""
        return BufferedFunction(self.relaxed)

    @cached_property
    def buffered_relaxed_together(self) -> BufferedFunction:
        """`relaxed` of a block of guards at once, for single points."""
        return BufferedFunction(self._relaxed(TOGETHER))

    @cached_property
    def multipliers(self) -> Any:
        """`(t, x, z, u, p, m) -> mu`: modes of the sliding relations, and additional rates of the states at rest."""
        e = self._equations
        return ca.Function("multipliers", e.s.inputs, [e.solved], ["t", "x", "z", "u", "p", "m"], ["mu"])

    @cached_property
    def is_possible(self) -> bool:
        """Whether the guards depend on states alone, so that their rates need no rates of algebraic variables."""
        return not any(ca.depends_on(v, self._equations.s.z) for v in self._equations.kept)

    @cached_property
    def effect(self) -> BufferedFunction:
        """`-> (slope, slope elsewhere)`: derivatives of the held rates by the multipliers, at two values of these."""
        e = self._equations
        return BufferedFunction(ca.Function("slope", e.s.inputs, [ca.densify(e.slope), ca.densify(e.other_slope)]))

    @cached_property
    def kept_of(self) -> Any:
        """`(t, x, z, u, p, m) -> k`: the quantities that the holds keep at zero."""
        e = self._equations
        return ca.Function("kept_of", e.s.inputs, [ca.densify(ca.vertcat(*e.kept))])

    @cached_property
    def kept(self) -> BufferedFunction:
        """`-> (k, dk/dx, d)`: the quantities that the holds keep at zero, and directions of states for projection.

        At rest these are the held state itself and the states that it drives, so that the ball moves and not the floor.
        """
        e = self._equations
        k = ca.vertcat(*e.kept)
        slope = ca.jacobian(k, e.s.x)
        scale = ca.DM(self.free.nominal_x)
        directions, row = [], 0
        for hold in self.holds:
            if hold.target is None:
                directions.append(scale**2 * slope[row, :].T)
            else:
                unit = ca.SX(len(self.free.states), 1)
                unit[hold.target] = 1
                directions += [ca.jacobian(e.ode, e.s.x[hold.target]), unit]
            row += 1 if hold.target is None else 2
        outputs = [ca.densify(v) for v in (k, slope, ca.horzcat(*directions))]
        return BufferedFunction(ca.Function("kept", e.s.inputs, outputs))

    @cached_property
    def _variant(self) -> CompiledModel:
        if not self.holds and self.border is not None:
            return self.border.compiled  # shared by all runs
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
            if hold.target is not None:  # the rate of approach to the guard is kept at zero, too
                v = ca.jtimes(v, tx, ca.vertcat(1, free))
                kept.append(v)
            residuals.append(ca.jtimes(v, tx, rate))
        r = ca.vertcat(*residuals)
        # a blend is affine inside the interval, although its formula, which avoids infinite branches, does not show it
        slope, here = (ca.substitute(e, mu, ca.DM([0.5] * len(self.holds))) for e in (ca.jacobian(r, mu), r))
        solved = 0.5 - (ca.solve(slope, here) if len(self.holds) > 1 else here / slope)
        # where sliding ends, a multiplier is 0 or 1, and the blend would have the slopes of one branch only
        within = solved + _INSIDE * ((solved == 0) - (solved == 1))
        ode, alg = (ca.densify(ca.substitute(e, mu, within)) for e in (ode, alg))
        other = ca.substitute(ca.jacobian(r, mu), mu, ca.DM([0.25] * len(self.holds)))
        return _Equations(s, ode, alg, ca.densify(solved), slope, other, ca.diag(slope) * solved, tuple(kept))


@dataclass(frozen=True, eq=False)
class _Equations:
    """Symbols, rates and residuals of a regime; its multipliers, their effects at two values, and what they hold."""

    s: Symbols
    ode: Any
    alg: Any
    solved: Any
    slope: Any
    other_slope: Any
    forces: Any
    kept: tuple[Any, ...]


def _slopes(g: Any, v: Any, which: Any) -> Any:
    """The gradient by v of one of the guards g, that with the number `which`.

    It is selected from all gradients, because those of other guards may be infinite. In large models it is a product
    with a unit vector instead, whose cost is proportional to that of the equations; then it is nan if another gradient
    is infinite.
    """
    if g.numel() * v.numel() > _MOST_SLOPES:
        return ca.densify(ca.jtimes(g, v, which == ca.DM(range(g.numel())), True))
    slopes = ca.jacobian(g, v)
    chosen = ca.if_else(which == ca.DM(slopes.sparsity().row()), ca.vertcat(*slopes.nonzeros()), 0)
    return ca.densify(ca.sum1(ca.SX(slopes.sparsity(), chosen)).T)


_CACHE: WeakKeyDictionary[CompiledModel, Recent[ActiveSet]] = WeakKeyDictionary()


def active_set(free: CompiledModel, holds: tuple[Hold, ...], border: Border | None) -> ActiveSet:
    """The active set of a model for these holds, cached."""
    free = free.common
    made = _CACHE.setdefault(free, Recent(_MOST_SETS))
    key = holds, border
    return made.get(key) or made.put(key, ActiveSet(free, holds, border))
