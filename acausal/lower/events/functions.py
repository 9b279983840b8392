"""The functions of a compiled model that the event iteration asks for, and the words for its relations.

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
from acausal.flatten.text import to_text
from acausal.lower.build import Builder
from acausal.lower.events.impulses import struck
from acausal.lower.events.round import round_of
from acausal.lower.lowered import Lowered
from acausal.lower.symbols import Symbols

_INPUTS = ["t", "x", "z", "u", "p", "m"]
# Rounding of an instant and of the sides of its relation, by the time.
_SAME_INSTANT = 1e-15
AT_REST = 1.0
"""How far a relation that may rest is told to be from zero where its sides are equal."""
_TWIN = {"gt": "ge", "ge": "gt", "lt": "le", "le": "lt"}


class EventFunctions:
    """Made of one compiled model when they are first asked for."""

    def __init__(self, compiled: Lowered) -> None:
        self.compiled = compiled

    @cached_property
    def reactions(self) -> Any:
        """`-> (distance, assigned, conditions, values, remembered, asserts)` under given modes.

        `distance` is positive where a relation holds, one per relation; `assigned` are the values of the discrete
        equations; `conditions` the truth of `StateEvents.conditions` and `values` those of their actions in order;
        `remembered` what each `pre` will remember; `asserts` the truth of the assertions.
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
        outputs = [_column(self.told(self._distances(builder)))]
        outputs += [_column(builder.lower([builder.replaced(n) for n in group])) for group in groups]
        names = ["distance", "assigned", "conditions", "values", "remembered", "asserts"]
        return ca.Function("reactions", symbols.inputs, outputs, _INPUTS, names)

    @cached_property
    def round(self) -> Any:
        """One round of the event iteration: see `acausal.lower.events.round.Round`."""
        return round_of(self.compiled, self.reactions, Symbols(self.compiled))

    def struck(self, acting: Collection[int]) -> Any:
        """`-> dx[nx]`: what jumps when these actions act at once, as far as they are impulses."""
        return struck(self.compiled, acting)

    @cached_property
    def distances(self) -> Any:
        """`-> distance`, one per relation."""
        symbols, builder = self._defined()
        return ca.Function("distances", symbols.inputs, [_column(self._distances(builder))], _INPUTS, ["distance"])

    @cached_property
    def watch(self) -> Any:
        """`-> g`: the distances with the sign of their modes, positive while these hold."""
        symbols, builder = self._defined()
        distances = self.told(self._distances(builder))
        first = symbols.m.numel() - len(distances)
        g = [(2 * symbols.m[first + k] - 1) * v for k, v in enumerate(distances)]
        return ca.Function("watch", symbols.inputs, [_column(g)], _INPUTS, ["g"])

    @cached_property
    def rates(self) -> Any:
        """See `guard_rates`; of `watch`."""
        return guard_rates(self.compiled, self.watch)

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """The relations as the user reads them; twins have the same words, those of the strict one."""
        reduced = self.compiled.solution.structure.reduced

        def name_of(kind: str, k: int) -> str:
            return reduced.name(k) if kind == "var" else self.compiled.parameters[k]

        numbers = self.compiled.state_events.relations
        texts = [to_text(self._pool, n, name_of, 80) for n in numbers]
        strict = [next((j for j in t if self.ties[k] == 1), k) for k, t in enumerate(self.twins)]
        return tuple(texts[k] for k in strict)

    @property
    def ties(self) -> tuple[int, ...]:
        """What each relation is where its sides are equal, 0 or 1; -1 of one that is only watched."""
        events = self.compiled.state_events
        kinds = (self._pool.nodes[n][0] in ("le", "ge") for n in events.relations)
        return tuple(-1 if k in events.watched else int(holds) for k, holds in enumerate(kinds))

    @cached_property
    def twins(self) -> tuple[tuple[int, ...], ...]:
        """Of each relation those with the same sides that differ where these are equal, `x >= 0` of `x > 0`."""
        nodes = [self._pool.nodes[n] for n in self.compiled.state_events.relations]
        place = {node: k for k, node in enumerate(nodes)}
        found = (place.get((_TWIN[op], *sides)) for op, *sides in nodes)
        return tuple(() if k is None else (k,) for k in found)

    @cached_property
    def places(self) -> tuple[tuple[Span | None, str], ...]:
        """Place and component of the first statement that holds each relation."""
        compiled = self.compiled
        return tuple(origins(compiled.solution, compiled.state_events, compiled.delays, compiled.rewritten))

    def told(self, distances: Sequence[Any]) -> list[Any]:
        """Distances that tell what relations are: of one that may rest, one from zero where its sides are equal.

        Else it would come to zero and stay, and no sign would say that `force > 0` has ended.
        """
        resting = self.compiled.state_events.resting
        ends = {k: AT_REST if tie else -AT_REST for k, tie in enumerate(self.ties) if k in resting}
        return [ca.if_else(g == 0, ends[k], g) if k in ends else g for k, g in enumerate(distances)]

    def _defined(self) -> Any:
        symbols = Symbols(self.compiled)
        return symbols, symbols.defined(self.compiled)

    def _distances(self, builder: Any) -> list[Any]:
        found = []
        for number in self.compiled.state_events.relations:
            op, a, b = self._pool.nodes[number]
            left, right = builder.lower([builder.replaced(a), builder.replaced(b)])
            found.append(right - left if op in ("lt", "le") else left - right)
        return found

    @property
    def _pool(self) -> Any:
        return self.compiled.solution.structure.reduced.pool


def just_after(builder: Builder, events: TimeEvents) -> Any:
    """The truth of relations of time just after the builder's time, a column.

    At its instant a relation is as its sides go on from there: `time > p` and `time >= p` are the same, and so is
    `3*time > 3*p` where the products are rounded.
    """
    nodes = builder.pool.nodes
    now, instants, slopes = (builder.column(v) for v in (events.relations, events.instants, events.slopes))
    signs = ca.DM([1.0 if nodes[n][0] in ("gt", "ge") else -1.0 for n in events.relations])
    # One comparison, since optimal control asks how each goes inside of a phase: `is it the instant?` is false in all.
    reached = builder.time >= instants - _SAME_INSTANT * (ca.fabs(builder.time) + ca.fabs(instants))
    passed = ca.if_else(slopes * signs > 0, reached, ca.logic_not(reached))
    return ca.if_else(slopes != 0, passed, now)


def guard_rates(compiled: Lowered, watch: Any) -> Any:
    """`(t, x, z, u, p, m, ex, ez) -> (dg/dt without z, noise, dg/dz, dalg/dt without z, dalg/dz)` of guards g.

    Time derivatives along the solution, and how far the guards can be wrong when states and algebraic variables can be
    by `ex` and `ez`. Products, because there may be hundreds of guards and states.
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
