"""What is integrated between two events: the equations of fixed modes, and relations that are held at their guard.

A held relation is one of two things. In a *sliding mode* both sides of a relation lead back to it, a relay at its
switching point: its mode is then a number between 0 and 1, the one that keeps the distance to the guard constant
(A. F. Filippov, Differential Equations with Discontinuous Righthand Sides, 1988; V. I. Utkin, Sliding Modes in Control
and Optimization, 1992). At *rest* a `when` that resets a velocity has acted ever sooner, a ball on the floor: the rate
of that velocity is then the one that keeps distance and approach at zero, until it would have to pull.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel, Symbols
from acausal.lower.event_functions import guard_rates
from acausal.simulate.kept import kept
from acausal.simulate.native.policy import Library
from acausal.simulate.problem import Problem
from acausal.simulate.quick import Quick

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Hold:
    """A relation that is held at its guard: by its own mode, or by the rate of the state at position `target`."""

    relation: int
    target: int | None = None


@dataclass(frozen=True, eq=False)
class Regime:
    """Equations, guards and multipliers for one set of held relations; `problem` is that of the free model.

    The guards are positive while the regime lasts: the directed distance of each relation that is free, then for each
    held one what must not become negative: mode and one minus mode, or the force that keeps it at rest.
    """

    free: Problem
    holds: tuple[Hold, ...] = ()
    _constants: Vector | None = None

    @cached_property
    def problem(self) -> Problem:
        """The problem to integrate."""
        if not self.holds:
            return self.free
        return Problem(self._variant, self.free.p, self.free.u, self.free.wanted_native)

    def constants(self, library: Library[Any]) -> Vector:
        """What parameters and inputs alone determine, for compiled code; computed once."""
        if self._constants is None:
            (found,) = library.constants(self.free.p, self.free.u)
            object.__setattr__(self, "_constants", found)
            return found
        return self._constants

    @property
    def compiled(self) -> CompiledModel:
        """The model of `problem`."""
        return self.problem.compiled

    @property
    def first(self) -> int:
        """Position of the first relation among the modes."""
        compiled = self.free.compiled
        return compiled.n_modes - len(compiled.state_events.relations)

    @cached_property
    def owners(self) -> tuple[tuple[int, int], ...]:
        """Of each guard the relation, and -1 for its distance, 0 and 1 for the lower and the upper end of a hold."""
        held = {h.relation for h in self.holds}
        count = len(self.free.compiled.state_events.relations)
        ends = [(h.relation, side) for h in self.holds for side in ((0, 1) if h.target is None else (0,))]
        return (*((k, -1) for k in range(count) if k not in held), *ends)

    @cached_property
    def watch(self) -> Any:
        """`(t, x, z, u, p, m) -> g`: the guards."""
        if not self.holds:
            return self.free.compiled.events.watch  # made once for all runs
        e = self._equations
        s = e.s
        distance = self.free.compiled.events.distances(*s.inputs)
        held = {h.relation for h in self.holds}
        signs = 2 * s.m[self.first :] - 1
        parts = [signs[k] * distance[k] for k in range(distance.numel()) if k not in held]
        for k, hold in enumerate(self.holds):
            parts += [e.solved[k], 1 - e.solved[k]] if hold.target is None else [-e.forces[k]]
        g = ca.densify(ca.vertcat(*parts)) if parts else ca.SX(0, 1)
        return ca.Function("watch", s.inputs, [g], ["t", "x", "z", "u", "p", "m"], ["g"])

    @cached_property
    def guards(self) -> Quick:
        """`(t, x, z, u, p, m) -> (g,)`."""
        return Quick(self.watch) if self.holds else kept(self.free.compiled).watch

    @cached_property
    def rates(self) -> Quick:
        """Time derivatives of the guards and how far these can be wrong, as `guard_rates` says."""
        return Quick(guard_rates(self.compiled, self.watch)) if self.holds else kept(self.free.compiled).rates

    @cached_property
    def multipliers(self) -> Any:
        """`(t, x, z, u, p, m) -> mu`: modes of the sliding relations, added rates of the resting states."""
        e = self._equations
        return ca.Function("multipliers", e.s.inputs, [e.solved], ["t", "x", "z", "u", "p", "m"], ["mu"])

    def modes(self, t: Vector, x: Vector, z: Vector, m: Vector) -> Vector:
        """Modes along n instants, shape (nm, n) or, when none slides, (nm,)."""
        sliding = [(k, h.relation) for k, h in enumerate(self.holds) if h.target is None]
        if not sliding or not len(t):
            return m
        n = len(t)
        wide = [np.tile(v[:, None], (1, n)) for v in (self.free.u, self.free.p, m)]
        found = np.array(self.multipliers.map(n)(t[None, :], x, z, *wide))
        rows: Vector = wide[2]
        for k, relation in sliding:
            rows[self.first + relation] = found[k]
        return rows

    @property
    def is_possible(self) -> bool:
        """Whether the guards are known from the states, so that their rates need no rates of algebraic variables."""
        return not any(ca.depends_on(v, self._equations.s.z) for v in self._equations.kept)

    def is_solvable(self, t: float, x: Vector, z: Vector, m: Vector) -> bool:
        """Whether each multiplier has an effect at this point, in proportion to its size."""
        e = self._equations
        function = ca.Function("slope", e.s.inputs, [ca.densify(e.slope), ca.densify(e.other_slope)])
        slope, other = (np.array(v) for v in function(t, x, z, self.free.u, self.free.p, m))
        size = np.abs(slope).max(axis=1)
        if not np.isfinite(slope).all() or not (size > 0).all():
            return False
        affine = (np.abs(slope - other) <= 1e-9 * size[:, None]).all()
        return bool(affine and np.linalg.cond(slope / size[:, None]) < 1e12)

    @cached_property
    def kept_of(self) -> Any:
        """`(t, x, z, u, p, m) -> k`: what the holds keep at zero."""
        e = self._equations
        return ca.Function("kept_of", e.s.inputs, [ca.densify(ca.vertcat(*e.kept))])

    @cached_property
    def kept(self) -> Quick:
        """`-> (k, dk/dx, d)`: what the holds keep at zero, and the directions in which states may move for it.

        At rest those are the held state itself and what it drives, so that nobody else moves: the ball, not the floor.
        """
        e = self._equations
        k = ca.vertcat(*e.kept)
        slope = ca.jacobian(k, e.s.x)
        scale = ca.DM(self.free.compiled.nominal_x)
        ways, row = [], 0
        for hold in self.holds:
            if hold.target is None:
                ways.append(scale**2 * slope[row, :].T)
            else:
                own = ca.SX(len(self.free.compiled.states), 1)
                own[hold.target] = 1
                ways += [ca.jacobian(e.ode, e.s.x[hold.target]), own]
            row += 1 if hold.target is None else 2
        outputs = [ca.densify(v) for v in (k, slope, ca.horzcat(*ways))]
        return Quick(ca.Function("kept", e.s.inputs, outputs))

    @cached_property
    def _variant(self) -> CompiledModel:
        e = self._equations
        names = ["t", "x", "z", "u", "p", "m"]
        return replace(self.free.compiled, rhs=ca.Function("rhs", e.s.inputs, [e.ode, e.alg], names, ["ode", "alg"]))

    @cached_property
    def _equations(self) -> _Equations:
        compiled = self.free.compiled
        s = Symbols(compiled)
        none = ca.SX(0, 1)
        if not self.holds:
            ode, alg = compiled.rhs(*s.inputs)
            return _Equations(s, ode, alg, none, none, none, none, ())
        mu = ca.SX.sym("mu", len(self.holds))
        m = ca.SX(s.m)
        for k, hold in enumerate(self.holds):
            if hold.target is None:
                m[self.first + hold.relation] = mu[k]
        free, alg = compiled.blended(s.t, s.x, s.z, s.u, s.p, m)
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
        ode, alg = (ca.densify(ca.substitute(e, mu, solved)) for e in (ode, alg))
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
