"""Work-precision chart: log-log, accuracy to the right, cost upwards, failures on the upper edge and listed."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from acausal.plot.plot import Drawing, check_picture, save
from acausal.study.bench.report import Bench
from acausal.study.bench.run import Run, generic

# Okabe and Ito's palette, distinguishable for colour-blind readers, without its yellow.
_COLORS = {
    "idas": "#0072B2",
    "rosenbrock": "#D55E00",
    "cvodes": "#56B4E9",
    "erk": "#009E73",
    "rk2": "#CC79A7",
    "rk": "#E69F00",
    "collocation": "#000000",
}
_OTHERS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
_LINES = {"torn": "-", "dae": "--", "projected": ":"}
_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "legend.fontsize": 8.0,
    "axes.prop_cycle": cycler(color=_OTHERS),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "0.4",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "svg.hashsalt": "acausal",
}
# Widths of a panel and of the list beside the panels [in], and number of characters in a line of the list.
_PANEL, _LIST, _CHARACTERS = 4.3, 3.6, 62
# Abscissa of runs without any error.
_EXACT = 1e-16


def bench_chart(bench: Bench, file: str | Path | None = None, title: str | None = None) -> Figure:
    """Draw solve time, evaluations, and phase errors or steps over the error, with a list of failures.

    Raises
    ------
    UsageError
        AC012 when the file cannot be written, AC013 for another suffix than .png, .svg, .pdf.
    """
    check_picture(file)
    panels = _panels(bench)
    with matplotlib.rc_context(_STYLE):
        texts = _reasons_in_full(bench)
        width = _PANEL * len(panels) + (_LIST if texts else 0.0)
        legend = math.ceil(len(bench.series) / max(1, int(width / 1.6)))
        listed = 0.135 * sum(text.count("\n") + 1 for text in texts) + 0.5
        height = max(4.3 + 0.19 * legend, listed + 0.62)
        figure = Drawing(figsize=(width, height))
        axes = list(figure.subplots(1, len(panels), squeeze=False).flat)
        for place, (label, value) in zip(axes, panels, strict=True):
            _panel(place, bench, label, value)
        figure.subplots_adjust(
            left=0.75 / width,
            right=(_PANEL * len(panels) - 0.1) / width,
            wspace=0.26,
            top=1 - (0.62 + 0.19 * legend) / height,
            bottom=0.55 / height,
        )
        handles, labels = axes[0].get_legend_handles_labels()
        if handles:
            columns = max(1, int(width / 1.6))
            figure.legend(handles, labels, loc="upper left", ncols=columns, bbox_to_anchor=(0.005, 1 - 0.42 / height))
        figure.suptitle(title or _title(bench), fontsize=10.5, x=0.01, y=1 - 0.08 / height, ha="left", va="top")
        if texts:
            place = (_PANEL * len(panels) + 0.12) / width, 1 - (0.62 + 0.19 * legend) / height
            figure.text(*place, "\n".join(texts), fontsize=7.0, color="0.25", ha="left", va="top", linespacing=1.25)
        save(figure, file)
    return figure


def _panels(bench: Bench) -> list[tuple[str, Callable[[Run], float]]]:
    """Up to three panels: time, evaluations, and phase errors for oscillations, else steps."""
    panels: list[tuple[str, Callable[[Run], float]]] = [
        ("Solve time [ms]", lambda r: 1e3 * r.solve_time),
        ("Evaluations of the right-hand side", _count("rhs_evaluations")),
    ]
    if any(run.distance is not None and run.distance.phase for run in bench.runs):
        panels.append(("Phase error at the end [s]", _phase))
    else:
        panels.append(("Steps", _count("steps")))
    return panels[:1] + [panel for panel in panels[1:] if any(panel[1](run) > 0 for run in bench.runs)]


def _reasons_in_full(bench: Bench) -> list[str]:
    """Texts of the failures: number, runs, and the complete reason."""
    failed = bench.failures()
    if not failed:
        return []
    texts = [f"Failed: {sum(map(len, failed.values()))} of {len(bench.runs)} runs", ""]
    for number, runs in enumerate(failed.values(), start=1):
        for series in dict.fromkeys(run.case.series for run in runs):
            knobs = ", ".join(run.case.knob.split(" ", 1)[1] for run in runs if run.case.series == series)
            texts.append(fill(f"{number}  {series}: {knobs}", _CHARACTERS, subsequent_indent="    "))
        texts.append(fill(runs[0].failure, _CHARACTERS, initial_indent="    ", subsequent_indent="    "))
        texts.append("")
    return texts


def _count(name: str) -> Callable[[Run], float]:
    return lambda run: run.counters.get(name, math.nan)


def _phase(run: Run) -> float:
    return math.nan if run.distance is None or run.distance.phase is None else abs(run.distance.phase) or math.nan


def _title(bench: Bench) -> str:
    trusted = f"reference: {bench.reference.source}, {bench.reference.trusted_digits:.1f} digits trusted"
    return f"{bench.model}, {bench.start_time:g} to {bench.stop_time:g} s\n{trusted}"


def _panel(axes: Axes, bench: Bench, label: str, value: Callable[[Run], float]) -> None:
    for name, runs in bench.series.items():
        # a logarithmic axis has no zero: draw it at the end
        points = [(max(r.error, _EXACT), value(r)) for r in runs if r.distance is not None]
        points = [(x, y) for x, y in points if math.isfinite(x) and math.isfinite(y) and y > 0]
        if points:
            axes.plot(*zip(*points, strict=True), label=name, **_line_style(runs[0]))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylabel(label)
    axes.set_xlabel("Error (largest mixed error over the run)")
    _limits(axes, bench)
    _failures(axes, bench)
    trusted = bench.reference.trusted_error
    low, high = sorted(axes.get_xlim())
    if low < trusted < high:
        axes.axvspan(low, trusted, color="0.93", zorder=0)
    _plain_numbers(axes.yaxis, *axes.get_ylim())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_locator(LogLocator(numticks=9))


def _plain_numbers(axis: Axis, low: float, high: float) -> None:
    """Ticks at 1, 2, 5 for few decades, written without powers of ten if short."""
    narrow = math.log10(high / low) < 2.0
    decades = LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,), numticks=12)
    axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]) if high < 4.0 * low else decades)
    axis.set_minor_formatter(NullFormatter())
    if 1e-4 < low and high < 1e6:
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}" if v < 1e5 else f"{v:.0e}".replace("e+0", "e")))


def _line_style(run: Run) -> dict[str, Any]:
    fixed = run.case.step is not None
    return {
        "color": _COLORS.get(run.case.solver, "0.3"),
        "linestyle": _LINES.get(run.case.formulation, "-."),
        "marker": "s" if fixed else "o",
        "markersize": 4.0,
        "markerfacecolor": "white" if fixed else None,
    }


def _limits(axes: Axes, bench: Bench) -> None:
    errors = [max(r.error, _EXACT) for r in bench.runs if math.isfinite(r.error)]
    knobs = [r.case.tolerance for r in bench.runs if r.case.tolerance is not None]
    everything = [e for e in [*errors, *knobs] if e is not None] or [1.0]
    high, low = min(2 * max(everything), 1e3), min(everything) / 2
    axes.set_xlim(high, low)


def _failures(axes: Axes, bench: Bench) -> None:
    """Draw crosses on the upper edge, at the requested tolerance; failed fixed steps at the left.

    There is one for each solver, position and reason; the list beside the panels names every run.
    """
    bottom, top = axes.get_ylim()
    failed = [r for r in bench.runs if r.failure]
    if not failed:
        return
    order = list(bench.failures())
    axes.set_ylim(bottom, top * (top / bottom) ** 0.16)
    low, high = sorted(axes.get_xlim())
    left = high / (high / low) ** 0.02
    marks = dict.fromkeys(
        (run.case.tolerance or left, run.case.solver, order.index(generic(run.failure)) + 1) for run in failed
    )
    count: dict[float, int] = {}
    for x, solver, number in marks:
        k = count[x] = count.get(x, 0) + 1
        y = 1.0 - 0.03 * (k - 1)
        axes.plot(
            x,
            y,
            "x",
            color=_COLORS.get(solver, "0.3"),
            transform=axes.get_xaxis_transform(),
            markersize=5,
            markeredgewidth=1.4,
            clip_on=False,
        )
        axes.annotate(
            str(number),
            (x, y),
            xycoords=axes.get_xaxis_transform(),
            xytext=(4, -2.5),
            textcoords="offset points",
            fontsize=6.5,
            color="0.3",
            annotation_clip=False,
        )
