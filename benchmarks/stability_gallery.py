"""Writes docs/stability-gallery.md and its pictures: 23 small scenes, the methods that fail on them, and the remedies.

Every curve and every figure on the page comes from a run made by this command; the verdicts are those of
`acausal stability`.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from gallery import contact, pendulum, smooth, switching
from gallery.methods import Exhibit
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import acausal
from acausal.cli.arguments.shipped import shipped_models
from acausal.errors import AcausalError

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "stability-gallery.md"
PICTURES = ROOT / "docs" / "images" / "stability"
GROUPS = (
    ("Constraints and starts", "pendulum", pendulum),
    ("Contact and drilling", "contact", contact),
    ("Oscillations, stiffness, attitude, invariants", "smooth", smooth),
    ("Switches and branches", "switching", switching),
)
COLORS = ("#D55E00", "#E69F00", "#CC79A7", "#56B4E9", "#999999")
OURS = "#0072B2"
HEAD = """# Stability gallery

On each of these twenty-three small scenes a common numerical method fails. The page shows how it fails, what acausal
does instead, and which solver

    acausal stability SCENE

recommends. The scenes are in `models/stability/` (`invariant` is problem E5 of `models/ivp/`). For each, a test in
`tests/stability/` checks the pass criterion and the verdict.

`python benchmarks/stability_gallery.py` writes this page. It ran every method named here: hand-written right-hand
sides in SciPy, in CasADi's IDAS, or with fixed steps. *fails* marks the failure that the scene demonstrates.
"""


def main() -> None:
    """Run everything, or the scenes asked for, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", metavar="SCENE", help="run one scene and print it; writes only --output")
    parser.add_argument("--output", type=Path, help="with --only: picture of that scene")
    arguments = parser.parse_args()
    if arguments.only:
        for _, _, group in GROUPS:
            for exhibit in group.exhibits():
                if exhibit.scene == arguments.only:
                    print("\n".join(section(exhibit)))
                    if arguments.output:
                        draw([exhibit], arguments.output)
        return
    PICTURES.mkdir(parents=True, exist_ok=True)
    lines = [HEAD]
    for title, name, group in GROUPS:
        shown = list(group.exhibits())
        draw(shown, PICTURES / f"{name}.png")
        lines += [f"## {title}", "", f"![{title}: the scenes of this section](images/stability/{name}.png)", ""]
        for exhibit in shown:
            print(exhibit.scene)
            lines += section(exhibit)
    PAGE.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")
    print(f"wrote {PAGE.relative_to(ROOT)} and {len(GROUPS)} pictures")


def section(exhibit: Exhibit) -> Iterator[str]:
    """Lines of the page for one scene."""
    yield f"### {exhibit.title} (`{exhibit.scene}`)"
    yield ""
    yield exhibit.what
    yield ""
    yield "| method | outcome | |"
    yield "|---|---|---|"
    for case in exhibit.cases:
        outcome = case.outcome.replace("|", "\\|")
        yield f"| {case.method.replace('|', chr(92) + '|')} | {outcome} | {'fails' if case.fails else 'ok'} |"
    yield ""
    yield f"**acausal:** {exhibit.done}"
    yield ""
    yield verdict(exhibit.model)
    yield ""


def verdict(name: str) -> str:
    """The verdict of `acausal stability` in one line."""
    model = next(m for m in shipped_models() if m.name == name)
    cls: Any = getattr(importlib.import_module(model.module), name)
    command = f"`acausal stability {name}`"
    try:
        study = acausal.stability(
            cls(), stop_time=min(cls.experiment.stop_time, 50.0) if name == "PendulumDrift" else None
        )
    except AcausalError as error:
        return f"{command}: refused, {error.code}: {error.fact}."
    found = study.verdict
    avoid = dict.fromkeys(f"{a.method}" + (f" ({a.solver})" if a.solver else "") for a in found.avoid)
    text = f"{command}: **{found.solver}**, {found.kind}; {found.why[0]}."
    return text + (f" Avoid: {', '.join(avoid)}." if avoid else " Nothing to avoid.")


def draw(exhibits: Sequence[Exhibit], file: Path) -> None:
    """One panel per scene, two in a row."""
    columns = min(2, len(exhibits))
    rows = -(-len(exhibits) // columns)
    figure = Figure(figsize=(6.1 * columns, 4.0 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax, exhibit in zip(axes, exhibits, strict=False):
        colors = iter(COLORS)
        for case in exhibit.cases:
            if case.curve is None:
                continue
            ours = case.method.startswith("acausal")
            color, style = (OURS, "-") if ours else (next(colors), "--")
            t, y = case.curve
            marker = "o" if len(t) < 12 else None
            ax.plot(
                t,
                y,
                style,
                color=color,
                lw=2.2 if ours else 1.3,
                marker=marker,
                ms=3.5,
                label=case.method,
                zorder=3 - ours,  # below: what agrees with it stays visible as dashes on it
            )
            if case.fails and len(t):
                ax.plot(t[-1], y[-1], "x", color=color, ms=7, mew=1.8, zorder=4)
        if "x" in exhibit.log:
            ax.set_xscale("log")
        if "y" in exhibit.log:
            ax.set_yscale("log")
        if exhibit.limits:
            ax.set_ylim(*exhibit.limits)
        ax.set_title(f"{exhibit.title}\n({exhibit.scene})", loc="left", fontsize=9)
        ax.set_xlabel(exhibit.x, fontsize=8)
        ax.set_ylabel(exhibit.y, fontsize=8)
        ax.tick_params(which="both", labelsize=7.5)
        ax.grid(color="0.92", lw=0.6)
        # below the panel: within, "best" still covers the start of a curve
        place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.17), "borderaxespad": 0.0}
        ax.legend(fontsize=7.5, ncols=2, frameon=False, **place)
    for ax in axes[len(exhibits) :]:
        ax.set_axis_off()
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main()
