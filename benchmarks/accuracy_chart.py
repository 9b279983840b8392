"""The table of docs/accuracy.md as a picture, drawn by accuracy.py: a dot for each problem, solver and tolerance.

python benchmarks/accuracy_chart.py [--page docs/accuracy.md] [--output docs/images/accuracy.png]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "accuracy.png"
TOLERANCES = ("1e-4", "1e-6", "1e-8", "1e-10")
COLOURS = {"rosenbrock": "tab:blue", "idas": "tab:orange", "cvodes": "tab:green", "erk": "tab:red"}
LEAST, MOST = 1e-2, 1e5
"""Range of errors that are drawn; the table says "< 0.01" below the first."""


def cells(page: str) -> dict[tuple[str, str], list[str]]:
    """The texts of each solver and of the "default" at each tolerance, one per problem."""
    found: dict[tuple[str, str], list[str]] = {}
    for row in page.splitlines():
        entries = [entry.strip() for entry in row.strip("|").split("|")]
        solver = entries[2].strip("*") if len(entries) == 3 + len(TOLERANCES) else ""
        if solver not in COLOURS:
            continue
        for tolerance, text in zip(TOLERANCES, entries[3:], strict=True):
            for name in (solver, "default") if text.startswith("**") else (solver,):
                found.setdefault((name, tolerance), []).append(text.strip("*"))
    return found


def errors(texts: list[str]) -> tuple[list[float], int]:
    """Errors divided by tolerance, and the number of runs without one; cells without a known answer are left out."""
    known = [text for text in texts if text != "-"]
    ended = [text for text in known if not text.lstrip("< ").replace(".", "").replace("e+", "").isdigit()]
    return [float(text.lstrip("< ")) for text in known if text not in ended], len(ended)


def draw(page: Path, output: Path = PICTURE) -> None:
    """Write the picture of a page."""
    table = cells(page.read_text())
    names = [*COLOURS, "default"]
    figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
    shift = np.random.default_rng(0)
    for k, tolerance in enumerate(TOLERANCES):
        for j, name in enumerate(names):
            found, ended = errors(table.get((name, tolerance), []))
            place = k + (j - 2) * 0.17
            axes.scatter(
                place + shift.uniform(-0.05, 0.05, len(found)),
                np.clip(found, LEAST, MOST),
                s=14 if name != "default" else 22,
                color=COLOURS.get(name, "black"),
                alpha=0.6,
                edgecolors="none",
                label=("selected by auto" if name == "default" else name) if k == 0 else None,
            )
            if ended:
                axes.annotate(str(ended), (place, MOST * 2), ha="center", color=COLOURS.get(name, "black"))
    axes.axhline(10.0, color="black", linewidth=1, linestyle="--")
    axes.set(
        yscale="log",
        ylim=(LEAST / 2, MOST * 5),
        xticks=range(len(TOLERANCES)),
        xticklabels=TOLERANCES,
        xlabel="tolerance",
        ylabel="error at the end / tolerance",
    )
    axes.set_yticks(
        [LEAST, *10.0 ** np.arange(-1, 6)], ["≤ 0.01", *(f"$10^{{{k}}}$" for k in range(-1, 5)), "≥ $10^5$"]
    )
    axes.set_title("One dot per problem; numbers at the top: runs without a result", fontsize=10)
    axes.grid(axis="y", alpha=0.3)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=len(names), frameon=False)
    figure.savefig(output, dpi=110)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "accuracy.md")
    parser.add_argument("--output", type=Path, default=PICTURE)
    options = parser.parse_args()
    draw(options.page, options.output)


if __name__ == "__main__":
    main()
