"""Eigenvalues of a run in the complex plane, with the stability regions of the methods at one step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from acausal.plot.plot import Drawing, check_picture, save
from acausal.simulate.step_limit.amplification import METHODS
from acausal.study.stability.report import Stability

_SHOWN = {"euler": "#E69F00", "rk2": "#D55E00", "rk4": "#009E73", "erk": "#0072B2"}
_TITLES = {m.name: m.title for m in METHODS}


def stability_picture(study: Stability, file: str | Path | None = None) -> Figure:
    """Plot all eigenvalues h*lambda on symmetric logarithmic axes, and those near the origin on linear ones.

    Raises
    ------
    UsageError
        AC013 for a suffix that is no picture format.
    """
    check_picture(file)
    figure = Drawing(figsize=(10.5, 5.2), layout="constrained")
    whole, near = figure.subplots(1, 2)
    times = np.array([local.point.t for local in study.locals])
    z = [study.step * local.eigenvalues for local in study.locals]
    _regions(near, linear=True)
    _regions(whole, linear=False)
    shade = None
    for ax in (whole, near):
        for t, values in zip(times, z, strict=True):
            shade = ax.scatter(
                values.real, values.imag, c=np.full(len(values), t), vmin=times.min(), vmax=times.max(), s=16,
                cmap="viridis", edgecolors="0.2", linewidths=0.3, zorder=3,
            )  # fmt: skip
        ax.axvline(0.0, color="0.6", lw=0.8, zorder=1)
        ax.axhline(0.0, color="0.6", lw=0.8, zorder=1)
        ax.set_xlabel(r"Re $h\lambda$")
        ax.grid(color="0.92", lw=0.6)
    reach = max((float(np.max(np.abs(v), initial=0.0)) for v in z), default=1.0)
    bound = 10.0 ** np.ceil(np.log10(max(reach, 10.0)))
    for set_scale, set_limits in ((whole.set_xscale, whole.set_xlim), (whole.set_yscale, whole.set_ylim)):
        set_scale("symlog", linthresh=0.1, linscale=0.6)
        set_limits(-bound, bound)
    near.set_xlim(-6.0, 2.0)
    near.set_ylim(-4.2, 4.2)
    near.set_aspect("equal")
    whole.set_ylabel(r"Im $h\lambda$")
    whole.set_title("All modes of the run", loc="left", fontsize=10)
    near.set_title("Near the origin", loc="left", fontsize=10)
    handles = [Line2D([], [], color=c, lw=1.6, label=f"stable inside: {_TITLES[n]}") for n, c in _SHOWN.items()]
    handles.append(Line2D([], [], marker="o", ls="", color="#3b528b", markersize=4, label="eigenvalue, by time"))
    figure.legend(handles=handles, fontsize=8.5, loc="outside lower center", ncols=len(handles), frameon=False)
    if shade is not None and len(times) > 1 and any(len(values) for values in z):
        figure.colorbar(shade, ax=(whole, near), label="time [s]", fraction=0.03, pad=0.01)
    what = f"eigenvalues times a step of h = {study.step:.3g} s"
    if not any(len(values) for values in z):
        what = "no state has dynamics of its own, so there are no eigenvalues"
    figure.suptitle(f"{study.model}: {what}; use {study.verdict.solver}")
    save(figure, file)
    return figure


def _regions(ax: Axes, linear: bool) -> None:
    """Draw the borders |R| = 1 of the explicit methods."""
    if linear:
        x, y = np.linspace(-6.0, 2.0, 500), np.linspace(-4.2, 4.2, 500)
    else:
        positive = np.concatenate([np.linspace(0.0, 0.1, 30)[:-1], np.geomspace(0.1, 6.0, 300)])
        x = y = np.concatenate([-positive[:0:-1], positive])
    grid = x[None, :] + 1j * y[:, None]
    for method in METHODS:
        if method.name in _SHOWN:
            size = np.abs(method.amplification(grid))
            ax.contour(x, y, size, levels=[1.0], colors=[_SHOWN[method.name]], linewidths=1.4, zorder=2)
