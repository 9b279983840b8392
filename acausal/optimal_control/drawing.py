"""Pictures of optima: where a limit holds a variable the curve is thick, and every phase names what holds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from acausal.optimal_control.optimum import Multiplier, Optimum
from acausal.panel import Panel
from acausal.plot import figure, save

_HELD = "#D55E00"
# Instants of a phase that are drawn.
_INSTANTS = 300
# A constraint that holds at fewer of a phase's points does not describe it.
_SHARE = 0.1


def drawn(best: Optimum, names: Sequence[str], file: str | Path | None, title: str | None) -> Figure:
    """One panel for each name, by default the inputs and every variable that is bounded."""
    chosen, best = list(names) or _told(best), _fine(best)
    drawing = figure(best, [Panel((name,)) for name in chosen], title=title or f"{best.model}: {best.objective:.6g}")
    for ax in drawing.axes:
        for line in list(ax.lines):
            for multiplier in best.held:
                if multiplier.variable == line.get_label():
                    _mark(ax, line, best, multiplier)
    lines = [f"{name}, {begin:.4g} to {end:.4g} s: {_words(best, name)}" for name, begin, end in best.phases]
    drawing.supxlabel("\n".join(["thick: at a limit", *lines]), x=0.01, ha="left", fontsize=8)
    if file is not None:
        save(drawing, Path(file))
    return drawing


def _fine(best: Optimum) -> Optimum:
    """The same with the polynomials drawn out between the points of the mesh; phases begin just behind an event."""
    dense = best.dense
    if dense is None:
        return best
    tiny = 1e-9 * float(np.ptp(best.time))
    inside = [np.linspace(begin + tiny, end, _INSTANTS) for _, begin, end in best.phases if end > begin + tiny]
    times = np.maximum.accumulate(np.concatenate(inside))
    return replace(best, time=times, trajectories=lambda: dense(times))


def _told(best: Optimum) -> list[str]:
    bounded = [m.variable for m in best.held if m.variable is not None and m.active.any()]
    return list(dict.fromkeys([*best.inputs, *bounded]))


def _mark(ax: Axes, line: Line2D, best: Optimum, multiplier: Multiplier) -> None:
    """A thick line and a name over what is at a limit; the curve itself is drawn in the figure's own scale."""
    x, y = np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)
    held = multiplier.holds(best[multiplier.variable or ""])
    inside = np.zeros(len(x), dtype=bool)
    for name, begin, end in best.phases:
        if name in multiplier.phase:
            inside |= (best.time >= begin) & (best.time <= end)
    held &= inside
    if not held.any():
        return
    ax.plot(x, np.where(held, y, np.nan), color=_HELD, lw=4.0, alpha=0.6, solid_capstyle="butt", zorder=1.5)
    runs = np.split(np.flatnonzero(held), np.flatnonzero(np.diff(np.flatnonzero(held)) > 1) + 1)
    longest = max(runs, key=lambda r: float(x[r[-1]] - x[r[0]]))
    middle = (x[longest[0]] + x[longest[-1]]) / 2
    level = float(y[longest[len(longest) // 2]])
    above = level < np.mean(ax.get_ylim())
    offset = (0, 5 if above else -5)
    place = "bottom" if above else "top"
    # a name must not reach beyond the figure
    share = (middle - ax.get_xlim()[0]) / np.ptp(ax.get_xlim())
    side = "left" if share < 0.2 else "right" if share > 0.8 else "center"
    edge = {"left": longest[0], "right": longest[-1]}.get(side)
    ax.annotate(
        multiplier.name,
        (middle if edge is None else float(x[edge]), level),
        offset,
        textcoords="offset points",
        ha=side,
        va=place,
        fontsize=8,
        color=_HELD,
    )


def _words(best: Optimum, phase: str) -> str:
    held = best.active(phase, _SHARE)
    return ", ".join(held) if held else "nothing is at a limit"
