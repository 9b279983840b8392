"""Fixed steps of implicit methods, checked one by one: a step may end on another branch of the algebraic equations.

No error estimate rejects a step past a fold, and Newton's method may converge to any solution beyond it: the solution
of z + 1.5 sin z = x jumped from -2.3 to -6.3 in one step of Radau's method, and in one of Rosenbrock's.
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
    """Solve a segment by `solve`, up to the first step that leaves the branch on which the segment began.

    `step` is the fixed step [s]. Raises RuntimeError at that step, unless the segment is `partial` and has rows before.
    """
    step_ends = segment.times if segment.fractions is not None else _every_step(segment, step)
    try:
        piece = solve(replace(segment, times=step_ends))
    except Interrupted as stop:
        if stop.piece is not None:
            is_output = np.isin(step_ends[: stop.piece.x.shape[1]], segment.times)
            stop.piece = _rows(stop.piece, is_output) if is_output.any() else None
        raise
    count = piece.x.shape[1]
    valid = problem.keeps_branch(replace(segment, times=step_ends[:count]), piece.x, piece.z)
    is_output = np.isin(step_ends[:count], segment.times) & (np.arange(count) < valid)
    if valid == count:
        return _rows(piece, is_output)
    if not (segment.partial and is_output.any()):
        raise RuntimeError(LEFT)
    return replace(_rows(piece, is_output), stopped=LEFT)


def _rows(piece: Piece, is_output: Truth) -> Piece:
    return replace(piece, x=piece.x[:, is_output], z=piece.z[:, is_output])


def _every_step(segment: Segment, step: float) -> Vector:
    """The ends of all steps up to the last output, including the output times."""
    before = np.append(segment.start, segment.times[:-1])
    counts = np.maximum(1, np.ceil((segment.times - before) / step - 1e-9)).astype(int)
    inner = [np.linspace(a, b, n + 1)[1:-1] for a, b, n in zip(before, segment.times, counts, strict=True) if n > 1]
    return np.sort(np.concatenate([segment.times, *inner]))
