"""`acausal diagram`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.running import run
from tests.diagram.drawn import drawn

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
