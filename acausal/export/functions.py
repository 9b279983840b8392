"""A compiled model as a `CasadiModel`: switching times inlined, start conditions solved, every entry described."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.errors import ExportError, InitializationError, UsageError, nearest
from acausal.export.finite import finite
from acausal.export.forms import BETWEEN, FUNCTIONS, check
from acausal.export.minimal import Form, invariants_of, minimal_form
from acausal.export.parts import NEWTON, depends_on_time, implicit_of, narrowed, ode_of, outputs_of, step_of
from acausal.export.ports import Output, named_outputs, output_ports, parameter_ports, variable_ports
from acausal.lower.casadi_model import EVENT_FUNCTIONS, CasadiModel, Ports
from acausal.lower.compiled import CompiledModel, Symbols
from acausal.numeric.evaluate import values
from acausal.simulate.start.initialize import initialize

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
        With as many states as degrees of freedom, two for each, see `acausal.export.minimal`.
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
    from acausal.export.events import events_of, notes_of

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


@dataclass(frozen=True, eq=False)
class Begin:
    """The model's start with its declared parameters and the start values of its inputs, and the modes it is in."""

    t: float
    x: Vector
    z: Vector
    u: Vector
    p: Vector
    m: Vector
    notes: tuple[str, ...]


def begin_of(compiled: CompiledModel, p: Vector | None = None) -> Begin:
    """Solve the start problem; where it has no solution (an input may have to differ from 0), take its guesses.

    `p` are the parameters, shape (np,), as declared by default.
    """
    t = compiled.flat.experiment.start_time
    p = np.array(compiled.parameter_values, dtype=float) if p is None else p
    u = np.array([input_start(compiled, scalar, p) for scalar in compiled.flat.inputs])
    m = np.array(compiled.modes(t, p)).ravel()
    try:
        start = initialize(compiled, t, p, u, m)
    except InitializationError as error:
        x, z = (np.array(v).ravel() for v in compiled.guess(p))
        return Begin(t, x, z, u, p, m, (f"start values are guesses only: {error.fact}",))
    return Begin(t, start.x, start.z, u, p, m, start.notes)


def input_start(compiled: CompiledModel, scalar: int, p: Vector) -> float:
    """Declared guess of an input, else 0."""
    start = compiled.flat.starts.get(scalar)
    if start is None:
        return 0.0
    leaves = {"par": p.__getitem__, "time": lambda _: compiled.flat.experiment.start_time}
    return float(values(compiled.flat.pool, [start.node], leaves)[start.node])


def dae_function(compiled: CompiledModel, outputs: Sequence[Output]) -> Any:
    """`(t, x, z, u, p) -> (ode, alg, y)`, with derivatives that are finite wherever its values are."""
    s = Symbols(compiled)
    y = observed_function(compiled, outputs)
    arguments = [s.t, s.x, s.z, s.u, s.p]
    modes = compiled.all_modes(*arguments)
    found = [*compiled.rhs(*arguments, modes), y(*arguments, modes)]
    names = ["t", "x", "z", "u", "p"], ["ode", "alg", "y"]
    return finite(ca.Function("dae", arguments, [ca.densify(v) for v in found], *names))


def observed_function(compiled: CompiledModel, outputs: Sequence[Output]) -> Any:
    """`(t, x, z, u, p, m) -> y`."""
    s = Symbols(compiled)
    image = compiled.solution.structure.reduced.image
    builder = s.builder(compiled)
    nodes = [image[output.scalar] for output in outputs]
    builder.define(_definitions(compiled, nodes), compiled.rewritten)
    observed = builder.lower([builder.replaced(n) for n in nodes])
    return ca.Function("y", s.inputs, [ca.vertcat(*observed) if observed else ca.SX(0, 1)])


def _definitions(compiled: CompiledModel, nodes: Sequence[int]) -> list[tuple[int, int]]:
    """The definitions that `nodes` need, in evaluation order."""
    pool = compiled.solution.structure.reduced.pool
    node_of = dict(compiled.solution.definitions)
    needed: set[int] = set()
    stack = list(pool.variables_in(*nodes))
    while stack:
        v = stack.pop()
        if v in node_of and v not in needed:
            needed.add(v)
            stack.extend(pool.variables_in(node_of[v]))
    return [d for d in compiled.solution.definitions if d[0] in needed]


def init_function(compiled: CompiledModel, begin: Begin) -> Any:
    """`(p) -> (x0, z0)`."""
    n, nz = len(compiled.states), len(compiled.algebraic)
    given = {*compiled.start.direct, *compiled.start.defaulted}
    free = [k for k, v in enumerate(compiled.state_variables) if v not in given]
    if not free and not nz:
        p = ca.SX.sym("p", len(compiled.parameters))
        return ca.Function("init", [p], list(compiled.guess(p)), ["p"], ["x0", "z0"])
    scale = np.concatenate([compiled.nominal_x[free], compiled.nominal_z])
    root = _start_root(compiled, begin, free, scale)
    parameters: Any = ca.MX.sym("p", len(compiled.parameters))
    x, z = compiled.guess(parameters)
    # From where the declared parameters' start was found, moved as the guesses move with the parameters.
    found = ca.DM(np.concatenate([begin.x[free], begin.z]))
    guessed = ca.vertcat(*compiled.guess(begin.p))[free + list(range(n, n + nz))]
    first = ca.vertcat(x, z)[free + list(range(n, n + nz))] - guessed + found
    solved: Any = root(first / ca.DM(scale), parameters) * ca.DM(scale)
    x0: Any = ca.MX(x)
    if free:
        x0[free] = solved[: len(free)]
    z0 = ca.vertsplit(solved, [0, len(free), len(scale)])[1]
    return ca.Function("init", [parameters], [x0, z0], ["p"], ["x0", "z0"])


def _start_root(compiled: CompiledModel, begin: Begin, free: list[int], scale: Vector) -> Any:
    """Rootfinder `(y0, p) -> y` for free states and algebraic variables at the start, divided by `scale`."""
    y, p = ca.SX.sym("y", len(scale)), ca.SX.sym("p", len(compiled.parameters))
    unknown = y * ca.DM(scale)
    x = compiled.guess(p)[0]
    for k, i in enumerate(free):
        x[i] = unknown[k]
    point = (begin.t, x, unknown[len(free) :], begin.u, p)
    arguments = (*point, compiled.all_modes(*point))
    residual = compiled.rhs(*arguments)[1]
    if free:
        residual = ca.vertcat(compiled.conditions(*arguments)[0], residual)
    if residual.numel() != len(scale):
        raise ExportError(
            "AC603",
            f"{residual.numel()} start conditions for {len(scale)} open values of {compiled.name}",
            evidence=[c.text for c in compiled.start.conditions[:6]],
            help="give the start values of states with fixed(...)",
        )
    function = ca.Function("start", [y, p], [residual], ["y", "p"], ["r"])
    return ca.rootfinder("start", "newton", function, NEWTON)
