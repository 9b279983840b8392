"""Plots of results: one panel per unit, readable prefixes, events as thin vertical lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, TypeAlias

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text
from matplotlib.transforms import Transform, offset_copy

from acausal.errors import UnitError, UsageError
from acausal.panel import Panel
from acausal.plot.scale import Scale, readable, same_unit, to_unit
from acausal.result.files import atomic, check_suffix
from acausal.result.signals import Array, Signal
from acausal.units import Dimension, format_dimension, parse

if TYPE_CHECKING:
    from acausal.result.result import Result

# Further results for the same panels, with names for the legend or without.
Also: TypeAlias = "Result | Sequence[Result] | Mapping[str, Result]"

FORMATS = (".png", ".svg", ".pdf")

# Okabe and Ito's palette, distinguishable for colour-blind readers, without its yellow.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
STYLES = ("-", "--", ":", "-.")
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "legend.fontsize": 8.0,
    "axes.prop_cycle": cycler(color=COLORS),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "0.4",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.01,
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.use_mathtext": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.5,
    "legend.frameon": False,
    "svg.hashsalt": "acausal",
}
# Signals of one unit whose magnitudes differ by more than this factor get separate panels.
_SPREAD = 1e3
# Characters that fit along the vertical axis, and above a panel of 7.4 inches.
_LABEL_WIDTH = 26
_PANEL_WIDTH = 80
# Characters of a title in a figure of one column.
_TITLE_WIDTH = 60
# Width of a line relative to the height of a panel.
_LINE_WIDTH = 0.01
# A larger number of event lines would hide the curves.
_MOST_EVENTS = 60


class Drawing(Figure):
    """A figure with a canvas of its own, which a notebook shows whether or not pyplot is loaded."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self.savefig(stream, format="png", dpi=110)
        return stream.getvalue()


@dataclass(frozen=True)
class _Line:
    """One signal of one result: abscissas and scaled values, shape (n,) each."""

    label: str
    signal: Signal
    source: int
    abscissas: Array
    values: Array


@dataclass(frozen=True)
class _Group:
    """Lines that share a vertical axis."""

    signals: tuple[Signal, ...]
    lines: tuple[_Line, ...]
    scale: Scale

    def label(self, title: str) -> str:
        """What the signals are, unless `title` above the panel says the same, and their unit."""
        docs = list(dict.fromkeys(s.doc.rstrip(".") for s in self.signals if s.doc))
        docs = [] if [doc.lower() for doc in docs] == [title.lower()] else docs
        lines = wrap(", ".join(docs), _LABEL_WIDTH)
        if len(lines) > 2 or (len(docs) > 1 and len(lines) > 1):
            lines = []  # a paragraph along the axis is harder to read than the legend
        if lines and len(lines[-1]) + len(self.scale.label) < _LABEL_WIDTH:
            lines[-1] = f"{lines[-1]} {self.scale.label}".rstrip()
            return "\n".join(lines)
        return "\n".join([*lines, self.scale.label]).strip()


def plot(
    result: Result,
    *names: str,
    together: bool = False,
    xlabel: str | None = None,
    file: str | Path | None = None,
    title: str | None = None,
    against: str | None = None,
    also: Also = (),
) -> Figure:
    """Draw signals of a result, one panel per unit.

    Parameters
    ----------
    names
        Signals; an array draws one line per element.
    also
        Another result or several, or results by their names in the legend: their signals of the same names are drawn in
        the same panels and units. The name of the first result is that of its model.
    together
        Whether to draw all signals in one panel, with a second vertical axis for a second unit; dimensionless signals
        share the first axis.
    xlabel
        Text below the horizontal axis instead of the default one.
    file
        `.png` (150 dpi), `.svg` or `.pdf` to write.
    title
        Text above the figure; the model's name by default.
    against
        Signal on the horizontal axis; time by default.

    Raises
    ------
    UsageError
        AC010 for an unknown signal, AC012 and AC013 for the file, AC016 without signals or for too many units.
    """
    if not names:
        raise UsageError("AC016", "there is no signal to plot", help="result.names lists all signals")
    panels = [Panel(names)] if together else _by_unit(result, names)
    panels = [Panel(p.signals, against=against) for p in panels]
    return figure(result, panels, file=file, title=title, xlabel=xlabel, also=also)


def figure(
    result: Result,
    panels: Sequence[Panel],
    *,
    file: str | Path | None = None,
    title: str | None = None,
    xlabel: str | None = None,
    also: Also = (),
) -> Figure:
    """Draw the panels that a model defines, one below the other; arguments and errors as for `plot`."""
    if not panels:
        raise UsageError("AC016", "a figure needs at least one panel")
    check_picture(file)
    results = _labelled(result, also)
    content = [_groups(results, panel) for panel in panels]
    columns = 1 if len(panels) <= 5 else 2
    rows = -(-len(panels) // columns)
    # panels against the same signal scroll and zoom together and share the labels below, and therefore the unit
    shared = len({panel.against for panel in panels}) == 1
    clocks = [
        _horizontal_scale(results, panel, content if shared else [groups])
        for panel, groups in zip(panels, content, strict=True)
    ]
    with matplotlib.rc_context(STYLE):
        drawing = Drawing(figsize=(7.4 if columns == 1 else 12.0, 1.0 + max(2.0 * rows, 3.2)), layout="constrained")
        axes = drawing.subplots(rows, columns, sharex=shared, squeeze=False).T.ravel()
        for ax in axes[len(panels) :]:
            ax.remove()
        for i, (ax, panel, groups, scale) in enumerate(zip(axes, panels, content, clocks, strict=False)):
            label = _draw(ax, results, panel, groups, scale)
            if not shared or i % rows == rows - 1 or i == len(panels) - 1:
                ax.set_xlabel(xlabel or label)
                ax.tick_params(labelbottom=True)
        drawing.align_ylabels()
        heading = result.model if title is None else title
        if heading:
            width = _TITLE_WIDTH * columns
            drawing.suptitle("\n".join(wrap(heading, width) or [heading]), fontsize=11, fontweight="bold")
        save(drawing, file)
    return drawing


def show(drawing: Figure) -> None:
    """Open a window with a figure and wait until it is closed.

    Raises UsageError: AC017 where there is no display.
    """
    from matplotlib import pyplot

    if matplotlib.get_backend().lower() in ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template"):
        raise UsageError("AC017", "there is no display for a figure", help='write it: plot(..., file="x.png")')
    # only pyplot can open a window of the chosen toolkit: move the figure into the window of an empty one
    manager = pyplot.figure(figsize=drawing.get_size_inches()).canvas.manager
    if manager is not None:
        manager.canvas.figure = drawing
        drawing.set_canvas(manager.canvas)
    pyplot.show()


def _by_unit(result: Result, names: Sequence[str]) -> list[Panel]:
    """One panel per unit and order of magnitude, in the order of the names."""
    panels: list[tuple[str, float, float, list[str]]] = []
    for name in names:
        unit, size = result.unit(name), _magnitude(result[name])
        for i, (known, low, high, members) in enumerate(panels):
            # a signal that is always zero fits anywhere
            is_too_wide = size > 0.0 and high > 0.0 and max(high, size) > _SPREAD * min(low, size)
            if known == unit and not is_too_wide:
                sizes = [x for x in (low, high, size) if x > 0.0] or [0.0]
                panels[i] = (unit, min(sizes), max(sizes), [*members, name])
                break
        else:
            panels.append((unit, size, size, [name]))
    return [Panel(tuple(members)) for *_, members in panels]


def _magnitude(values: Array) -> float:
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if finite.size else 0.0


def _labelled(result: Result, also: Also) -> tuple[tuple[str, Result], ...]:
    """All results with their names for the legend; results of the same model are numbered."""
    if isinstance(also, Mapping):
        return ((result.model, result), *also.items()) if also else (("", result),)
    found = [result, *(also if isinstance(also, Sequence) else [also])]
    models = [r.model for r in found]
    names = [m if models.count(m) == 1 else f"{m} {k}" for k, m in enumerate(models, 1)]
    return tuple(zip(names, found, strict=True)) if len(found) > 1 else (("", result),)


def _groups(results: Sequence[tuple[str, Result]], panel: Panel) -> list[_Group]:
    """The lines of a panel by dimension, scaled; the first group is on the left axis, the second on the right one.

    Signals of one dimension share a scale. A dimensionless signal shares the scale of the quantity beside it, read in
    its SI unit as in an equation: on an axis of its own, a set point without a unit would not coincide with the value
    that tracks it.
    """
    result = results[0][1]
    signals = [signal for name in panel.signals for signal in result.elements(name)[1]]
    if not signals:
        raise UsageError("AC016", f"the panel '{panel.title}' has no signal")
    units = [signal.unit for signal in signals if not _is_plain(signal)] or [signals[0].unit]
    kinds = list(dict.fromkeys(map(_kind, units)))
    lines: dict[tuple[Dimension, bool] | str, list[Signal]] = {kind: [] for kind in kinds}
    for signal in signals:
        joins = _is_plain(signal) and len(kinds) == 1
        lines.setdefault(kinds[0] if joins else _kind(signal.unit), []).append(signal)
    if len(lines) > 2:
        raise UsageError(
            "AC016",
            f"one panel cannot show {len(lines)} units",
            evidence=[f"{m[0].unit or '1'}  {', '.join(s.name for s in m)}" for m in lines.values()],
            help="a panel has two vertical axes; draw the other signals in another panel",
        )
    return [_scaled_group(results, panel, members) for members in lines.values()]


def _is_plain(signal: Signal) -> bool:
    return signal.unit in ("", "1")


def _kind(unit: str) -> tuple[Dimension, bool] | str:
    """Key of signals that share a scale: the dimension of the unit, or its name if unknown (files of other programs).

    Hz and rad/s have separate scales although they have the same dimension: on one scale, 50 Hz would appear six times
    slower than the equal 314 rad/s.
    """
    try:
        return parse(unit).dimension, "Hz" in unit
    except UnitError:
        return unit


def _scaled_group(results: Sequence[tuple[str, Result]], panel: Panel, members: Sequence[Signal]) -> _Group:
    """Signals of one dimension, and plain numbers, on the scale of the first that is a quantity."""
    declared = next((s.unit for s in members if not _is_plain(s)), members[0].unit)
    across = _horizontal(results, panel)
    lines = [
        _Line(
            f"{s.name} ({label})" if label else s.name,
            s,
            k,
            same_unit(across.unit, result.unit(across.name))(result[across.name]),
            _values(result, s, declared),
        )
        for s in members
        for k, (label, result) in enumerate(results)
        if s.name in result
    ]
    sizes = [_magnitude(line.values) for line in lines]
    scale = readable(declared, max(sizes)) if panel.unit is None else to_unit(declared, panel.unit)
    return _Group(tuple(members), tuple(replace(line, values=scale(line.values)) for line in lines), scale)


def _horizontal(results: Sequence[tuple[str, Result]], panel: Panel) -> Signal:
    """The signal on the horizontal axis, in the unit of the first result that has one."""
    shape, (signal, *_) = results[0][1].elements(panel.against or "time")
    if shape:
        raise UsageError("AC016", f"'{panel.against}' is an array: name one of its elements for the horizontal axis")
    units = (result.unit(signal.name) for _, result in results if signal.name in result)
    return replace(signal, unit=next((unit for unit in units if unit), ""))


def _horizontal_scale(results: Sequence[tuple[str, Result]], panel: Panel, content: Sequence[list[_Group]]) -> Scale:
    """One scale for the horizontal axis of all lines in `content`."""
    lines = [line for groups in content for group in groups for line in group.lines]
    return readable(_horizontal(results, panel).unit, max(_magnitude(line.abscissas) for line in lines))


def _values(result: Result, signal: Signal, declared: str) -> Array:
    """Values in the unit of the scale, shape (n,); a result without units is assumed to have those of the first."""
    source = result.elements(signal.name)[1][0]
    source = source if source.unit else signal
    return result[signal.name] if source.unit == declared else _converted(source, declared)(result[signal.name])


def _converted(signal: Signal, declared: str) -> Scale:
    kind = _kind(declared)
    if isinstance(kind, str):
        return Scale(declared)
    return to_unit(format_dimension(kind[0]) if _is_plain(signal) else signal.unit, declared)


def _draw(ax: Axes, results: Sequence[tuple[str, Result]], panel: Panel, groups: Sequence[_Group], scale: Scale) -> str:
    """Draw one panel, its abscissas on `scale`; returns the label of its horizontal axis."""
    horizontal = _horizontal(results, panel)
    handles: list[Line2D] = []
    side = ax
    for k, group in enumerate(groups):
        side = ax if k == 0 else ax.twinx()
        for i, line in enumerate(group.lines):
            beside = " [1]" if _is_plain(line.signal) and group.scale.label else " (right)" if k else ""
            color = COLORS[len(handles) % len(COLORS)]
            # one line style per result; the next one when colours repeat, and on top of a curve that would be hidden
            covered = sum(_covers(line, other, group) for other in group.lines[:i])
            style = STYLES[(line.source + (len(handles) >= len(COLORS)) + covered) % len(STYLES)]
            handles += side.plot(scale(line.abscissas), line.values, ls=style, color=color, label=line.label + beside)
        side.set_ylabel(group.label(panel.title))
        _widen_constant(side, [line.values for line in group.lines])
        if k:
            side.grid(False)
            side.spines["right"].set_visible(True)
    if horizontal.name == "time":
        times = np.unique([scale.slope * event.time for _, result in results for event in result.events])
        if len(times) <= _MOST_EVENTS:
            ax.vlines(times, 0, 1, transform=ax.get_xaxis_transform(), color="0.55", lw=0.7, ls=(0, (4, 3)), zorder=0.9)
    if panel.title:
        ax.set_title(panel.title, loc="left")
    # place the legend outside the axes, where it covers no curve: above if it fits, else at the right
    if len(panel.title) + sum(len(str(h.get_label())) + 6 for h in handles) <= _PANEL_WIDTH:
        position: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": len(handles)}
    else:
        position = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "bbox_transform": _right_of(side)}
    ax.legend(handles=handles, borderaxespad=0.2, columnspacing=1.4, **position)
    text = horizontal.doc.rstrip(".") or horizontal.name
    return f"{text} {scale.label}".strip()


def _covers(line: _Line, other: _Line, group: _Group) -> bool:
    """Whether a line would hide another one of its result for most of the time."""
    if line.source != other.source:
        return False
    finite = np.concatenate([member.values[np.isfinite(member.values)] for member in group.lines])
    near = _LINE_WIDTH * float(np.ptp(finite)) if finite.size else 0.0
    return bool(np.mean(np.abs(line.values - other.values) <= near) > 0.5)


def _right_of(side: Axes) -> Transform:
    """Transform to a point right of the axes, beyond the ticks and label of a second scale."""
    drawing = side.get_figure(root=True)
    box = side.yaxis.get_tightbbox()
    end = max(0.0, box.x1 - side.bbox.x1) * 72.0 / drawing.dpi if box is not None and drawing is not None else 0.0
    return offset_copy(side.transAxes, drawing, x=end + 8.0, units="points")


def _widen_constant(ax: Axes, values: Sequence[Array]) -> None:
    """Widen the axis if all values are equal up to rounding errors, which a tight axis would magnify."""
    finite = np.concatenate([v[np.isfinite(v)] for v in values])
    if not finite.size:
        return
    low, high = float(finite.min()), float(finite.max())
    middle, size = (low + high) / 2, max(abs(low), abs(high))
    if high - low < 1e-9 * size or size == 0.0:
        reach = 0.1 * size or 1.0
        ax.set_ylim(middle - reach, middle + reach)


def check_picture(file: str | Path | None) -> None:
    """Raise UsageError AC013 for a file that is not a picture, before anything is drawn."""
    if file is not None:
        check_suffix(Path(file), FORMATS, "picture format")


def _as_written(drawing: Figure) -> None:
    """Show texts unchanged if their dollar signs do not enclose a formula."""
    parser = MathTextParser("path")
    for text in drawing.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text():
            try:
                parser.parse(text.get_text())
            except ValueError:
                text.set_parse_math(False)


def save(drawing: Figure, file: str | Path | None) -> None:
    """Write a figure to a file, if one is given, completely or not at all; equal figures give equal files."""
    _as_written(drawing)
    if file is None:
        return
    suffix = Path(file).suffix.lower()
    # leave out the date, so that equal figures give equal files
    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix, {})
    with atomic(Path(file)) as stream:
        drawing.savefig(stream, format=suffix[1:], dpi=150, metadata=metadata)
