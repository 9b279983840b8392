"""Plots of sweeps: one panel per signal, with lines coloured by a varied parameter, or quantile bands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.plot.plot import STYLE, check_picture, save
from acausal.plot.scale import readable
from acausal.study.sweep.family import Sweep

# Maximum number of colours in a legend, and of lines in a panel.
_MOST_COLOURS, _MOST_LINES = 8, 200
_MOST_PANELS = 6
# Without the yellow end, which is hardly visible in a thin line on white.
_MAP = LinearSegmentedColormap.from_list("family", matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, 64)))
_STYLES = ("-", "--", ":", "-.")


def sweep_picture(sweep: Sweep, *names: str, by: str | None = None, file: str | Path | None = None) -> Figure:
    """Plot signals over time, one panel each, of all successful members.

    Up to 200 members are lines, coloured by one parameter and styled by another one with up to four values. For more
    members, the median and the central 50 % and 90 % at each time are plotted.

    Parameters
    ----------
    names
        Stored signals; by default the first six.
    by
        The varied parameter that colours the lines; the first one by default.
    file
        `.png` (150 dpi), `.svg` or `.pdf` to write.

    Raises
    ------
    UsageError
        AC010 for an unknown name, AC012 and AC013 for the file, AC016 if no member has values.
    """
    check_picture(file)
    panels = names or tuple(s.name for s in sweep.signals[:_MOST_PANELS])
    families = [sweep[name] for name in panels]
    is_ok = np.array([status == "ok" for status in sweep.status])
    if not is_ok.any():
        raise UsageError("AC016", f"no member of the sweep of {sweep.model} has values to plot")
    coloured = by or sweep.parameters[0].name
    values = sweep[coloured]
    if values.ndim != 1 or coloured == "time":
        raise UsageError("AC016", f"'{coloured}' is not varied", help=", ".join(s.name for s in sweep.parameters))
    styled = _styled_parameter(sweep, coloured)
    styles = np.zeros(len(sweep), dtype=int) if styled is None else np.unique(sweep[styled], return_inverse=True)[1]
    docs = {s.name: s.doc.rstrip(".") for s in sweep.signals}
    clock = readable("s", float(np.abs(sweep.time).max()))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 1.2 + max(2.2 * len(panels), 2.8)), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for ax, name, rows in zip(axes, panels, families, strict=True):
            scale = readable(sweep.unit(name), float(np.nanmax(np.abs(rows), initial=0.0)))
            if is_ok.sum() > _MOST_LINES:
                _bands(ax, clock(sweep.time), scale(rows[is_ok]))
            else:
                _lines(ax, clock(sweep.time), scale(rows[is_ok]), values[is_ok], styles[is_ok])
            ax.set_ylabel(f"{name} {scale.label}".strip())
            if docs[name]:
                ax.set_title(docs[name], loc="left")
        axes[-1].set_xlabel(f"Time {clock.label}")
        if is_ok.sum() > _MOST_LINES:
            ended = any(np.isnan(rows[is_ok]).any() for rows in families)
            of = "of members that still run" if ended else "of all members"
            figure.legend(*axes[0].get_legend_handles_labels(), title=of, loc="outside right upper")
        else:
            _key(figure, axes, sweep, coloured, values[is_ok])
            if styled is not None:
                _style_key(figure, sweep, styled)
        figure.align_ylabels()
        without_values = len(sweep) - int(is_ok.sum())
        heading = f"{sweep.model}, {int(is_ok.sum())} members"
        figure.suptitle(
            heading + (f" ({without_values} without values)" if without_values else ""), fontsize=11, fontweight="bold"
        )
        save(figure, file)
    return figure


def _styled_parameter(sweep: Sweep, coloured: str) -> str | None:
    """A parameter with few values, other than that of the colours; None without."""
    others = (s.name for s in sweep.parameters if s.name != coloured)
    return next((name for name in others if 1 < len(np.unique(sweep[name])) <= len(_STYLES)), None)


def _style_key(figure: Figure, sweep: Sweep, name: str) -> None:
    """Legend of the line styles."""
    levels = np.unique(sweep[name])
    scale = readable(sweep.unit(name), float(np.abs(levels).max()))
    pairs = zip(levels, _STYLES, strict=False)
    handles = [Line2D([], [], color="0.2", ls=style, label=f"{scale(value):.4g}") for value, style in pairs]
    figure.legend(handles=handles, title=f"{name} {scale.label}".strip(), loc="outside right lower")


def _lines(ax: Axes, time: Vector, rows: Vector, values: Vector, styles: NDArray[np.int64]) -> None:
    """One line per member; `rows` has shape (members, r)."""
    colours = _MAP(_norm(values)(values))
    width = 1.4 if len(rows) <= 3 * _MOST_COLOURS else 0.7
    for row, colour, style in zip(rows, colours, styles, strict=True):
        ax.plot(time, row, color=colour, ls=_STYLES[style], lw=width)


def _bands(ax: Axes, time: Vector, rows: Vector) -> None:
    """Quantile bands at each time, of the members with values there; `rows` has shape (members, r)."""
    seen = np.isfinite(rows).any(axis=0)
    low, lower, middle, upper, high = np.nanquantile(rows[:, seen], [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
    ax.fill_between(time[seen], low, high, color="#0072B2", alpha=0.18, lw=0, label="5 to 95 %")
    ax.fill_between(time[seen], lower, upper, color="#0072B2", alpha=0.35, lw=0, label="25 to 75 %")
    ax.plot(time[seen], middle, color="#0072B2", label="median")


def _key(figure: Figure, axes: Any, sweep: Sweep, name: str, values: Vector) -> None:
    """Key of the colours: a legend for few values, else a colour bar."""
    scale = readable(sweep.unit(name), float(np.abs(values).max()))
    label = f"{name} {scale.label}".strip()
    levels = np.unique(values)
    norm = _norm(values)
    if len(levels) <= _MOST_COLOURS:
        colours = _MAP(norm(levels))
        handles = [Line2D([], [], color=c, label=f"{scale(v):.4g}") for c, v in zip(colours, levels, strict=True)]
        figure.legend(handles=handles, title=label, loc="outside right upper")
        return
    low, high = scale(np.array([norm.vmin, norm.vmax])).tolist()
    bar = ScalarMappable(LogNorm(low, high) if isinstance(norm, LogNorm) else Normalize(low, high), _MAP)
    figure.colorbar(bar, ax=list(axes), label=label, aspect=40)


def _norm(values: Vector) -> Normalize:
    """Colour scale, linear, or logarithmic if positive values span more than two decades."""
    low, high = float(values.min()), float(values.max())
    if low == high:
        return Normalize(low - 1.0, high + 1.0)
    return LogNorm(low, high) if low > 0.0 and high / low > 100.0 else Normalize(low, high)
