"""Plot of a fit: measured points over simulated lines, and residuals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from acausal.errors import UsageError
from acausal.plot.plot import COLORS, STYLE, Drawing, check_picture, save
from acausal.plot.scale import Scale, readable
from acausal.study.fit.fit import Fit
from acausal.study.fit.trial import compared

_MOST = 6


def fit_picture(fit: Fit, file: str | Path | None = None) -> Figure:
    """Draw a fit: one column per signal, runs above and residuals below.

    Raises
    ------
    UsageError
        AC013 for a file of another format, AC016 for more than six signals.
    """
    check_picture(file)
    names = list(fit.rms)
    if len(names) > _MOST:
        raise UsageError(
            "AC016", f"{len(names)} signals are too many for one plot", help="use acausal.compare, signal by signal"
        )
    with matplotlib.rc_context(STYLE):
        drawing = Drawing(figsize=(max(7.4, 4.6 * len(names)), 5.4), layout="constrained")
        axes = drawing.subplots(2, len(names), sharex="col", squeeze=False, height_ratios=(2.2, 1.0))
        for column, name in enumerate(names):
            _draw(fit, name, *axes[:, column])
        drawing.suptitle(f"{fit.model}: {_title(fit)}", x=0.01, ha="left", fontsize=9.5)
    save(drawing, file)
    return drawing


def _draw(fit: Fit, name: str, upper: Axes, lower: Axes) -> None:
    pairs = zip(fit.results, fit.trials, strict=True)
    found = [(r, t.name, s) for r, t in pairs for s in t.signals if s.name == name]
    scale = readable(found[0][0].unit(name), float(np.max(np.abs(np.concatenate([s.values for *_, s in found])))))
    rest = readable(found[0][0].unit(name), 3.0 * fit.rms[name])
    clock = readable("s", max(float(r.time[-1]) for r, *_ in found))
    alone = len(found) == 1
    for k, (result, title, s) in enumerate(found):
        color = COLORS[k % len(COLORS)]
        points: dict[str, Any] = {"marker": ".", "ls": "", "ms": 3.0, "color": color, "alpha": 0.45}
        upper.plot(clock(s.times), scale(s.values), label="measured" if alone else title, **points)
        line: dict[str, Any] = {"color": "black", "label": "fitted"} if alone else {"color": color}
        upper.plot(clock(result.time), scale(np.asarray(result[name])), lw=1.2, **line)
        lower.plot(clock(s.times), rest(compared(result, s.times, name) - s.values), **points)
    lower.axhspan(*rest(np.array([-1.96, 1.96]) * fit.rms[name]), color="0.9", zorder=0)
    lower.axhline(0.0, color="0.4", lw=0.8)
    upper.set_title(name, loc="left")
    upper.set_ylabel(scale.label)
    lower.set_ylabel(f"fitted - measured\n{rest.label}")
    lower.set_xlabel(f"Time {clock.label}")
    upper.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2, markerscale=2.5)


def _title(fit: Fit) -> str:
    rows = zip(fit.names, fit.value.tolist(), (fit.interval[:, 1] - fit.value).tolist(), fit.units, strict=True)
    shown = ((n, v, r, Scale(u).label.strip("[]")) for n, v, r, u in list(rows)[:4])
    return ",  ".join(f"{n} = {v:.5g} ± {r:.2g} {u}".rstrip() for n, v, r, u in shown)
