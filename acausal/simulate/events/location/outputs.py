"""Rows at output times, which lie between the mesh points of a search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.events.location.between import between
from acausal.simulate.events.regime import Regime
from acausal.simulate.solvers.base import on_equations
from acausal.simulate.solvers.segment import Piece, Segment, add_counters


class NotDelivered(RuntimeError):
    """Raised where rows between two mesh points can neither be interpolated nor integrated."""


def outputs(
    integrate: Callable[[Regime, Segment], Piece],
    regime: Regime,
    segment: Segment,
    part: Segment,
    piece: Piece,
    due: Vector,
    counters: dict[str, float],
) -> tuple[Vector, Vector]:
    """States, shape (nx, n), and algebraic variables, shape (nz, n), at n instants `due` within a piece.

    They are interpolated, or integrated where that is not accurate enough; `counters` get what that takes.

    `segment`, `part`: The rest of the stretch, and the part of it to which the piece belongs.
    """
    problem, n = regime.problem, regime.problem.n_dynamic
    there = np.searchsorted(part.times[: piece.x.shape[1] - 1], due)
    if (part.times[there] == due).all():
        return piece.x[:, there], piece.z[:, there]
    x, z = np.tile(segment.x[:, None], (1, len(due))), np.tile(segment.z[:, None], (1, len(due)))
    nodes = np.append(segment.start, part.times[: piece.x.shape[1]])
    xs, zs = np.hstack([segment.x[:, None], piece.x]), np.hstack([segment.z[:, None], piece.z])
    nominal = np.concatenate([problem.scale_x, problem.scale_z])
    values = np.vstack([xs[:n], zs])
    size = np.abs(values[:, np.searchsorted(nodes, due).clip(1) - 1]).T
    allowed = segment.tolerances.of(size, nominal)
    if functions_of(problem.compiled).newton() is not None:
        allowed[:, n:] = np.inf  # they are solved for below
    found, good = between(nodes, values.T, due, allowed)
    x[:n], z[:] = found[:, :n].T, found[:, n:].T
    if good.any() and len(z):
        at = np.flatnonzero(good)
        z[:, at] = on_equations(problem, replace(segment, times=due[at]), x[:, at], z[:, at])
    if good.all():
        return x, z
    at = np.flatnonzero(~good)
    k = int(np.searchsorted(nodes, due[at[0]])) - 1
    other = replace(segment, start=float(nodes[k]), times=due[at], x=xs[:, k], z=zs[:, k], first=0.0)
    other = replace(other, partial=False, fractions=None)
    try:
        solved = integrate(regime, replace(other, step_budget=other.most_steps))
    except RuntimeError as error:
        raise NotDelivered(str(error)) from None
    x[:n, at], z[:, at] = solved.x[:n], solved.z
    add_counters(counters, solved.counters)
    return x, z
