"""Plots of optima: curves are thick where a limit is active, and the active limits of each phase are listed.

Limits are given in the unit of the axis of the variable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from acausal.arrays import Vector
from acausal.optimal_control.optimum.optimum import Multiplier, Optimum
from acausal.optimal_control.problem import constraint_text
from acausal.panel import Panel
from acausal.plot.plot import figure, save
from acausal.plot.scale import Scale, readable

_ACTIVE_COLOR = "#D55E00"
# Plotted instants per phase.
_INSTANTS = 300
# Small letters per inch.
_LETTERS = 16
# Space for a label beyond a limit, relative to the height of the panel.
_LABEL_SPACE = 0.16
# Constraints active at a smaller fraction of the points of a phase are not listed.
_LEAST_ACTIVE = 0.1


def draw_optimum(best: Optimum, names: Sequence[str], file: str | Path | None, title: str | None) -> Figure:
    """Figure with one panel for each name, by default the inputs and the variables with active limits."""
    chosen, best = list(names) or _default_names(best), _resampled(best)
    drawing = figure(best, [Panel((name,)) for name in chosen], title=title or _title(best))
    for ax in drawing.axes:
        for line in list(ax.lines):
            for multiplier in best.held:
                if multiplier.variable == line.get_label():
                    _mark_active(ax, line, best, multiplier)
    lines = [f"{name}, {begin:.4g} to {end:.4g} s: {_active_limits(best, name)}" for name, begin, end in best.phases]
    width = int(drawing.get_figwidth() * _LETTERS)
    lines = [part for line in lines for part in wrap(line, width, subsequent_indent="    ")]
    legend = ["thick: at a limit"] if any(best.active(name, _LEAST_ACTIVE) for name, _, _ in best.phases) else []
    drawing.supxlabel("\n".join([*legend, *lines]), x=0.01, ha="left", fontsize=8)
    save(drawing, file)
    return drawing


def _title(best: Optimum) -> str:
    """Title: the model, the duration, and the objective if it differs from the duration."""
    duration = float(best.time[-1] - best.time[0])
    taken = f"{best.model} in {duration:.6g} s"
    return taken if abs(best.objective - duration) <= 1e-3 * duration else f"{taken}, objective {best.objective:.6g}"


def _scale(best: Optimum, variable: str) -> Scale:
    """Unit of the axis of a variable."""
    return readable(best.signals[variable].unit, float(np.abs(best[variable]).max(initial=0.0)))


def _limit(best: Optimum, multiplier: Multiplier, level: Vector) -> str:
    """Text of the active limit of a variable: the name given by the user, else the active side in the unit of the axis.

    `level`: values of the variable where the limit is active, shape (n,).
    """
    variable, lower, upper = multiplier.variable, multiplier.lower, multiplier.upper
    if variable is None or multiplier.name not in (f"limits of {variable}", constraint_text(variable, lower, upper)):
        return multiplier.name
    scale = _scale(best, variable)
    unit = f" {scale.label[1:-1]}" if scale.label else ""

    def text(limit: float) -> str:
        return f"{float(scale(np.array(limit))):.6g}{unit}"

    if lower == upper:
        return f"{variable} = {text(lower)}"
    near = multiplier.scale * 1e-2
    low, high = bool((level <= lower + near).any()), bool((level >= upper - near).any())
    if low and high:
        return f"{variable} = {text(lower)} or {text(upper)}"
    return f"{variable} \u2265 {text(lower)}" if low else f"{variable} \u2264 {text(upper)}"


def _resampled(best: Optimum) -> Optimum:
    """The optimum evaluated between the points of the mesh; phases start just after an event."""
    dense = best.dense
    if dense is None:
        return best
    tiny = 1e-9 * float(np.ptp(best.time))
    inside = [np.linspace(begin + tiny, end, _INSTANTS) for _, begin, end in best.phases if end > begin + tiny]
    times = np.maximum.accumulate(np.concatenate(inside))
    return replace(best, time=times, trajectories=lambda: dense(times))


def _default_names(best: Optimum) -> list[str]:
    """Names of the inputs, and of the variables with an active limit."""
    bounded = [m.variable for m in best.held if m.variable is not None and m.active.any()]
    return list(dict.fromkeys([*best.inputs, *bounded]))


def _mark_active(ax: Axes, line: Line2D, best: Optimum, multiplier: Multiplier) -> None:
    """Mark where a limit is active by a thick line and a label; coordinates are those of the drawn curve."""
    x, y = np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)
    held = multiplier.holds(best[multiplier.variable or ""])
    inside = np.zeros(len(x), dtype=bool)
    for name, begin, end in best.phases:
        if name in multiplier.phase:
            inside |= (best.time >= begin) & (best.time <= end)
    held &= inside
    if not held.any():
        return
    ax.plot(x, np.where(held, y, np.nan), color=_ACTIVE_COLOR, lw=4.0, alpha=0.6, solid_capstyle="butt", zorder=1.5)
    runs = np.split(np.flatnonzero(held), np.flatnonzero(np.diff(np.flatnonzero(held)) > 1) + 1)
    longest = max(runs, key=lambda r: float(x[r[-1]] - x[r[0]]))
    middle = (x[longest[0]] + x[longest[-1]]) / 2
    level = float(y[longest[len(longest) // 2]])
    # place the label beyond the limit, where there is no curve
    values = best[multiplier.variable or ""][longest]
    above = bool(np.abs(values - multiplier.upper).min() <= np.abs(values - multiplier.lower).min())
    offset = (0, 4 if above else -4)
    vertical = "bottom" if above else "top"
    low, high = ax.get_ylim()
    space = _LABEL_SPACE * (high - low)
    ax.set_ylim(min(low, level - space) if not above else low, max(high, level + space) if above else high)
    # keep the label inside the figure
    position = (middle - ax.get_xlim()[0]) / np.ptp(ax.get_xlim())
    side = "left" if position < 0.2 else "right" if position > 0.8 else "center"
    edge = {"left": longest[0], "right": longest[-1]}.get(side)
    ax.annotate(
        _limit(best, multiplier, values),
        (middle if edge is None else float(x[edge]), level),
        offset,
        textcoords="offset points",
        ha=side,
        va=vertical,
        fontsize=8,
        color=_ACTIVE_COLOR,
        # the box covers grid and phase lines but not curves
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        zorder=1.9,
    )


def _active_limits(best: Optimum, phase: str) -> str:
    """Text of the active limits of a phase."""
    held = [best.multipliers[name] for name in best.active(phase, _LEAST_ACTIVE)]
    own = [m.active & np.array([name == phase for name in m.phase]) for m in held]
    words = [_limit(best, m, m.level[k]) for m, k in zip(held, own, strict=True)]
    return ", ".join(words) if words else "nothing is at a limit"
