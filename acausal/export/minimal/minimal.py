"""A model's functions with as many states as it has degrees of freedom, two for each.

Where every stabilised constraint keeps something on a circle, an angle replaces it (`coordinates.py`).
Elsewhere the states that the constraints determine become algebraic variables, and the constraints the equations that
they follow from: index 1, for the constraints of all levels bind as many states as they are. That holds as long as the
followers chosen at the start can follow, which is up to the next singular position.
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
    """`dae`, `init` and `invariants` of a `CasadiModel`, and its x and z; `bound` are places in p that it stands on."""

    dae: Any
    init: Any
    invariants: Any
    x: Ports
    z: Ports
    bound: frozenset[int] = frozenset()
    notes: tuple[str, ...] = ()


def invariants_of(compiled: CompiledModel, functions: Any) -> Any:
    """`(t, x, z, u, p) -> (position, velocity)`: stabilised constraints as stated, and differentiated.

    `functions` gives the symbols: the dae of the model.
    """
    arguments = functions.sx_in()
    g = compiled.constraints(*arguments, compiled.all_modes(*arguments))[0]
    structure = compiled.solution.structure
    stated = [k for k, (e, _) in enumerate(structure.invariants) if e not in structure.integral]
    rest = [k for k in range(len(structure.invariants)) if k not in stated]
    levels = [ca.densify(g[rows]) if rows else ca.SX(0, 1) for rows in (stated, rest)]
    return ca.Function("invariants", arguments, levels, functions.name_in(), ["position", "velocity"])


def minimal_form(compiled: CompiledModel, form: Form, point: tuple[float, Vector, Vector, Vector, Vector]) -> Form:
    """The form in minimal coordinates; itself where no constraint is stabilised. `point` is `(t, x, z, u, p)`.

    Raises ExportError: AC604 when the constraints depend on each other at the point.
    """
    if not compiled.solution.structure.invariants:
        return form
    _, x, _, _, p = point
    coordinates = coordinates_of(compiled, form.x, x, p)
    if not coordinates.complete:
        return _followed(compiled, form, point)
    start = coordinates.of(x[:, None]).ravel()
    ports = Ports(replace(port, start=float(s)) for port, s in zip(coordinates.ports, start, strict=True))
    parameters = ca.MX.sym("p", len(p))
    x0, z0 = form.init(parameters)
    init = ca.Function("init", [parameters], [coordinates.reduce(x0), z0], ["p"], ["x0", "z0"])
    bound = [compiled.parameters[k] for k in sorted(coordinates.bound)]
    notes = (f"p does not hold {', '.join(bound)}: angles stand on the values given here",) if bound else ()
    dae = coordinates.equations(form.dae)
    return Form(dae, init, _nothing(dae), ports, form.z, coordinates.bound, notes)


def _followed(compiled: CompiledModel, form: Form, point: tuple[float, Vector, Vector, Vector, Vector]) -> Form:
    """Followers as algebraic variables."""
    t, x, z, u, p = point
    m = np.array(compiled.all_modes(t, x, z, u, p)).ravel()
    places = list(minimal(compiled, t, Start(x, z, ()), u, p, m).places)
    followers = [k for k in range(len(x)) if k not in places]
    names = form.dae.name_in()
    symbols = form.dae.sx_in()
    g = ca.vertcat(*form.invariants(*symbols))
    slopes = ca.Function("slopes", symbols, [ca.densify(ca.jacobian(g, symbols[1]))])
    slope = np.array(slopes(t, x, z, u, p))[:, followers] * compiled.nominal_x[followers]
    *_, order = scipy.linalg.qr(slope.T, mode="economic", pivoting=True)
    rows = sorted(order[: len(followers)].tolist())
    c, w = ca.SX.sym("x", len(places)), ca.SX.sym("z", len(z) + len(followers))
    own, rest = ca.vertsplit(w, [0, len(z), w.numel()])
    whole = ca.SX(len(x), 1)
    whole[places], whole[followers] = c, rest
    ode, alg, y = form.dae(symbols[0], whole, own, *symbols[3:])
    bound = ca.vertcat(*form.invariants(symbols[0], whole, own, *symbols[3:]))[rows]
    dae = ca.Function(
        "dae",
        [symbols[0], c, w, *symbols[3:]],
        [ca.densify(v) for v in (ode[places], ca.vertcat(alg, bound), y)],
        names,
        ["ode", "alg", "y"],
    )
    parameters = ca.MX.sym("p", len(p))
    x0, z0 = form.init(parameters)
    init = ca.Function("init", [parameters], [x0[places], ca.vertcat(z0, x0[followers])], ["p"], ["x0", "z0"])
    moved = [form.x[k].name for k in followers]
    notes = (f"constraints determine {', '.join(moved)}, which are algebraic variables",)
    x_ports, z_ports = (form.x[k] for k in places), (*form.z, *(form.x[k] for k in followers))
    return Form(dae, init, _nothing(dae), Ports(x_ports), Ports(z_ports), notes=notes)


def _nothing(dae: Any) -> Any:
    """`invariants` where none is left."""
    arguments = dae.sx_in()
    return ca.Function("invariants", arguments, [ca.SX(0, 1), ca.SX(0, 1)], dae.name_in(), ["position", "velocity"])
