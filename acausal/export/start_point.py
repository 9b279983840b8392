"""Start of an exported model: its values as numbers, and as a function of the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError, InitializationError
from acausal.export.casadi.parts import newton
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.start.initialize import initialize


@dataclass(frozen=True, eq=False)
class StartPoint:
    """Start for the declared parameters and inputs: t [s], vectors x (nx,), z (nz,), u (nu,), p (np,), m (nm,)."""

    t: float
    x: Vector
    z: Vector
    u: Vector
    p: Vector
    m: Vector
    notes: tuple[str, ...]


def start_point(compiled: CompiledModel, p: Vector | None = None) -> StartPoint:
    """Solve the start problem; if it has no solution (an input may have to differ from 0), return its guesses.

    `p`: parameters, shape (np,); the declared ones by default.
    """
    t = compiled.flat.experiment.start_time
    p = np.array(compiled.parameter_values, dtype=float) if p is None else p
    u = np.array([input_start(compiled, scalar, p) for scalar in compiled.flat.inputs])
    m = np.array(compiled.modes(t, p)).ravel()
    try:
        start = initialize(compiled, t, p, u, m)
    except InitializationError as error:
        x, z = (np.array(v).ravel() for v in compiled.guess(p))
        return StartPoint(t, x, z, u, p, m, (f"start values are guesses only: {error.fact}",))
    return StartPoint(t, start.x, start.z, u, p, m, start.notes)


def input_start(compiled: CompiledModel, scalar: int, p: Vector) -> float:
    """Declared guess of the input `scalar` for parameters `p`, shape (np,); 0 without one."""
    start = compiled.flat.starts.get(scalar)
    if start is None:
        return 0.0
    leaves = {"par": p.__getitem__, "time": lambda _: compiled.flat.experiment.start_time}
    return float(values(compiled.flat.pool, [start.node], leaves)[start.node])


def init_function(compiled: CompiledModel, begin: StartPoint) -> Any:
    """Function `(p) -> (x0, z0)`: the consistent start; a rootfinder if conditions have to be solved."""
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
    # Newton's method begins at the start for the declared parameters, shifted by the change of the guesses.
    known_start = ca.DM(np.concatenate([begin.x[free], begin.z]))
    known_guess = ca.vertcat(*compiled.guess(begin.p))[free + list(range(n, n + nz))]
    first = ca.vertcat(x, z)[free + list(range(n, n + nz))] - known_guess + known_start
    solved: Any = root(first / ca.DM(scale), parameters) * ca.DM(scale)
    x0: Any = ca.MX(x)
    if free:
        x0[free] = solved[: len(free)]
    z0 = ca.vertsplit(solved, [0, len(free), len(scale)])[1]
    return ca.Function("init", [parameters], [x0, z0], ["p"], ["x0", "z0"])


def _start_root(compiled: CompiledModel, begin: StartPoint, free: list[int], scale: Vector) -> Any:
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
    function = ca.Function("start", [y, p], [residual], ["z", "q"], ["r"])
    known_start = ca.DM(np.concatenate([begin.x[free], begin.z]) / scale)
    return newton("start", function, known_start, ca.DM(begin.p))
