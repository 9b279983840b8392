"""Construction of a `CasadiModel` from a compiled model: functions, start values and ports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError, UsageError, meant
from acausal.export.casadi.finite import finite
from acausal.export.casadi.parts import (
    depends_on_time,
    implicit_of,
    ode_of,
    outputs_of,
    step_error_of,
    step_of,
    too_large_of,
    with_fixed_arguments,
)
from acausal.export.forms import BETWEEN, FUNCTIONS, check
from acausal.export.minimal.minimal import Form, invariants_of, minimal_form
from acausal.export.observed import dae_function, observed_function
from acausal.export.ports import Output, named_outputs, output_ports, parameter_ports, variable_ports
from acausal.export.start_point import StartPoint, init_function, start_point
from acausal.export.step.crossing import determinants
from acausal.export.step.hybrid_step import HybridStep
from acausal.export.step.methods import Method
from acausal.lower.build import Symbols
from acausal.lower.cache.divisors import refusal
from acausal.lower.casadi_model import EVENT_FUNCTIONS, CasadiEvents, CasadiModel, Port, Ports
from acausal.lower.compiled import CompiledModel

_SEVERAL = (
    "algebraic equations are nonlinear in their own unknowns: where a sign in determinants changes along a solution, "
    "or a determinant is zero, other solutions meet it, and nothing else here tells which of them is followed"
)


def casadi_model(
    compiled: CompiledModel,
    outputs: Sequence[str] | None = None,
    *,
    parameters: Sequence[str] | None = None,
    minimal: bool = False,
    events: bool = False,
) -> CasadiModel:
    """Create the CasADi functions of a compiled model.

    Parameters
    ----------
    outputs
        Entries of y: names of variables as in a `Result`; an array stands for all its entries. None: the variables
        and signals declared in the model's own class, not those of its parts.
    parameters
        Entries of p, in this order: decisions of an optimisation, by name. The others keep their declared values.
        None: all free parameters.
    minimal
        Whether to use minimal coordinates, two states for each degree of freedom, see `acausal.export.minimal.minimal`.
    events
        Whether to include what happens at events; without it, models whose events change variables are refused.

    Raises
    ------
    UsageError
        AC010 for an unknown output, AC020 for an unknown parameter, AC053 for one that minimal coordinates depend on.
    ExportError
        AC603 when the number of start conditions is not the number of undetermined start values, AC608 when events
        change variables that the functions depend on, AC613 for minimal coordinates of a model with events.
    """
    wanted = named_outputs(compiled, outputs)
    left_out = check(compiled, BETWEEN if events else FUNCTIONS, wanted)
    chosen = _chosen(compiled, parameters)
    begin = start_point(compiled)
    reactions = None
    notes = [*compiled.flat.notes, *begin.notes, *left_out]
    form = _form(compiled, wanted, begin)
    if events:
        reactions, after = events_of(compiled, wanted)
        notes += notes_of(compiled)
        form = replace(form, x=_started(form.x, after.x), z=_started(form.z, after.z))
    if minimal:
        _refuse_minimal_events(compiled, events)
        form = minimal_form(compiled, form, (begin.t, begin.x, begin.z, begin.u, begin.p))
        chosen = _without_bound(compiled, form, chosen, parameters)
        notes += form.notes
    made = _functions(compiled, form, begin)
    if made["determinants"].numel_out(0):
        notes.append(_SEVERAL)
    reacting = {name: getattr(reactions, name) for name in EVENT_FUNCTIONS} if reactions else {}
    timed = depends_on_time([*made.values(), *(f for n, f in reacting.items() if n in ("dae", "indicators", "round"))])
    is_timed = timed or (events and bool(compiled.n_timely or compiled.state_events.samples))

    refused = refusal(compiled, chosen)

    def last(function: Any) -> Any:
        return with_fixed_arguments(function, None if is_timed else begin.t, chosen, begin.p, refused)

    y = np.array(form.dae(begin.t, form.x.start, form.z.start, begin.u, begin.p)[2]).ravel() + 0.0  # no -0.0
    ports = parameter_ports(compiled)
    return CasadiModel(
        name=compiled.name,
        **{name: last(function) for name, function in made.items()},
        x=form.x,
        z=form.z,
        u=variable_ports(compiled, compiled.solution.structure.reduced.inputs, begin.u),
        p=ports if chosen is None else Ports(ports[k] for k in chosen),
        y=output_ports(wanted, y),
        events=replace(reactions, **{n: last(f) for n, f in reacting.items()}) if reactions else None,
        start_time=begin.t,
        notes=tuple(notes),
    )


def _form(compiled: CompiledModel, wanted: Sequence[Output], begin: StartPoint) -> Form:
    dae = dae_function(compiled, wanted)
    return Form(
        dae,
        init_function(compiled, begin),
        invariants_of(compiled, dae),
        variable_ports(compiled, compiled.state_variables, begin.x),
        variable_ports(compiled, compiled.solution.algebraic, begin.z),
    )


def _functions(compiled: CompiledModel, form: Form, begin: StartPoint) -> dict[str, Any]:
    """All functions except those of events, with t and all parameters as arguments."""
    at = begin.t, form.x.start, begin.u, begin.p
    ode = ode_of(form.dae, np.array(form.z.start, dtype=float), np.array(form.z.nominal, dtype=float), at)
    return {
        "dae": form.dae,
        "ode": ode,
        "implicit": implicit_of(form.dae),
        "outputs": outputs_of(form.dae),
        "init": form.init,
        "step": step_of(ode),
        "too_large": too_large_of(ode, form.x.nominal),
        "step_error": step_error_of(ode, form.x.nominal),
        "determinants": determinants(form.dae),
        "invariants": form.invariants,
        "instants": ca.Function("instants", *_instants(compiled), ["p"], ["times"]),
    }


def _instants(compiled: CompiledModel) -> tuple[list[Any], list[Any]]:
    p = ca.SX.sym("p", len(compiled.parameters))
    times = compiled.instants(p)
    return [p], [ca.densify(times)]


def _started(ports: Ports, values: Vector) -> Ports:
    return Ports(replace(port, start=float(v)) for port, v in zip(ports, values, strict=True))


def _chosen(compiled: CompiledModel, names: Sequence[str] | None) -> list[int] | None:
    """Indices in p of the parameters that remain arguments; None for all."""
    if names is None:
        return None
    places = {name: k for k, name in enumerate(compiled.parameters)}
    for name in names:
        if name not in places:
            raise UsageError(
                "AC020",
                f"{compiled.name} has no free parameter '{name}'",
                evidence=meant(name, list(places)),
                help=f"its free parameters: {', '.join(list(places)[:8]) or 'none'}",
            )
    return [places[name] for name in dict.fromkeys(names)]


def _refuse_minimal_events(compiled: CompiledModel, events: bool) -> None:
    if events and compiled.solution.structure.invariants:
        raise ExportError(
            "AC613",
            f"{compiled.name} is not exported in minimal coordinates with its events",
            cause="resets and guards are stated in the states of the model",
            help="leave out minimal=True: the function invariants has the constraints on the states",
        )


def _without_bound(
    compiled: CompiledModel, form: Form, chosen: list[int] | None, asked: Sequence[str] | None
) -> list[int] | None:
    """Indices of the remaining parameters without those on whose values the minimal coordinates depend."""
    if not form.bound:
        return chosen
    names = [name for name in asked or () if compiled.parameters.index(name) in form.bound]
    if names:
        raise UsageError(
            "AC053",
            f"{names[0]} cannot be an argument: the angle that replaces states depends on its value",
            help="leave it out of parameters=[...], or leave out minimal=True",
        )
    return chosen if chosen is not None else [k for k in range(len(compiled.parameters)) if k not in form.bound]


_ARGUMENTS = ["t", "x", "z", "u", "p", "m"]
# Step size for functions that take no step: relations of time hold from their instants on.
_INSTANT = 1e-9
# Relative rounding error of discrete variables that an integrator treats as states of rate zero.
_ROUNDING = 1e-9


def events_of(compiled: CompiledModel, wanted: Sequence[Output]) -> tuple[CasadiEvents, StartPoint]:
    """The functions of events, and the start after its events.

    Raises ExportError: AC610 if the distribution of a load among friction elements is statically indeterminate.
    """
    s = Symbols(compiled)
    rates = compiled.rhs(*s.inputs)
    nominal = ca.vertcat(ca.DM(compiled.nominal_x), ca.DM(compiled.nominal_z))
    method = Method("rk4", ca.Function("rates", s.inputs, [ca.densify(v) for v in rates]), nominal)
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
    """Notes on what a user-written loop around these functions must handle."""
    events = compiled.state_events
    resets = any(position < compiled.n_dynamic for clause in events.clauses for position, _ in clause.actions)
    notes = [
        "dae, ode, implicit, outputs, step and invariants hold between events; what happens there is in events",
        "init is the start before its events, x.start, z.start and events.m.start after them, for p.start",
    ]
    if resets or events.relations:
        notes.append(
            "events that follow one another ever faster, and sliding modes, are not resolved: the caller's loop has to"
        )
    if events.flags:
        notes.append(
            "initial() and terminal() are false in events: x.start, z.start and events.m.start are those "
            "after initial() for the declared parameters; for others, the caller's loop has to set what initial() sets"
        )
    return tuple(notes)


def _react(compiled: CompiledModel, hybrid: HybridStep) -> Any:
    """Function `(t, x, z, u, p, m, ticks) -> (x, z, m, settled)`: the values after the events of an instant.

    An integer variable that gets a fractional value becomes nan.
    """
    settling = hybrid.settling
    sizes = (1, len(compiled.states), len(compiled.algebraic), len(compiled.inputs), len(compiled.parameters))
    t, x, z, u, p = (ca.MX.sym(n, k) for n, k in zip("txzup", sizes, strict=True))
    m, ticks = ca.MX.sym("m", compiled.n_modes), ca.MX.sym("ticks", settling.samples.stop - settling.samples.start)
    parts = [0, compiled.n_timely, compiled.n_modes]
    after = ca.vertcat(ca.vertsplit(compiled.modes(t, p), parts)[0], ca.vertsplit(m, parts)[1])
    x_after, *rest = settling.settled(t, _without_rounding(compiled)(x, m), z, u, p, after, m, ticks, 0)
    results = [hybrid.whole_numbers(x_after), *rest]
    names = ["x_after", "z_after", "m_after", "settled"]
    return ca.Function("react", [t, x, z, u, p, m, ticks], results, [*_ARGUMENTS, "ticks"], names)


def _without_rounding(compiled: CompiledModel) -> Any:
    """Function `(x, m) -> x` that removes the rounding errors of an integrator from discrete variables.

    `change(d)` and `edge(b)` compare values exactly. The exact value is that of `pre(d)`, or the nearest integer of a
    boolean or integer.
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
    return ca.Function("without_rounding", [s.x, s.m], [ca.densify(x)])


def _clocks(compiled: CompiledModel) -> Any:
    """Function `(p) -> (first, interval)`: first instant and interval [s] of each sample."""
    pool, s = compiled.solution.structure.reduced.pool, Symbols(compiled)
    builder = s.builder(compiled)
    pairs = [builder.lower(pool.nodes[n][1:]) for n in compiled.state_events.samples]
    columns = [ca.densify(ca.vertcat(ca.SX(0, 1), *(pair[k] for pair in pairs))) for k in range(2)]
    return ca.Function("clocks", [s.p], columns, ["p"], ["first", "interval"])


def _modes(compiled: CompiledModel, begin: StartPoint) -> Ports:
    reduced = compiled.solution.structure.reduced
    found = [Port("")] * compiled.n_modes
    for j, node in zip(compiled.mode_places, compiled.mode_nodes, strict=True):
        op = reduced.pool.nodes[node][0]
        doc = "What is remembered of the last event" if op == "pre" else "1 where this holds"
        found[j] = Port(reduced.text(node), "", doc, float(begin.m[j]))
    return Ports(found)
