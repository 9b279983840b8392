"""Every page of the tutorial and every how-to runs, cell by cell, and its figures agree with their closed forms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

from tests.pages import DOCS, blocks, run

PAGES = [f"{folder}/{page.name}" for folder in ("tutorial", "how-to") for page in (DOCS / folder).glob("*.md")]


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda p: Path(p).stem)
def test_pages_run(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    matplotlib.use("Agg")
    found = run(page, "{code-cell}")
    check = CHECKS.get(Path(page).stem)
    if check is not None:
        check(found)
    capsys.readouterr()


def vessels(found: dict[str, Any]) -> None:
    """Difference of levels: exp(-t/tau) through a pipe, (1 - t/T)^2 through an orifice (Torricelli)."""
    run = found["vessels"]
    assert np.abs(found["difference"] - np.exp(-run.time / found["tau"])).max() < 1e-5
    thin = found["thin"]
    early = thin.time < 40.0
    root = 1.0 - 1e-4 * np.sqrt(2.0 * 9.81) * thin.time[early] / 0.02
    assert np.abs(thin["full.h"][early] - thin["empty.h"][early] - root**2).max() < 1e-4


def room(found: dict[str, Any]) -> None:
    """The heater first goes off after C/G log((303.15 - 288.15)/(303.15 - 294.15)) (exponential approach)."""
    off = next(e.time for e in found["room"].events if "high" in e.condition)
    assert off == pytest.approx(5000.0 * math.log(15.0 / 9.0), abs=1e-2)


def crane(found: dict[str, Any]) -> None:
    """The momentum of 400 N.s is conserved."""
    assert np.abs(found["speed"] - 400.0 / 150.0).max() < 1e-6


def press(found: dict[str, Any]) -> None:
    """Kienzle: F_f = sin(sigma) k_c d/2 v/n with both edges."""
    run = found["press"]
    expected = math.sin(run.final("drill.sigma")) * run.at(4.0, "drill.k_c") * 4e-3 * run.at(4.0, "slide.v") / 30.0
    assert run.at(4.0, "drill.F_f") == pytest.approx(expected, rel=1e-3)


def motor(found: dict[str, Any]) -> None:
    """Without load the EMF alone balances the voltage: k ratio w = 30 V."""
    assert found["drive"].at(2.9, "controller.y") == pytest.approx(30.0, rel=1e-3)
    assert found["drive"].final("load.w") == pytest.approx(0.0, abs=1e-9)


def rig(found: dict[str, Any]) -> None:
    """The fit recovers the parameters within three of its standard deviations; the run is the page's rig."""
    fit = found["found"]
    assert np.abs(fit.value - [2.2, 4.0]).max() < 3.0 * fit.std.max()
    assert fit.rms["mass.s"] == pytest.approx(2e-3, rel=0.15)
    assert (found["measured"].unit("mass.s"), found["measured"].time[-1]) == ("mm", pytest.approx(4.0))


def servo(found: dict[str, Any]) -> None:
    """Overshoot of a second-order lag: exp(-pi zeta / sqrt(1 - zeta^2)), none above zeta = 1."""
    zeta = found["found"].values[:, 0]
    assert len(zeta) == 20
    low = zeta < 1.0
    expected = np.exp(-math.pi * zeta[low] / np.sqrt(1.0 - zeta[low] ** 2))
    assert np.abs(found["overshoot"][low] - expected).max() < 1e-3
    assert found["overshoot"][~low].max() < 1e-6


CHECKS = {
    "2-components": vessels,
    "3-events": room,
    "4-multibody": crane,
    "5-drilling": press,
    "dc-motor": motor,
    "measured-data": rig,
    "family-of-curves": servo,
}


def test_every_page_is_in_the_contents() -> None:
    """The site's index lists all pages by name or pattern; the build without warnings is checked elsewhere."""
    entries = [line for block in blocks("index.md", "{toctree}") for line in block.split("\n")]
    listed = {path for entry in entries if entry and not entry.startswith(":") for path in DOCS.glob(f"{entry}.md")}
    pages = {path for path in DOCS.rglob("*.md") if "reference" not in path.parts and "_build" not in path.parts}
    assert pages - listed == {DOCS / "index.md"}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: Path(p).stem)
def test_pages_are_notebooks_as_text(page: str) -> None:
    """The header by which jupytext and MyST-NB recognise a notebook; nbformat requires both names of the kernel."""
    head = (DOCS / page).read_text(encoding="utf-8").split("---\n")[1]
    assert head == "file_format: mystnb\nkernelspec:\n  display_name: Python 3\n  name: python3\n"
