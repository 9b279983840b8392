"""`acausal animate`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.running import run

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
