"""The event iteration of a step as expressions: what `acausal.simulate.iteration` does, with a fixed number of rounds.

In each round discrete equations are evaluated in the order of their dependence; then relations that do not hold flip;
where none had to, `when` clauses whose conditions have become true act, and `pre` remembers. A round in which nothing
has to happen changes nothing, so that modes which need fewer rounds lose nothing by the others; what is not settled
after the last one goes on at the next event.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from acausal.export.methods import Method
from acausal.lower.compiled import CompiledModel, Symbols

ROUNDS = 8
# States are taken to be known to this share of their values or nominal magnitudes where relations are judged.
_KNOWN = 1e-9


@dataclass(frozen=True, eq=False)
class Settling:
    """The event iteration of one model; `u` and `p` are the symbols of its inputs and parameters.

    `method` solves for the algebraic variables; its rates take `(t, x, z, u, p, m)`.
    """

    compiled: CompiledModel
    method: Method
    u: Any
    p: Any

    @property
    def samples(self) -> slice:
        """Place of the samples among the modes."""
        first = self.compiled.n_timely
        return slice(first, first + len(self.compiled.state_events.samples))

    @property
    def memories(self) -> slice:
        """Place of what `pre` remembers."""
        first = self.samples.stop
        return slice(first, first + len(self.compiled.state_events.memories))

    @property
    def relations(self) -> slice:
        """Place of the relations of variables."""
        last = self.compiled.n_modes
        return slice(last - len(self.compiled.state_events.relations), last)

    def settled(self, t: Any, x: Any, z: Any, m: Any, before: Any, samples: Any) -> tuple[Any, Any, Any]:
        """States, algebraic variables and modes after an event, from modes `m` that have changed already.

        `before` are the modes that held before it; `samples` says which samples are true now.
        """
        was = self._reactions(t, x, z, before)[2]
        m = ca.SX(m)
        m[self.samples] = samples
        for _ in range(ROUNDS):
            x, z, m, was = self._round(t, x, z, self.u, self.p, m, was)
        m = ca.SX(m)
        m[self.samples] = 0
        if self.samples.stop > self.samples.start and self.memories.stop > self.memories.start:
            m[self.memories] = self._reactions(t, x, z, m)[4]
        return x, z, m

    def _reactions(self, t: Any, x: Any, z: Any, m: Any) -> Any:
        return self.compiled.events.reactions(t, x, z, self.u, self.p, m)

    @cached_property
    def _round(self) -> Any:
        """`(t, x, z, u, p, m, was) -> (x, z, m, was)`."""
        s, events = Symbols(self.compiled), self.compiled.state_events
        was = ca.SX.sym("was", len(events.clauses))
        held = [s.u, s.p, s.m]
        z = self.method.algebraic(s.t, s.x, s.z, held)
        x = self._assigned(s, z)
        if events.assignments:
            z = self.method.algebraic(s.t, x, z, held)
        here = [s.t, x, z, *held]
        _, _, conditions, values, remembered, _ = self.compiled.events.reactions(*here)
        conditions = conditions > 0.5
        fresh = ca.logic_not(_any(remembered[k] != s.m[j] for k, j in enumerate(_places(self.memories))))
        wrong = self._wrong(here, fresh)
        still = ca.logic_not(_any(wrong))
        m, new = ca.SX(s.m), ca.SX(x)
        for k, j in enumerate(_places(self.relations)):
            m[j] = ca.if_else(wrong[k], 1 - s.m[j], s.m[j])
        for k, j in enumerate(_places(self.memories)):
            m[j] = ca.if_else(still, remembered[k], s.m[j])
        place = 0
        for k, clause in enumerate(events.clauses):
            acts = ca.logic_and(still, ca.logic_and(conditions[k], was[k] < 0.5))
            for position, _ in clause.actions:
                new[position] = ca.if_else(acts, values[place], new[position])
                place += 1
        became = ca.if_else(still, conditions, was) if events.clauses else was
        outputs: Any = ca.cse([ca.densify(v) for v in (new, z, m, became)])
        return ca.Function("round", [*s.inputs, was], outputs)

    def _assigned(self, s: Any, z: Any) -> Any:
        """States with the discrete equations evaluated, each after those it depends on."""
        positions = [a.position for a in self.compiled.state_events.assignments]
        x = ca.SX(s.x)
        if not positions:
            return x
        assigned = ca.Function("assigned", s.inputs, [self.compiled.events.reactions(*s.inputs)[1]])
        needs = np.array(ca.DM(assigned.jac_sparsity(0, 1), 1.0))[:, positions] != 0
        for group in _in_order(needs):
            found = assigned(s.t, x, z, s.u, s.p, s.m)
            x = ca.SX(x)
            for k in group:
                x[positions[k]] = found[k]
        return x

    def _wrong(self, here: Sequence[Any], fresh: Any) -> list[Any]:
        """Relations that do not hold, or are at their guard and about not to; the latter once `pre` is up to date."""
        g = self.compiled.events.watch(*here)
        rate, noise = self.rates(*here)
        found = []
        for k in range(g.numel()):
            leaves = ca.logic_and(fresh, ca.logic_and(g[k] <= noise[k], rate[k] < -noise[k]))
            found.append(ca.logic_or(g[k] < -2 * noise[k], leaves))
        return found

    def rates(self, t: Any, x: Any, z: Any, u: Any, p: Any, m: Any) -> tuple[Any, Any]:
        """Time derivatives of the guards along the solution, and how far these can be wrong by rounding."""
        nominal_x, nominal_z = ca.DM(self.compiled.nominal_x), ca.DM(self.compiled.nominal_z)
        errors = [_KNOWN * (ca.fabs(v) + n) for v, n in ((x, nominal_x), (z, nominal_z))]
        own, noise, by_z, alg, alg_z = self.compiled.events.rates(t, x, z, u, p, m, *errors)
        if z.numel():
            own = own - by_z @ ca.solve(ca.sparsify(alg_z), alg)
        return own, noise + 1e-15


def _places(part: slice) -> range:
    return range(part.start, part.stop)


def _any(conditions: Any) -> Any:
    found: Any = ca.SX(0)
    for condition in conditions:
        found = ca.logic_or(found, condition)
    return found


def _in_order(needs: Any) -> list[list[int]]:
    """Rows of a square matrix of dependences in groups, each after those it needs; rows in a circle come repeatedly."""
    count, label = connected_components(csr_matrix(needs), connection="strong")
    level = np.zeros(count, dtype=int)
    for _ in range(count):  # longest paths; the graph of the components has no circle
        for i, j in zip(*np.nonzero(needs), strict=True):
            if label[i] != label[j]:
                level[label[i]] = max(level[label[i]], level[label[j]] + 1)
    found: list[list[int]] = []
    for here in range(int(level.max()) + 1):
        group = [int(k) for k in np.flatnonzero(level[label] == here)]
        longest = max(int((label == label[k]).sum()) for k in group)
        found += [group] * longest
    return found
