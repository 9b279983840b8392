"""A compiled model as a `CasadiModel`: switching times inlined, start conditions solved, every entry described."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.errors import ExportError, UsageError, nearest
from acausal.export.begin import Begin, begin_of, init_function
from acausal.export.casadi.events import events_of, notes_of
from acausal.export.casadi.parts import depends_on_time, implicit_of, narrowed, ode_of, outputs_of, step_of
from acausal.export.forms import BETWEEN, FUNCTIONS, check
from acausal.export.minimal.minimal import Form, invariants_of, minimal_form
from acausal.export.observed import dae_function
from acausal.export.ports import Output, named_outputs, output_ports, parameter_ports, variable_ports
from acausal.lower.casadi_model import EVENT_FUNCTIONS, CasadiModel, Ports
from acausal.lower.compiled import CompiledModel

Vector = NDArray[np.float64]


def casadi_model(
    compiled: CompiledModel,
    outputs: Sequence[str] | None = None,
    *,
    parameters: Sequence[str] | None = None,
    minimal: bool = False,
    events: bool = False,
) -> CasadiModel:
    """The CasADi functions of a compiled model.

    Parameters
    ----------
    outputs
        What y holds: names of variables as in a `Result`; an array stands for all its entries. None: the variables
        and signals declared in the model's own class, not those of its parts.
    parameters
        What p holds, in this order: decisions of an optimisation, by name. The others keep their declared values.
        None: all free parameters.
    minimal
        With as many states as degrees of freedom, two for each, see `acausal.export.minimal.minimal`.
    events
        With what happens at events; else models whose events act are refused.

    Raises
    ------
    UsageError
        AC010 for an unknown output, AC020 for an unknown parameter, AC053 for one that minimal coordinates stand on.
    ExportError
        AC603 when the start conditions do not determine as many values as are open, AC608 when events change what the
        functions depend on, AC613 for minimal coordinates of a model with events.
    """
    wanted = named_outputs(compiled, outputs)
    left_out = check(compiled, BETWEEN if events else FUNCTIONS, wanted)
    chosen = _chosen(compiled, parameters)
    begin = begin_of(compiled)
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
    made = _functions(compiled, form)
    reacting = {name: getattr(reactions, name) for name in EVENT_FUNCTIONS} if reactions else {}
    timed = depends_on_time([*made.values(), *(f for n, f in reacting.items() if n in ("dae", "indicators", "round"))])
    is_timed = timed or (events and bool(compiled.n_timely or compiled.state_events.samples))

    def last(function: Any) -> Any:
        return narrowed(function, None if is_timed else begin.t, chosen, begin.p)

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


def _form(compiled: CompiledModel, wanted: Sequence[Output], begin: Begin) -> Form:
    dae = dae_function(compiled, wanted)
    return Form(
        dae,
        init_function(compiled, begin),
        invariants_of(compiled, dae),
        variable_ports(compiled, compiled.state_variables, begin.x),
        variable_ports(compiled, compiled.solution.algebraic, begin.z),
    )


def _functions(compiled: CompiledModel, form: Form) -> dict[str, Any]:
    """All functions but those of events, with t and all parameters."""
    ode = ode_of(form.dae, np.array(form.z.start, dtype=float), np.array(form.z.nominal, dtype=float))
    return {
        "dae": form.dae,
        "ode": ode,
        "implicit": implicit_of(form.dae),
        "outputs": outputs_of(form.dae),
        "init": form.init,
        "step": step_of(ode),
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
    """Places in p of the parameters that stay."""
    if names is None:
        return None
    places = {name: k for k, name in enumerate(compiled.parameters)}
    for name in names:
        if name not in places:
            close = nearest(name, list(places))
            raise UsageError(
                "AC020",
                f"{compiled.name} has no free parameter '{name}'",
                evidence=[f"nearest  {', '.join(close)}"] if close else [],
                help=f"its free parameters: {', '.join(list(places)[:8]) or 'none'}",
            )
    return [places[name] for name in dict.fromkeys(names)]


def _refuse_minimal_events(compiled: CompiledModel, events: bool) -> None:
    if events and compiled.solution.structure.invariants:
        raise ExportError(
            "AC613",
            f"{compiled.name} is not exported in minimal coordinates with its events",
            cause="resets and guards are stated in the states of the model",
            help="leave out minimal=True: invariants says what binds the states",
        )


def _without_bound(
    compiled: CompiledModel, form: Form, chosen: list[int] | None, asked: Sequence[str] | None
) -> list[int] | None:
    """Parameters but those on whose values the coordinates stand."""
    if not form.bound:
        return chosen
    names = [name for name in asked or () if compiled.parameters.index(name) in form.bound]
    if names:
        raise UsageError(
            "AC053",
            f"{names[0]} cannot be an argument: the angle that replaces states stands on its value",
            help="leave it out of parameters=[...], or leave out minimal=True",
        )
    return chosen if chosen is not None else [k for k in range(len(compiled.parameters)) if k not in form.bound]
