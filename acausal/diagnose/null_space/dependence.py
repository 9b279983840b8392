"""Equations that are dependent for the values of their coefficients, which the structure alone does not show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.diagnose.causes import probable
from acausal.diagnose.null_space.pencil import sparse_null_vectors
from acausal.diagnose.words import equations_of, lines, listed, made_at, names_of, parameter_at, places
from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation
from acausal.flatten.reduced import ReducedSystem
from acausal.numeric.evaluate import gradients
from acausal.numeric.samples import COUNT, SamplePoints

Matrices = NDArray[np.float64]
Leaves = Mapping[str, Callable[[int], Any]]
_MOST_DENSE = 200
_MOST_PARAMETERS = 40


def dependent(
    reduced: ReducedSystem,
    rows: Sequence[int],
    unknowns: Sequence[int],
    demand: float = 0.0,
    constrained: Sequence[int] = (),
    special: Callable[[], Sequence[int]] = tuple,
) -> StructureError:
    """The error for equations in which the unknowns cancel: the probable cause, or else AC204.

    Parameters
    ----------
    rows
        Indices of flat equations.
    unknowns
        Reduced variables that remain undetermined.
    demand
        Remainder when the unknowns have cancelled, which is not zero if the equations contradict each other.
    constrained
        Reduced variables in the remainder: the combination is a constraint on them.
    special
        Finds free parameters that only need another value; called if no other cause is found.
    """
    flat = reduced.flat
    error = probable(flat)
    if error is not None:
        return error
    equations = [flat.equations[k] for k in dict.fromkeys(rows)]
    decisive = special()
    if decisive:
        return _special(reduced, equations, unknowns, decisive)
    if constrained:
        return _hidden_constraint(reduced, equations, constrained)
    names = names_of(flat, (reduced.scalar[v] for v in unknowns if v < len(reduced.scalar)))
    contradict = bool(np.isfinite(demand)) and abs(demand) > 1e-9
    return StructureError(
        "AC204",
        f"{equations_of(flat, list(dict.fromkeys(e.component for e in equations)))} "
        + ("contradict each other" if contradict else "depend on each other"),
        where=places(flat, equations) or made_at(flat, ""),
        evidence=["their unknowns cancel:", *lines(flat, equations, 8)]
        + ([f"together they demand 0 == {abs(demand):g}"] if contradict else [])
        + ([f"they leave undetermined: {listed(names)}"] if names else []),
        cause="one of them follows from the others, or together they constrain states; only the coefficients show this",
        help="replace one of these equations by one for the undetermined unknowns",
    )


def _special(
    reduced: ReducedSystem, equations: Sequence[FlatEquation], unknowns: Sequence[int], special: Sequence[int]
) -> StructureError:
    flat = reduced.flat
    names = [flat.parameter_names[k] for k in special]
    values = [f"{name} = {flat.parameter_values[k]:g}" for k, name in zip(special, names, strict=True)]
    owners = list(dict.fromkeys(e.component for e in equations))
    open_ones = listed((reduced.name(v) for v in unknowns), 3)
    return StructureError(
        "AC204",
        f"{equations_of(flat, owners)} do not determine {open_ones} for {listed(values, 4)}",
        where=list(dict.fromkeys([*places(flat, equations), *(s for n in names[:1] for s in parameter_at(flat, n))])),
        evidence=["in these it cancels for that value:", *lines(flat, equations, 8)],
        cause="with other values of these parameters the equations would determine their unknowns",
        help=f"change {listed(names, 4)}, or model the effect that this value neglects",
    )


def _hidden_constraint(
    reduced: ReducedSystem, equations: Sequence[FlatEquation], constrained: Sequence[int]
) -> StructureError:
    flat = reduced.flat
    names = [reduced.name(v) for v in constrained]
    owners = list(dict.fromkeys(e.component for e in equations))
    return StructureError(
        "AC204",
        f"{equations_of(flat, owners)} hide a constraint on {listed(names, 3)}",
        where=places(flat, equations) or made_at(flat, ""),
        evidence=["a combination of these with others contains nothing else:", *lines(flat, equations, 4)],
        cause="only the coefficients show this constraint; index reduction uses the structure and cannot find it",
        help="put something compliant or resistive between these components",
    )


def check_rank(
    reduced: ReducedSystem, points: SamplePoints, residuals: Sequence[int], unknowns: Sequence[int], rows: Sequence[int]
) -> None:
    """Refuse a nonlinear block whose Jacobian is singular at the start and at every generic point (AC204).

    One regular point suffices to accept it, because a start in a singular position is no defect of the equations.
    Blocks of up to 200 unknowns are checked by singular values, larger ones by a sparse factorisation.
    """
    if not unknowns:
        return
    if len(unknowns) <= _MOST_DENSE:
        null = _null(_jacobian(reduced, points, residuals, unknowns, points.leaves))
    else:
        null = _sparse_null(reduced, points, residuals, unknowns)
    if null is not None:
        dependent_rows = [rows[i] for i in np.flatnonzero(np.abs(null[0]) > 1e-6).tolist()]
        open_ones = [unknowns[k] for k in np.flatnonzero(np.abs(null[1]) > 1e-6).tolist()]
        special = partial(special_values, reduced, points, residuals, unknowns)
        raise dependent(reduced, dependent_rows, open_ones, special=special)


def special_values(
    reduced: ReducedSystem, points: SamplePoints, residuals: Sequence[int], unknowns: Sequence[int]
) -> list[int]:
    """Free parameters of which each, with another value, makes the equations determine their unknowns."""
    pool = reduced.pool
    if len(unknowns) > _MOST_DENSE:
        return []
    parameters = [pool.nodes[n][1] for n in pool.reachable(residuals) if pool.nodes[n][0] == "par"]
    parameters = [k for k in parameters if k < len(reduced.flat.parameter_values)]
    decisive = []
    for k in parameters if len(parameters) <= _MOST_PARAMETERS else ():
        value = points.parameters[k]
        changed = [*points.parameters]
        changed[k] = 0.61 if value == 0.0 else value * 1.37
        leaves = {**points.leaves, "par": changed.__getitem__}
        if _null(_jacobian(reduced, points, residuals, unknowns, leaves)) is None:
            decisive.append(k)
    return decisive


def _jacobian(
    reduced: ReducedSystem, points: SamplePoints, residuals: Sequence[int], unknowns: Sequence[int], leaves: Leaves
) -> Matrices:
    """Slopes of the residuals at all sample points, shape (COUNT, n, n)."""
    column_of = {v: k for k, v in enumerate(unknowns)}
    jacobian = np.zeros((COUNT, len(residuals), len(unknowns)))
    for i, row in enumerate(gradients(reduced.pool, residuals, unknowns, leaves)):
        for v, slope in row.items():
            jacobian[:, i, column_of[v]] = slope
    return jacobian


def _null(jacobian: Matrices) -> tuple[Matrices, Matrices] | None:
    """Left and right null vector at the first generic point if the matrices are singular at all points, else None."""
    null_vectors: tuple[Matrices, Matrices] | None = None
    for matrix in jacobian[1:]:
        if not np.isfinite(matrix).all():
            continue
        scale = np.max(np.abs(matrix), axis=1, keepdims=True)
        matrix = matrix / np.where(scale > 0.0, scale, 1.0)
        matrix = matrix / np.maximum(np.max(np.abs(matrix), axis=0, keepdims=True), 1e-300)
        u, s, vt = np.linalg.svd(matrix)
        if s[-1] > 1e-11 * s[0]:
            return None
        null_vectors = null_vectors or (u[:, -1], vt[-1])
    return null_vectors


def _sparse_null(
    reduced: ReducedSystem, points: SamplePoints, residuals: Sequence[int], unknowns: Sequence[int]
) -> tuple[Matrices, Matrices] | None:
    """Left and right null vector at the first generic point of a large block if it is singular at three, else None."""
    n = len(unknowns)
    column_of = {v: k for k, v in enumerate(unknowns)}
    slopes = gradients(reduced.pool, residuals, unknowns, points.leaves)
    rows = np.array([i for i, row in enumerate(slopes) for _ in row])
    columns = np.array([column_of[v] for row in slopes for v in row])
    entries = np.array([np.broadcast_to(slope, (COUNT,)) for row in slopes for slope in row.values()])
    null_vectors: tuple[Matrices, Matrices] | None = None
    for k in range(1, 4):
        if not np.isfinite(entries[:, k]).all():
            continue
        left, right = sparse_null_vectors(rows, columns, entries[:, k], n)
        if not left or not right:
            return None
        dense = np.zeros((2, n))
        for side, vector in zip(dense, (left[0], right[0]), strict=True):
            side[list(vector)] = list(vector.values())
        null_vectors = null_vectors or (dense[0], dense[1])
    return null_vectors
