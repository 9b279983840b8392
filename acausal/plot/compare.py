"""Plot of two results and their difference, for `acausal compare --plot`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from acausal.errors import UsageError
from acausal.plot.plot import COLORS, STYLE, Drawing, check_picture, save
from acausal.plot.scale import readable, same_unit

if TYPE_CHECKING:
    from acausal.result.result import Result

# Up to this many rows the first result is drawn as points, because it may be a measurement.
_POINTS = 2000
# More signals go to further rows: a wider figure would be shrunk until its texts cannot be read.
_COLUMNS = 2


def compared(first: Result, second: Result, names: Sequence[str], file: str | Path | None = None) -> Figure:
    """Draw signals of both results beside each other: values above, `second - first` below, in the unit of the first.

    Differences are taken at the times of the first within the second's run.

    Raises UsageError: AC013 for a file of another format, AC016 without a signal.
    """
    check_picture(file)
    if not names:
        raise UsageError("AC016", "there is no signal to compare")
    columns = min(len(names), _COLUMNS)
    rows = -(-len(names) // columns)
    with matplotlib.rc_context(STYLE):
        drawing = Drawing(figsize=(max(7.4, 4.6 * columns), 0.4 + 5.0 * rows), layout="constrained")
        heights = (2.2, 1.0) * rows
        axes = drawing.subplots(2 * rows, columns, sharex="col", squeeze=False, height_ratios=heights)
        for k in range(rows * columns):
            row, column = divmod(k, columns)
            upper, lower = axes[2 * row : 2 * row + 2, column]
            if k < len(names):
                _draw(first, second, names[k], upper, lower)
                lower.tick_params(labelbottom=True)
            else:
                upper.remove()
                lower.remove()
        drawing.suptitle(f"{first.model} and {second.model}", fontsize=11, fontweight="bold")
    save(drawing, file)
    return drawing


def _draw(first: Result, second: Result, name: str, upper: Axes, lower: Axes) -> None:
    unit = first.unit(name) or second.unit(name)
    convert = same_unit(first.unit(name), second.unit(name))
    x, y = first[name], convert(second[name])
    # at an event use the values after it, as `at` does
    last = np.append(np.diff(first.time) > 0.0, True)
    inside = last & (first.time >= second.time[0]) & (first.time <= second.time[-1])
    times = first.time[inside]
    difference = convert(np.asarray(second.at(times, name))) - x[inside]
    scale = readable(unit, float(np.nanmax(np.abs(np.concatenate([x, y])))))
    difference_scale = readable(unit, float(np.nanmax(np.abs(difference))) if difference.size else 0.0)
    clock = readable("s", float(max(first.time[-1], second.time[-1])))
    points: dict[str, Any] = {"marker": ".", "ls": "", "ms": 3.0, "color": COLORS[0], "alpha": 0.6}
    style: dict[str, Any] = points if len(first.time) <= _POINTS else {"color": COLORS[0]}
    upper.plot(clock(first.time), scale(x), label=first.model, **style)
    upper.plot(clock(second.time), scale(y), lw=1.2, color=COLORS[1], label=second.model)
    lower.plot(clock(times), difference_scale(difference), **style)
    lower.axhline(0.0, color="0.4", lw=0.8)
    upper.set_title(name, loc="left")
    upper.set_ylabel(scale.label)
    lower.set_ylabel(f"difference\n{difference_scale.label}")
    lower.set_xlabel(f"Time {clock.label}")
    upper.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2, markerscale=2.5)
