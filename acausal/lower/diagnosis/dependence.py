"""Equations that depend on each other by their numbers, which no look at the structure can see."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation
from acausal.lower.diagnosis.causes import probable
from acausal.lower.diagnosis.words import equations_of, lines, listed, made_at, names_of, places
from acausal.lower.evaluate import gradients
from acausal.lower.reduce import ReducedSystem
from acausal.lower.samples import COUNT, SamplePoints

_LARGEST = 200


def dependent(
    reduced: ReducedSystem, rows: Sequence[int], unknowns: Sequence[int], demand: float = 0.0, held: Sequence[int] = ()
) -> StructureError:
    """The error for equations in which the unknowns cancel: the probable cause, or else AC204.

    Parameters
    ----------
    rows
        Indices of flat equations.
    unknowns
        Reduced variables that stay open.
    demand
        What is left when the unknowns have cancelled; not zero when the equations contradict each other.
    held
        Reduced variables in what is left: the combination is a constraint on them.
    """
    flat = reduced.flat
    found = probable(flat)
    if found is not None:
        return found
    equations = [flat.equations[k] for k in dict.fromkeys(rows)]
    if held:
        return _hidden_constraint(reduced, equations, held)
    names = names_of(flat, (reduced.scalar[v] for v in unknowns if v < len(reduced.scalar)))
    contradict = bool(np.isfinite(demand)) and abs(demand) > 1e-9
    return StructureError(
        "AC204",
        f"{equations_of(flat, list(dict.fromkeys(e.component for e in equations)))} "
        + ("contradict each other" if contradict else "depend on each other"),
        where=places(flat, equations) or made_at(flat, ""),
        evidence=["their unknowns cancel:", *lines(flat, equations, 8)]
        + ([f"together they demand 0 == {abs(demand):g}"] if contradict else [])
        + ([f"they leave open: {listed(names)}"] if names else []),
        cause="one of them follows from the others, or together they constrain states, which only the numbers show",
        help="replace one of these equations by one that fixes what is left open",
    )


def _hidden_constraint(
    reduced: ReducedSystem, equations: Sequence[FlatEquation], held: Sequence[int]
) -> StructureError:
    flat = reduced.flat
    names = [reduced.name(v) for v in held]
    owners = list(dict.fromkeys(e.component for e in equations))
    return StructureError(
        "AC204",
        f"{equations_of(flat, owners)} hide a constraint on {listed(names, 3)}",
        where=places(flat, equations) or made_at(flat, ""),
        evidence=["a combination of these with others holds nothing else:", *lines(flat, equations, 4)],
        cause="only the numbers show this constraint; index reduction looks at the structure and cannot find it",
        help="put something between these components that gives way, such as a resistance or a compliance",
    )


def check_rank(
    reduced: ReducedSystem, points: SamplePoints, residuals: Sequence[int], unknowns: Sequence[int], rows: Sequence[int]
) -> None:
    """Refuse a nonlinear block whose Jacobian is singular at the start and at every generic point (AC204).

    One regular point suffices to accept it: a start at a singular position (sin(x) == 0 at x = pi/2) is no defect of
    the equations. Blocks beyond 200 unknowns are left to Newton's method.
    """
    n = len(unknowns)
    if not 0 < n <= _LARGEST:
        return
    place = {v: k for k, v in enumerate(unknowns)}
    jacobian = np.zeros((COUNT, n, n))
    for i, row in enumerate(gradients(reduced.pool, residuals, unknowns, points.leaves)):
        for v, slope in row.items():
            jacobian[:, i, place[v]] = slope
    seen = False
    guilty: list[Any] = []
    open_ones: list[Any] = []
    for matrix in jacobian[1:]:
        if not np.isfinite(matrix).all():
            continue
        scale = np.max(np.abs(matrix), axis=1, keepdims=True)
        matrix = matrix / np.where(scale > 0.0, scale, 1.0)
        matrix = matrix / np.maximum(np.max(np.abs(matrix), axis=0, keepdims=True), 1e-300)
        u, s, vt = np.linalg.svd(matrix)
        if s[-1] > 1e-11 * s[0]:
            return
        if not seen:
            guilty = [rows[i] for i in np.flatnonzero(np.abs(u[:, -1]) > 1e-6).tolist()]
            open_ones = [unknowns[k] for k in np.flatnonzero(np.abs(vt[-1]) > 1e-6).tolist()]
        seen = True
    if seen:
        raise dependent(reduced, guilty, open_ones)
