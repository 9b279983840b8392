"""Functions of a compiled model for the event iteration, and the texts of its relations for messages.

Arguments are those of the right-hand side, `(t, x[nx], z[nz], u[nu], p[np], m[nm])`; all outputs are dense columns.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property
from typing import Any

import casadi as ca

from acausal.analyse.events.state_events import origins
from acausal.analyse.events.time_events import TimeEvents
from acausal.errors import Span
from acausal.lower.build import Builder, Symbols
from acausal.lower.events.impulses import impulses, struck
from acausal.lower.events.round import round_of
from acausal.lower.lowered import Lowered

_INPUTS = ["t", "x", "z", "u", "p", "m"]
# Relative bound on the rounding errors of an instant and of the sides of its relation.
_INSTANT_TOLERANCE = 1e-15
AT_REST = 1.0
"""Distance of a relation that may rest, where its sides are equal."""
_TWIN = {"gt": "ge", "ge": "gt", "lt": "le", "le": "lt"}


class EventFunctions:
    """Event functions of one compiled model, each built on first use."""

    def __init__(self, compiled: Lowered) -> None:
        self.compiled = compiled

    @cached_property
    def reactions(self) -> Any:
        """`-> (distance, assigned, conditions, values, remembered, asserts)` for given modes.

        `distance` has one entry per relation, positive where it holds. `assigned` are the values of the discrete
        equations, `conditions` those of `StateEvents.conditions`, `values` those of all actions in order, `remembered`
        the next values of each `pre`, and `asserts` the values of the assertions.
        """
        symbols, builder = self._defined()
        events = self.compiled.state_events
        groups = (
            [a.node for a in events.assignments],
            events.conditions,
            [n for c in events.clauses for _, n in c.actions],
            [self._pool.nodes[n][1] for n in events.memories],
            [a.condition for a in events.asserts],
        )
        outputs = [_column(self.signed_at_rest(self._relation_distances(builder)))]
        outputs += [_column(builder.lower(builder.replaced(group))) for group in groups]
        names = ["distance", "assigned", "conditions", "values", "remembered", "asserts"]
        return ca.Function("reactions", symbols.inputs, outputs, _INPUTS, names)

    @cached_property
    def round(self) -> Any:
        """One round of the event iteration: see `acausal.lower.events.round.Round`."""
        return round_of(self.compiled, self.reactions, Symbols(self.compiled))

    def struck(self, acting: Collection[int]) -> Any:
        """`-> dx[nx]`: jump of the states when those of these actions that are impulses act together."""
        return struck(self.compiled, acting)

    @cached_property
    def distances(self) -> Any:
        """`-> distance`, one per relation."""
        symbols, builder = self._defined()
        return ca.Function(
            "distances", symbols.inputs, [_column(self._relation_distances(builder))], _INPUTS, ["distance"]
        )

    @cached_property
    def watch(self) -> Any:
        """`-> g`, one per relation: its distance with the sign of its mode, positive until the mode has to change."""
        symbols, builder = self._defined()
        distances = self.signed_at_rest(self._relation_distances(builder))
        first = symbols.m.numel() - len(distances)
        g = [(2 * symbols.m[first + k] - 1) * v for k, v in enumerate(distances)]
        return ca.Function("watch", symbols.inputs, [_column(g)], _INPUTS, ["g"])

    @cached_property
    def rates(self) -> Any:
        """`guard_rates` of `watch`."""
        return guard_rates(self.compiled, self.watch)

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """Texts of the relations for messages; twins share the text of the strict relation."""
        reduced = self.compiled.solution.structure.reduced
        events = self.compiled.state_events
        texts = [reduced.text(events.written.get(n, n)) for n in events.relations]
        strict = [next((j for j in t if self.ties[k] == 1), k) for k, t in enumerate(self.twins)]
        return tuple(texts[k] for k in strict)

    @cached_property
    def ties(self) -> tuple[int, ...]:
        """Value of each relation where its sides are equal, 0 or 1; -1 for a kink that is only located."""
        events = self.compiled.state_events
        kinds = (self._pool.nodes[n][0] in ("le", "ge") for n in events.relations)
        return tuple(-1 if k in events.watched else int(holds) for k, holds in enumerate(kinds))

    @cached_property
    def timed(self) -> tuple[bool, ...]:
        """Whether each relation depends on time and parameters alone."""
        varying = {k for i in (1, 2, 3, 5) for k in self.distances.jac_sparsity(0, i).get_triplet()[0]}
        return tuple(k not in varying for k in range(len(self.compiled.state_events.relations)))

    @cached_property
    def twins(self) -> tuple[tuple[int, ...], ...]:
        """For each relation, those that differ from it only where the sides are equal, such as `x >= 0` and `x > 0`."""
        nodes = [self._pool.nodes[n] for n in self.compiled.state_events.relations]
        index_of = {node: k for k, node in enumerate(nodes)}
        twin_indices = (index_of.get((_TWIN[op], *sides)) for op, *sides in nodes)
        return tuple(() if k is None else (k,) for k in twin_indices)

    @cached_property
    def places(self) -> tuple[tuple[Span | None, str], ...]:
        """Place and component of the first statement that contains each relation."""
        compiled = self.compiled
        return tuple(origins(compiled.solution, compiled.state_events, compiled.delays, compiled.rewritten))

    @cached_property
    def resetting(self) -> tuple[frozenset[int], ...]:
        """For each relation, the indices of the `when`s on it alone that reset something.

        Indices instead of clauses, because equal systems share these functions, and their clauses have other names.
        """
        clauses_of: dict[int, set[int]] = {}
        for k, clause in enumerate(self.compiled.state_events.clauses):
            if clause.actions and len(clause.conditions) == 1:
                clauses_of.setdefault(clause.conditions[0], set()).add(k)
        return tuple(frozenset(clauses_of.get(node, ())) for node in self.compiled.state_events.relations)

    @cached_property
    def struck_by(self) -> frozenset[int]:
        """Relations for which such a `when` contains an impulse."""
        hits = {k for _, k in impulses(self.compiled)}
        return frozenset(k for k, clauses in enumerate(self.resetting) if hits & clauses)

    def signed_at_rest(self, distances: Sequence[Any]) -> list[Any]:
        """Distances whose sign determines the relation, even at rest, where the sides stay equal.

        A distance that reached zero and stayed there would not show that `force > 0` no longer holds.
        """
        resting = self.compiled.state_events.resting
        ends = {k: AT_REST if tie else -AT_REST for k, tie in enumerate(self.ties) if k in resting}
        return [ca.if_else(g == 0, ends[k], g) if k in ends else g for k, g in enumerate(distances)]

    def _defined(self) -> Any:
        symbols = Symbols(self.compiled)
        return symbols, symbols.defined(self.compiled)

    def _relation_distances(self, builder: Any) -> list[Any]:
        distances = []
        for number in self.compiled.state_events.relations:
            op, a, b = self._pool.nodes[number]
            left, right = builder.lower(builder.replaced((a, b)))
            distances.append(right - left if op in ("lt", "le") else left - right)
        return distances

    @property
    def _pool(self) -> Any:
        return self.compiled.solution.structure.reduced.pool


def just_after(builder: Builder, events: TimeEvents) -> Any:
    """Values of the relations of time just after the builder's time, as a column.

    At its instant a relation has the value that it takes right after. Thus `time > p` and `time >= p` are the same, and
    so is `3*time > 3*p`, in spite of the rounding of the products.
    """
    nodes = builder.pool.nodes
    value, instants, slopes = (builder.column(v) for v in (events.relations, events.instants, events.slopes))
    signs = ca.DM([1.0 if nodes[n][0] in ("gt", "ge") else -1.0 for n in events.relations])
    # A single comparison suffices: optimal control evaluates relations inside phases only, never at their instants.
    reached = builder.time >= instants - _INSTANT_TOLERANCE * (ca.fabs(builder.time) + ca.fabs(instants))
    passed = ca.if_else(slopes * signs > 0, reached, ca.logic_not(reached))
    return ca.if_else(slopes != 0, passed, value)


def guard_rates(compiled: Lowered, watch: Any) -> Any:
    """`(t, x, z, u, p, m, ex, ez) -> (dg/dt without z, noise, dg/dz, dalg/dt without z, dalg/dz)` of guards g.

    Time derivatives along the solution, and `noise`, the error bound of each guard for errors `ex` of states and `ez`
    of algebraic variables. Computed as directional derivatives, because there may be hundreds of guards and states.
    """
    s = Symbols(compiled)
    ode, alg = compiled.rhs(*s.inputs)
    g = watch(*s.inputs)
    error_x, error_z = ca.SX.sym("ex", s.x.numel()), ca.SX.sym("ez", s.z.numel())
    tx, rate = ca.vertcat(s.t, s.x), ca.vertcat(1, ode)
    by_x, by_z = ca.jacobian(g, s.x), ca.jacobian(g, s.z)
    noise = ca.fabs(by_x) @ error_x + ca.fabs(by_z) @ error_z
    parts = [ca.jtimes(g, tx, rate), noise, by_z, ca.jtimes(alg, tx, rate), ca.jacobian(alg, s.z)]
    return ca.Function("rates", [*s.inputs, error_x, error_z], [ca.densify(q) for q in parts])


def _column(entries: list[Any]) -> Any:
    return ca.densify(ca.vertcat(*entries)) if entries else ca.SX(0, 1)
