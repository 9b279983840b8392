"""What happens at the events of a model as CasADi functions: `CasadiEvents`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.export.begin import Begin
from acausal.export.casadi.finite import finite
from acausal.export.observed import observed_function
from acausal.export.ports import Output
from acausal.export.step.hybrid_step import HybridStep
from acausal.export.step.methods import Method
from acausal.flatten.text import to_text
from acausal.lower.casadi_model import CasadiEvents, Port, Ports
from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols

_ARGUMENTS = ["t", "x", "z", "u", "p", "m"]
# No step is taken: relations of time hold from their instants on.
_INSTANT = 1e-9
# An integrator that carries discrete variables as states of rate zero may move them by this share in rounding.
_ROUNDING = 1e-9


def events_of(compiled: CompiledModel, wanted: Sequence[Output]) -> tuple[CasadiEvents, Begin]:
    """The functions, and the start after its events.

    Raises
    ------
    ExportError
        AC610 for friction elements that share what statics leave open.
    """
    s = Symbols(compiled)
    rates = compiled.rhs(*s.inputs)
    method = Method("rk4", ca.Function("rates", s.inputs, [ca.densify(v) for v in rates]))
    u, p = ca.MX.sym("u", len(compiled.inputs)), ca.MX.sym("p", len(compiled.parameters))
    hybrid = HybridStep(compiled, method, u, p, _INSTANT)
    begin = hybrid.begin()
    y = observed_function(compiled, wanted)(*s.inputs)
    dae = ca.Function("dae", s.inputs, [ca.densify(v) for v in (*rates, y)], _ARGUMENTS, ["ode", "alg", "y"])
    watch = ca.Function("indicators", s.inputs, [compiled.events.watch(*s.inputs)], _ARGUMENTS, ["g"])
    react, clocks = _react(compiled, hybrid), _clocks(compiled)
    found = CasadiEvents(finite(dae), finite(watch), react, clocks, compiled.events.round, _modes(compiled, begin))
    return found, begin


def notes_of(compiled: CompiledModel) -> tuple[str, ...]:
    """What a loop around these functions has to see to."""
    events = compiled.state_events
    resets = any(position < compiled.n_dynamic for clause in events.clauses for position, _ in clause.actions)
    notes = [
        "dae, ode, implicit, outputs, step and invariants hold between events; what happens there is in events",
        "init is the start before its events, x.start, z.start and events.m.start after them",
    ]
    if resets or events.relations:
        notes.append("events that follow one another ever faster, and sliding, are not ended: that is the loop's")
    if events.flags:
        notes.append("initial() and terminal() are false in events")
    return tuple(notes)


def _react(compiled: CompiledModel, hybrid: HybridStep) -> Any:
    """`(t, x, z, u, p, m, ticks) -> (x, z, m, settled)` after an instant."""
    settling = hybrid.settling
    sizes = (1, len(compiled.states), len(compiled.algebraic), len(compiled.inputs), len(compiled.parameters))
    t, x, z, u, p = (ca.MX.sym(n, k) for n, k in zip("txzup", sizes, strict=True))
    m, ticks = ca.MX.sym("m", compiled.n_modes), ca.MX.sym("ticks", settling.samples.stop - settling.samples.start)
    parts = [0, compiled.n_timely, compiled.n_modes]
    after = ca.vertcat(ca.vertsplit(compiled.modes(t, p), parts)[0], ca.vertsplit(m, parts)[1])
    found = settling.settled(t, _unmoved(compiled)(x, m), z, u, p, after, m, ticks, 0)
    return ca.Function(
        "react", [t, x, z, u, p, m, ticks], found, [*_ARGUMENTS, "ticks"], ["x_after", "z_after", "m_after", "settled"]
    )


def _unmoved(compiled: CompiledModel) -> Any:
    """`(x, m) -> x`: discrete variables as the last event left them, where an integrator has moved them by rounding.

    `change(d)` and `edge(b)` ask whether a value is exactly what it was; `pre(d)` and whole numbers are known exactly.
    """
    s, events, reduced = Symbols(compiled), compiled.state_events, compiled.solution.structure.reduced
    x, first = ca.SX(s.x), compiled.n_timely + len(events.samples)
    nodes = reduced.pool.nodes
    known = {nodes[nodes[n][1]]: s.m[first + k] for k, n in enumerate(events.memories)}
    for k in range(len(compiled.states) - compiled.discretes, len(compiled.states)):
        v = compiled.state_variables[k]
        declared = reduced.flat.declaration(reduced.scalar[v])
        exact = known.get(("var", v))
        if exact is None and (declared.boolean or declared.integer):
            exact = ca.floor(s.x[k] + 0.5)
        if exact is not None:
            moved = ca.fabs(s.x[k] - exact) > _ROUNDING * (ca.fabs(exact) + compiled.nominal_x[k])
            x[k] = ca.if_else(moved, s.x[k], exact)
    return ca.Function("unmoved", [s.x, s.m], [ca.densify(x)])


def _clocks(compiled: CompiledModel) -> Any:
    """`(p) -> (first, interval)`."""
    pool, s = compiled.solution.structure.reduced.pool, Symbols(compiled)
    builder = s.builder(compiled)
    pairs = [builder.lower(pool.nodes[n][1:]) for n in compiled.state_events.samples]
    columns = [ca.densify(ca.vertcat(ca.SX(0, 1), *(pair[k] for pair in pairs))) for k in range(2)]
    return ca.Function("clocks", [s.p], columns, ["p"], ["first", "interval"])


def _modes(compiled: CompiledModel, begin: Begin) -> Ports:
    reduced = compiled.solution.structure.reduced

    def name_of(kind: str, k: int) -> str:
        return reduced.name(k) if kind == "var" else compiled.parameters[k]

    found = [Port("")] * compiled.n_modes
    for j, node in zip(compiled.mode_places, compiled.mode_nodes, strict=True):
        op = reduced.pool.nodes[node][0]
        doc = "What is remembered of the last event" if op == "pre" else "1 where this holds"
        found[j] = Port(to_text(reduced.pool, node, name_of, 80), "", doc, float(begin.m[j]))
    return Ports(found)
