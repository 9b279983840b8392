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
    """Solve the start problem; if it has no solution (inputs of 0 may not permit one), return the guesses with a note.

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
    """Function `(p) -> (x0, z0)`: the consistent start, by a rootfinder if conditions have to be solved.

    Raises ExportError: AC603 when there are more or fewer conditions than unknowns.
    """
    n, nz = len(compiled.states), len(compiled.algebraic)
    given = {*compiled.start.direct, *compiled.start.defaulted}
    free = [k for k, v in enumerate(compiled.state_variables) if v not in given]
    if (
        free and n + nz <= _MOST_BY_VALUES
    ):  # defaulted states are free, too: `_determined` decides which keep their guesses
        free = [k for k, v in enumerate(compiled.state_variables) if v not in compiled.start.direct]
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
    guessed = first / ca.DM(scale)
    solved: Any = root(guessed, ca.vertcat(parameters, guessed)) * ca.DM(scale)
    x0: Any = ca.MX(x)
    if free:
        x0[free] = solved[: len(free)]
    z0 = ca.vertsplit(solved, [0, len(free), len(scale)])[1]
    return ca.Function("init", [parameters], [x0, z0], ["p"], ["x0", "z0"])


def _start_root(compiled: CompiledModel, begin: StartPoint, free: list[int], scale: Vector) -> Any:
    """Rootfinder `(y0, [p, y0]) -> y` for free states and algebraic variables at the start, divided by `scale`."""
    y, p = ca.SX.sym("y", len(scale)), ca.SX.sym("p", len(compiled.parameters))
    guessed = ca.SX.sym("guessed", len(scale))
    unknown = y * ca.DM(scale)
    x = compiled.guess(p)[0]
    for k, i in enumerate(free):
        x[i] = unknown[k]
    point = (begin.t, x, unknown[len(free) :], begin.u, p)
    arguments = (*point, compiled.all_modes(*point))
    residual = compiled.rhs(*arguments)[1]
    if free:
        residual = ca.vertcat(compiled.conditions(*arguments)[0], residual)
    known_start = np.concatenate([begin.x[free], begin.z]) / scale
    if free and len(compiled.states) + len(compiled.algebraic) <= _MOST_BY_VALUES:
        residual = _determined(residual, y, p, guessed, known_start, begin.p)
    if residual.numel() != len(scale):
        raise ExportError(
            "AC603",
            f"{residual.numel()} start conditions for {len(scale)} open values of {compiled.name}",
            evidence=[c.text for c in compiled.start.conditions[:6]],
            help="give the start values of states with fixed(...)",
        )
    function = ca.Function("start", [y, ca.vertcat(p, guessed)], [residual], ["z", "q"], ["r"])
    return newton("start", function, ca.DM(known_start), ca.DM(np.concatenate([begin.p, known_start])))


def _determined(residual: Any, y: Any, p: Any, guessed: Any, at: Vector, known: Vector) -> Any:
    """As many conditions as unknowns, from the Jacobian at the start `at`, shape (ny,), for parameters `known`, (np,).

    A loop may state one condition twice and leave a state undetermined elsewhere. The conditions are replaced by their
    linearly independent combinations (from a singular value decomposition); in the undetermined directions the
    unknowns stay as close as possible to their guesses, as in a run (initialisation.md).
    """
    slope = np.array(ca.Function("slope", [y, p], [ca.jacobian(residual, y)])(at, known), dtype=float)
    rows, columns = slope.shape
    if not np.isfinite(slope).all():
        return residual
    sizes = np.maximum(np.abs(slope).max(axis=1, initial=0.0), 1e-300)
    left, values, right = np.linalg.svd(slope / sizes[:, None])
    rank = int(np.count_nonzero(values > _SINGULAR * values[0])) if len(values) else 0
    if rank == rows == columns:
        return residual
    independent = residual if rank == rows else ca.DM(left[:, :rank].T / sizes) @ residual
    return ca.vertcat(independent, ca.DM(right[rank:]) @ (y - guessed))


_SINGULAR = 1e-10
"""Singular values below this fraction of the largest one count as zero."""
_MOST_BY_VALUES = 400
"""Number of unknowns up to which a singular value decomposition finds missing and repeated conditions, as in a run."""
