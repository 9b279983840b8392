"""Fixed steps of implicit methods, looked at one by one: a step may end on another branch of the algebraic equations.

A step past a fold is not rejected by any error estimate, and Newton's method within it ends on whatever solves the
equations there: z + 1.5 sin z = x went from -2.3 to -6.3 in one step of Radau's method, and in one of Rosenbrock's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.equations.problem import LEFT, Problem
from acausal.simulate.interrupt import Interrupted
from acausal.simulate.solvers.segment import Piece, Segment


def step_by_step(solve: Callable[[Segment], Piece], problem: Problem, segment: Segment, step: float) -> Piece:
    """What `solve` makes of a segment, up to the first step [s] that leaves the branch on which it began.

    Raises RuntimeError there, unless rows before that are a result (`Segment.partial`).
    """
    asked = segment.times if segment.shares is not None else _every_step(segment, step)
    try:
        piece = solve(replace(segment, times=asked))
    except Interrupted as stop:
        if stop.got is not None:
            due = np.isin(asked[: stop.got.x.shape[1]], segment.times)
            stop.got = _rows(stop.got, due) if due.any() else None
        raise
    count = piece.x.shape[1]
    kept = problem.keeps_branch(replace(segment, times=asked[:count]), piece.x, piece.z)
    due = np.isin(asked[:count], segment.times) & (np.arange(count) < kept)
    if kept == count:
        return _rows(piece, due)
    if not (segment.partial and due.any()):
        raise RuntimeError(LEFT)
    return replace(_rows(piece, due), stopped=LEFT)


def _rows(piece: Piece, due: Truth) -> Piece:
    return replace(piece, x=piece.x[:, due], z=piece.z[:, due])


def _every_step(segment: Segment, step: float) -> Vector:
    """The ends of all steps up to the last of the times, these among them."""
    before = np.append(segment.start, segment.times[:-1])
    counts = np.maximum(1, np.ceil((segment.times - before) / step - 1e-9)).astype(int)
    inner = [np.linspace(a, b, n + 1)[1:-1] for a, b, n in zip(before, segment.times, counts, strict=True) if n > 1]
    return np.sort(np.concatenate([segment.times, *inner]))
