"""`acausal explore`."""

from __future__ import annotations

from pathlib import Path

from tests.cli.running import run


def test_results_are_explored() -> None:
    run("simulate", "Oscillator", "-q")
    run("simulate", "Oscillator", "--set", "c=200", "-o", "stiff.csv", "-q")
    assert run("explore", "Oscillator.mat").code == 0
    assert '"mass.s"' in Path("Oscillator.html").read_text()
    outcome = run("explore", "Oscillator.mat", "stiff.csv", "--signals", "mass.s", "-o", "both.html")
    assert outcome.code == 0, outcome.err
    assert "<title>Oscillator and stiff</title>" in Path("both.html").read_text()


def test_files_of_one_name_keep_their_folders() -> None:
    Path("other").mkdir()
    run("simulate", "Oscillator", "-q")
    run("simulate", "Oscillator", "-q", "-o", "other/Oscillator.mat")
    assert run("explore", "Oscillator.mat", "other/Oscillator.mat", "-o", "both.html").code == 0
    assert "other/Oscillator.mat" in Path("both.html").read_text()
