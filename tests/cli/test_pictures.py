"""`acausal animate`, `diagram` and `explore`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.running import run
from tests.diagram.drawn import drawn

pytest.importorskip("pygltflib")


def test_a_model_is_simulated_and_shown() -> None:
    outcome = run("animate", "Pendulum", "--poses", "50", "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.json["files"] == ["Pendulum.html"]
    assert outcome.json["poses"] == 51
    assert Path("Pendulum.html").stat().st_size > 600_000
    assert run("animate", "Pendulum", "-o", "p.glb").code == 0
    assert Path("p.glb").read_bytes()[:4] == b"glTF"


def test_a_result_knows_its_shipped_model_and_is_told_others() -> None:
    assert run("simulate", "PendulumChain", "--set", "n=2", "-q").code == 0
    outcome = run("animate", "PendulumChain.mat", "--set", "n=2", "--json", "-o", "a.glb")
    assert outcome.code == 0, outcome.err
    assert "links[1]" in {n["name"] for n in outcome.json["nodes"]}
    Path("PendulumChain.mat").rename("run.mat")
    assert "AC082" in run("animate", "run.mat").err
    assert run("animate", "run.mat", "--model", "PendulumChain", "--set", "n=2", "-o", "a.glb").code == 0
    # With fewer links it is another model; with more, what is missing is said.
    assert "AC082" in run("animate", "run.mat", "--model", "PendulumChain", "--set", "n=1", "-o", "a.glb").err
    assert "links[2]" in run("animate", "run.mat", "--model", "PendulumChain", "-o", "a.glb").err


pytest.importorskip("dukpy")


def test_models_and_components_are_drawn() -> None:
    quiet = run("diagram", "Oscillator", "--quiet")
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")
    assert set(drawn(Path("Oscillator.svg").read_text()).blocks) == {"wall", "damper", "mass", "spring"}
    told = run("diagram", "DrillingForce", "-o", "force.html", "--json")
    assert (told.err, told.json) == ("", {"model": "DrillingForce", "files": ["force.html"]})
    assert "diagramLayout" in Path("force.html").read_text()
    outcome = run("diagram", "PendulumChain", "--set", "n=2", "-o", "chain.svg")
    assert outcome.code == 0, outcome.err
    assert "links[1]" in drawn(Path("chain.svg").read_text()).blocks


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
