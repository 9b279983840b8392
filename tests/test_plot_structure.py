"""Spy plots: contents of the two panels; the second one is block lower triangular."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from matplotlib.collections import PatchCollection
from typer.testing import CliRunner

import acausal
from acausal.analyse.blocks.solve import BlockKind
from acausal.cli.main import app
from acausal.errors import UsageError
from acausal.lower.compiled import CompiledModel
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.pendulum_chain import PendulumChain
from acausal.models.rc_ladder import RCLadder
from acausal.plot import structure
from acausal.plot.structure import pattern, spy


@pytest.fixture(scope="module")
def compiled() -> CompiledModel:
    return acausal.compile(PendulumChain(n=3))


def test_pattern_is_lower_triangular_by_blocks(compiled: CompiledModel) -> None:
    """Every equation needs only unknowns of its own block and of earlier ones, and its own diagonal entry."""
    found = pattern(compiled)
    block = np.concatenate([np.full(size, k) for k, (_, size, _) in enumerate(found.blocks)])
    rows, columns = found.row_place[found.rows], found.column_place[found.columns]
    assert np.all(block[columns] <= block[rows])
    assert set(np.flatnonzero(np.bincount(rows[rows == columns], minlength=found.size))) == set(range(found.size))
    assert sorted(found.row_place) == sorted(found.column_place) == list(range(found.size))
    # In the order of composition it is not.
    assert np.any(found.columns > found.rows)


def test_two_panels_hold_every_entry(compiled: CompiledModel) -> None:
    figure = spy(compiled)
    before, after = figure.axes
    found = pattern(compiled)
    for ax, rows, columns in (
        (before, found.rows, found.columns),
        (after, found.row_place[found.rows], found.column_place[found.columns]),
    ):
        (line,) = ax.get_lines()
        assert np.array_equal(line.get_xdata(), columns)
        assert np.array_equal(line.get_ydata(), rows)
        assert ax.get_ylim()[0] > ax.get_ylim()[1]  # the first equation stands on top
    frames = [c for c in after.collections if isinstance(c, PatchCollection)]
    assert sum(len(c.get_paths()) for c in frames) == sum(size > 1 for _, size, _ in found.blocks)
    assert "blocks" in after.get_title()


def test_every_kind_of_block_has_a_colour_and_a_name() -> None:
    """A drill in a plate has blocks that are iterated inside the equations, which the pendulums above do not have."""
    assert set(structure._COLOR) == set(structure._MEANING) == set(get_args(BlockKind))
    drill = acausal.compile(ThickBlock())
    assert "monotone" in {kind for *_, kind in pattern(drill).blocks}
    (legend,) = spy(drill).legends
    assert any("iterated inside the equations" in text.get_text() for text in legend.get_texts())


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_files(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"ladder{suffix}"
    spy(acausal.compile(RCLadder(n=3)), file)
    assert file.stat().st_size > 2000


def test_wrong_suffix_is_refused_before_anything_is_drawn(tmp_path: Path, compiled: CompiledModel) -> None:
    with pytest.raises(UsageError, match="is no picture format"):
        spy(compiled, tmp_path / "x.bmp")


def test_spy_from_the_command_line(tmp_path: Path) -> None:
    file = tmp_path / "structure.png"
    outcome = CliRunner().invoke(app, ["info", "Pendulum", "--stats", "--spy", str(file)])
    assert outcome.exit_code == 0
    assert file.stat().st_size > 2000
    assert "States, and the reasons for their choice" in outcome.output
