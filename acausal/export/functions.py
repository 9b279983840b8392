"""A compiled model as a `CasadiModel`: switching times inlined, start conditions solved, every entry described."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.errors import ExportError, InitializationError
from acausal.export.casadi_model import CasadiModel
from acausal.export.forms import FUNCTIONS, check
from acausal.export.ports import Output, named_outputs, output_ports, parameter_ports, variable_ports
from acausal.lower.compiled import CompiledModel, Symbols
from acausal.numeric.evaluate import values
from acausal.simulate.start.initialize import initialize

Vector = NDArray[np.float64]

# On variables divided by their nominal magnitude; residuals have units of their own, so the step decides.
_NEWTON = {"abstol": 1e-14, "abstolStep": 1e-11, "max_iter": 200, "error_on_fail": True}


def casadi_model(compiled: CompiledModel, outputs: Sequence[str] | None = None) -> CasadiModel:
    """The CasADi functions of a compiled model.

    Parameters
    ----------
    outputs
        What y holds: names of variables as in a `Result`; an array stands for all its entries. None: the variables
        and signals declared in the model's own class, not those of its parts.

    Raises
    ------
    UsageError
        AC010 for an unknown output.
    ExportError
        AC603 when the start conditions do not determine as many values as are open, AC608 when events change what the
        functions depend on.
    """
    wanted = named_outputs(compiled, outputs)
    left_out = check(compiled, FUNCTIONS, wanted)
    begin = begin_of(compiled)
    dae = dae_function(compiled, wanted)
    y = np.array(dae(begin.t, begin.x, begin.z, begin.u, begin.p)[2]).ravel() + 0.0  # no -0.0
    inputs = compiled.solution.structure.reduced.inputs
    return CasadiModel(
        name=compiled.name,
        dae=dae,
        ode=_ode(compiled, dae, begin),
        init=init_function(compiled, begin),
        instants=compiled.instants,
        x=variable_ports(compiled, compiled.state_variables, begin.x),
        z=variable_ports(compiled, compiled.solution.algebraic, begin.z),
        u=variable_ports(compiled, inputs, begin.u),
        p=parameter_ports(compiled),
        y=output_ports(wanted, y),
        start_time=begin.t,
        notes=(*compiled.flat.notes, *begin.notes, *left_out),
    )


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
    """`(t, x, z, u, p) -> (ode, alg, y)`."""
    s = Symbols(compiled)
    y = observed_function(compiled, outputs)
    arguments = [s.t, s.x, s.z, s.u, s.p]
    modes = compiled.all_modes(*arguments)
    found = [*compiled.rhs(*arguments, modes), y(*arguments, modes)]
    return ca.Function("dae", arguments, [ca.densify(v) for v in found], ["t", "x", "z", "u", "p"], ["ode", "alg", "y"])


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


def _ode(compiled: CompiledModel, dae: Any, begin: Begin) -> Any:
    """`(t, x, u, p) -> (xdot, y)`."""
    nz = len(compiled.algebraic)
    names, results = ["t", "x", "u", "p"], ["xdot", "y"]
    kind: Any = ca.MX if nz else ca.SX
    t, x, u, p = (kind.sym(n, dae.size1_in(n)) for n in names)
    if not nz:
        ode, _, y = dae(t, x, ca.SX(0, 1), u, p)
        return ca.Function("ode", [t, x, u, p], [ode, y], names, results)
    scale = ca.DM(compiled.nominal_z)
    z, q = ca.SX.sym("z", nz), ca.SX.sym("q", 1 + x.numel() + u.numel() + p.numel())
    parts = ca.vertsplit(q, np.cumsum([0, 1, x.numel(), u.numel(), p.numel()]).tolist())
    residual = ca.Function("residual", [z, q], [dae(parts[0], parts[1], z * scale, *parts[2:])[1]], ["z", "q"], ["r"])
    root = ca.rootfinder("algebraic", "newton", residual, _NEWTON)
    solved = root(ca.DM(begin.z) / scale, ca.vertcat(t, x, u, p)) * scale
    ode, _, y = dae(t, x, solved, u, p)
    return ca.Function("ode", [t, x, u, p], [ode, y], names, results)


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
    return ca.Function("init", [parameters], [x0, solved[len(free) :]], ["p"], ["x0", "z0"])


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
    return ca.rootfinder("start", "newton", function, _NEWTON)
