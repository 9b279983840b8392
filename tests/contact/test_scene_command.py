"""Models of changing structure from the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.running import run


@pytest.mark.slow
def test_the_command_line_runs_a_scene_in_pieces(tmp_path: Path) -> None:
    picture = tmp_path / "holes.png"
    done = run("simulate", "HolesSideBySide", "--set", "n=3", "--json", "--no-output", "--plot-file", picture)
    assert done.code == 0, done.err
    assert done.json["stats"]["structures"] > 2
    assert picture.stat().st_size > 10_000


def test_stats_tell_the_pairs_of_a_scene(tmp_path: Path) -> None:
    done = run("simulate", "StackedPlates", "--stop-time", "0.1", "--no-output", "--stats")
    assert done.code == 0, done.err
    assert "4 bodies, 6 pairs: 2 in the equations" in done.out
    assert "drill - upper   drilling" in done.out
