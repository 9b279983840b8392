"""A model's functions in minimal coordinates: two states for each degree of freedom.

If every stabilised constraint keeps states on a circle, angles replace these states (`coordinates.py`). Otherwise the
states that the constraints determine become algebraic variables, with the constraints as their equations. The result
has index 1, because the constraints of all levels determine as many states as there are constraints. It is valid until
the choice of dependent states, made at the start, becomes singular.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg

from acausal.arrays import Vector
from acausal.export.minimal.coordinates import coordinates_of
from acausal.export.minimal.manifold import minimal
from acausal.lower.casadi_model import Ports
from acausal.lower.compiled import CompiledModel
from acausal.simulate.start.initialize import Start


@dataclass(frozen=True, eq=False)
class Form:
    """`dae`, `init`, `invariants`, x and z of a `CasadiModel`; `bound`: indices in p of values on which it depends."""

    dae: Any
    init: Any
    invariants: Any
    x: Ports
    z: Ports
    bound: frozenset[int] = frozenset()
    notes: tuple[str, ...] = ()


def invariants_of(compiled: CompiledModel, functions: Any) -> Any:
    """Function `(t, x, z, u, p) -> (position, velocity)`: residuals of stabilised constraints, and their derivatives.

    `functions`: the `dae` of the model, whose arguments it shares.
    """
    arguments = functions.sx_in()
    g = compiled.constraints(*arguments, compiled.all_modes(*arguments))[0]
    structure = compiled.solution.structure
    stated = [k for k, (e, _) in enumerate(structure.invariants) if e not in structure.integral]
    derived = [k for k in range(len(structure.invariants)) if k not in stated]
    levels = [ca.densify(g[rows]) if rows else ca.SX(0, 1) for rows in (stated, derived)]
    return ca.Function("invariants", arguments, levels, functions.name_in(), ["position", "velocity"])


def minimal_form(compiled: CompiledModel, form: Form, point: tuple[float, Vector, Vector, Vector, Vector]) -> Form:
    """The form in minimal coordinates; unchanged if there are no stabilised constraints.

    `point`: `(t, x, z, u, p)`, a time [s] and vectors of shapes (nx,), (nz,), (nu,), (np,).

    Raises ExportError: AC604 when the constraints depend on each other at the point.
    """
    if not compiled.solution.structure.invariants:
        return form
    _, x, _, _, p = point
    coordinates = coordinates_of(compiled, form.x, x, p)
    if not coordinates.complete:
        return _with_dependent_states(compiled, form, point)
    start = coordinates.of(x[:, None]).ravel()
    ports = Ports(replace(port, start=float(s)) for port, s in zip(coordinates.ports, start, strict=True))
    parameters = ca.MX.sym("p", len(p))
    x0, z0 = form.init(parameters)
    init = ca.Function("init", [parameters], [coordinates.reduce(x0), z0], ["p"], ["x0", "z0"])
    bound = [compiled.parameters[k] for k in sorted(coordinates.bound)]
    notes = (
        (f"p does not contain {', '.join(bound)}: the angles are valid for their present values only",) if bound else ()
    )
    dae = coordinates.equations(form.dae)
    return Form(dae, init, _no_invariants(dae), ports, form.z, coordinates.bound, notes)


def _with_dependent_states(
    compiled: CompiledModel, form: Form, point: tuple[float, Vector, Vector, Vector, Vector]
) -> Form:
    """The form with dependent states as algebraic variables."""
    t, x, z, u, p = point
    m = np.array(compiled.all_modes(t, x, z, u, p)).ravel()
    places = list(minimal(compiled, t, Start(x, z, ()), u, p, m).places)
    dependent = [k for k in range(len(x)) if k not in places]
    names = form.dae.name_in()
    symbols = form.dae.sx_in()
    g = ca.vertcat(*form.invariants(*symbols))
    slopes = ca.Function("slopes", symbols, [ca.densify(ca.jacobian(g, symbols[1]))])
    slope = np.array(slopes(t, x, z, u, p))[:, dependent] * compiled.nominal_x[dependent]
    *_, order = scipy.linalg.qr(slope.T, mode="economic", pivoting=True)
    rows = sorted(order[: len(dependent)].tolist())
    c, w = ca.SX.sym("x", len(places)), ca.SX.sym("z", len(z) + len(dependent))
    algebraic, dependent_x = ca.vertsplit(w, [0, len(z), w.numel()])
    whole = ca.SX(len(x), 1)
    whole[places], whole[dependent] = c, dependent_x
    ode, alg, y = form.dae(symbols[0], whole, algebraic, *symbols[3:])
    constraints = ca.vertcat(*form.invariants(symbols[0], whole, algebraic, *symbols[3:]))[rows]
    dae = ca.Function(
        "dae",
        [symbols[0], c, w, *symbols[3:]],
        [ca.densify(v) for v in (ode[places], ca.vertcat(alg, constraints), y)],
        names,
        ["ode", "alg", "y"],
    )
    parameters = ca.MX.sym("p", len(p))
    x0, z0 = form.init(parameters)
    init = ca.Function("init", [parameters], [x0[places], ca.vertcat(z0, x0[dependent])], ["p"], ["x0", "z0"])
    moved = [form.x[k].name for k in dependent]
    notes = (f"constraints determine {', '.join(moved)}, which are algebraic variables",)
    x_ports, z_ports = (form.x[k] for k in places), (*form.z, *(form.x[k] for k in dependent))
    return Form(dae, init, _no_invariants(dae), Ports(x_ports), Ports(z_ports), notes=notes)


def _no_invariants(dae: Any) -> Any:
    """The function `invariants` of a model without stabilised constraints."""
    arguments = dae.sx_in()
    return ca.Function("invariants", arguments, [ca.SX(0, 1), ca.SX(0, 1)], dae.name_in(), ["position", "velocity"])
