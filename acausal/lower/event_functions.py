"""The functions of a compiled model that the event iteration asks for.

Arguments are those of the right-hand side, `(t, x[nx], z[nz], u[nu], p[np], m[nm])`; all outputs are dense columns.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca

if TYPE_CHECKING:
    from acausal.lower.compiled import CompiledModel

_INPUTS = ["t", "x", "z", "u", "p", "m"]


class EventFunctions:
    """Made of one compiled model when they are first asked for."""

    def __init__(self, compiled: CompiledModel) -> None:
        self.compiled = compiled

    @cached_property
    def reactions(self) -> Any:
        """`-> (distance, assigned, conditions, values, remembered, asserts)` under given modes.

        `distance` is positive where a relation holds, one per relation; `assigned` are the values of the discrete
        equations; `conditions` the truth of the `when` clauses and `values` those of their actions in order;
        `remembered` what each `pre` will remember; `asserts` the truth of the assertions.
        """
        symbols, builder = self._defined()
        events = self.compiled.state_events
        groups = (
            [a.node for a in events.assignments],
            [c.condition for c in events.clauses],
            [n for c in events.clauses for _, n in c.actions],
            [self._pool.nodes[n][1] for n in events.memories],
            [a.condition for a in events.asserts],
        )
        outputs = [_column(self._distances(builder))]
        outputs += [_column(builder.lower([builder.replaced(n) for n in group])) for group in groups]
        names = ["distance", "assigned", "conditions", "values", "remembered", "asserts"]
        return ca.Function("reactions", symbols.inputs, outputs, _INPUTS, names)

    @cached_property
    def distances(self) -> Any:
        """`-> distance`, one per relation."""
        symbols, builder = self._defined()
        return ca.Function("distances", symbols.inputs, [_column(self._distances(builder))], _INPUTS, ["distance"])

    @cached_property
    def rates(self) -> Any:
        """`-> (dv/dt without z, dv/dz, dalg/dt without z, dalg/dz, dv/dx)` of the distances v along the solution."""
        symbols, _ = self._defined()
        ode, alg = self.compiled.rhs(*symbols.inputs)
        v = self.distances(*symbols.inputs)
        tx, rate = ca.vertcat(symbols.t, symbols.x), ca.vertcat(1, ode)
        parts = [ca.jtimes(v, tx, rate), ca.jacobian(v, symbols.z), ca.jtimes(alg, tx, rate)]
        parts += [ca.jacobian(alg, symbols.z), ca.jacobian(v, symbols.x)]
        return ca.Function("rates", symbols.inputs, [ca.densify(q) for q in parts])

    def _defined(self) -> Any:
        from acausal.lower.compiled import Symbols

        symbols = Symbols(self.compiled)
        builder = symbols.builder(self.compiled)
        builder.define(self.compiled.solution.definitions, self.compiled.rewritten)
        return symbols, builder

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


def _column(entries: list[Any]) -> Any:
    return ca.densify(ca.vertcat(*entries)) if entries else ca.SX(0, 1)
