"""Spy plot of a model's incidence matrix, in the order of the source and in that of the solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from acausal.analyse.blocks.solve import BlockKind
from acausal.lower.compiled import CompiledModel
from acausal.plot.plot import Drawing, check_picture, save

# Okabe and Ito's palette, as for curves; explicit blocks, the most common ones, are grey.
_COLOR: Mapping[BlockKind, str] = {
    "explicit": "0.25",
    "linear": "#0072B2",
    "monotone": "#009E73",
    "torn": "#D55E00",
    "dae": "#CC79A7",
}
_MEANING: Mapping[BlockKind, str] = {
    "explicit": "solved one by one",
    "linear": "linear, solved symbolically",
    "monotone": "monotone, iterated inside the equations",
    "torn": "nonlinear, torn",
    "dae": "left to the DAE solver",
}
_SIDE = 4.6  # inches of each panel
_POINTS = 0.82 * 72 * _SIDE  # of its square of axes
_MOST_OUTLINES = 2000


@dataclass(frozen=True, eq=False)
class Pattern:
    """Incidence of unknowns in equations, with the blocks of the solving order."""

    # `rows`, `columns`: shape (n_entries,), entries equation by equation, unknowns in the order of their numbers.
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    # `row_place`, `column_place`: shape (size,), position of each equation and unknown in the solving order.
    row_place: NDArray[np.int64]
    column_place: NDArray[np.int64]
    blocks: tuple[tuple[int, int, BlockKind], ...]  # (first position, size, kind) of every block

    @property
    def size(self) -> int:
        """Number of equations, and of unknowns."""
        return len(self.row_place)


def pattern(compiled: CompiledModel) -> Pattern:
    """Incidence matrix of the unknowns other than states and inputs, and its block order."""
    structure = compiled.solution.structure
    equations = sorted(e for b in structure.blocks for e in b.rows)
    unknowns = sorted(v for b in structure.blocks for v in b.columns)
    column = {v: k for k, v in enumerate(unknowns)}
    row = {e: k for k, e in enumerate(equations)}
    entries = [
        (row[e], column[v])
        for e in equations
        for v in structure.reduced.pool.variables_in(structure.residuals[e])
        if v in column
    ]
    row_place, column_place = np.empty(len(row), dtype=np.int64), np.empty(len(column), dtype=np.int64)
    blocks, first = [], 0
    for block, solved in zip(structure.blocks, compiled.solution.blocks, strict=True):
        for k, (e, v) in enumerate(zip(block.rows, block.columns, strict=True)):
            row_place[row[e]] = first + k
            column_place[column[v]] = first + k
        blocks.append((first, len(block), solved.kind))
        first += len(block)
    where = np.array(entries, dtype=np.int64).reshape(-1, 2)
    return Pattern(where[:, 0], where[:, 1], row_place, column_place, tuple(blocks))


def spy(compiled: CompiledModel, file: str | Path | None = None, title: str | None = None) -> Figure:
    """Draw the incidence matrix before and after the block lower triangular form, side by side.

    Raises UsageError: AC012 and AC013 for the file.

    `file`: `.png` (150 dpi), `.svg` or `.pdf` to write.
    `title`: text above the figure; the name of the model by default.
    """
    check_picture(file)
    incidence = pattern(compiled)
    with matplotlib.rc_context({"font.size": 9.0, "svg.hashsalt": "acausal"}):
        drawing = Drawing(figsize=(2 * _SIDE, _SIDE + 1.0), layout="constrained")
        before, after = drawing.subplots(1, 2)
        _panel(before, incidence.rows, incidence.columns, incidence.size)
        before.set_title(f"as composed: {incidence.size} equations, {len(incidence.rows)} entries", fontsize=9)
        rows, columns = incidence.row_place[incidence.rows], incidence.column_place[incidence.columns]
        _panel(after, rows, columns, incidence.size)
        largest = max((size for _, size, _ in incidence.blocks), default=0)
        after.set_title(f"as solved: {len(incidence.blocks)} blocks, the largest of {largest}", fontsize=9)
        _outline(after, incidence.blocks)
        handles = _legend(incidence.blocks)
        if handles:
            drawing.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=8)
        drawing.suptitle(compiled.name if title is None else title, fontsize=11, fontweight="bold")
        save(drawing, file)
    return drawing


def _panel(ax: Axes, rows: NDArray[np.int64], columns: NDArray[np.int64], size: int) -> None:
    """Draw entries as squares of the size of a cell, but never too small to be seen."""
    cell = _POINTS / max(size, 1)
    # rasterise large models, whose SVG would be huge
    ax.plot(columns, rows, "s", color="0.25", ms=float(np.clip(0.86 * cell, 0.7, 9.0)), mew=0, rasterized=size > 300)
    ax.set_xlim(-0.5, max(size, 1) - 0.5)
    ax.set_ylim(max(size, 1) - 0.5, -0.5)
    ax.set_aspect("equal")
    ax.set_xlabel("unknown")
    ax.set_ylabel("equation")
    ax.locator_params(integer=True, nbins=6)
    for spine in ax.spines.values():
        spine.set_edgecolor("0.6")


def _outline(ax: Axes, blocks: Sequence[tuple[int, int, BlockKind]]) -> None:
    """Frames around blocks of more than one unknown, and around single ones that are iterated."""
    shown = [b for b in blocks if b[1] > 1 or b[2] != "explicit"]
    shown = sorted(shown, key=lambda b: -b[1])[:_MOST_OUTLINES]
    for kind, color in _COLOR.items():
        frames = [Rectangle((first - 0.5, first - 0.5), size, size) for first, size, k in shown if k == kind]
        if frames:
            ax.add_collection(PatchCollection(frames, facecolor=color, edgecolor=color, alpha=0.28, lw=0.8, zorder=0.5))


def _legend(blocks: Sequence[tuple[int, int, BlockKind]]) -> list[Patch]:
    counts: Mapping[BlockKind, list[int]] = {kind: [s for _, s, k in blocks if k == kind] for kind in _COLOR}
    return [
        Patch(facecolor=_COLOR[kind], alpha=1.0 if kind == "explicit" else 0.5, label=f"{len(sizes)} {_MEANING[kind]}")
        for kind, sizes in counts.items()
        if sizes
    ]
