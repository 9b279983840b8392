"""`acausal simulate`: files, units, defaults, summary."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from acausal.result.result import load
from tests.cli.running import run


def _exact(t: float, m: float = 1.0, c: float = 100.0, d: float = 1.0, s0: float = 0.1) -> float:
    """Damped oscillator released at rest, in closed form (docstring of the model)."""
    z = d / (2.0 * m)
    w = math.sqrt(c / m - z * z)
    return s0 * math.exp(-z * t) * (math.cos(w * t) + z / w * math.sin(w * t))


def test_the_default_file_is_the_model_s_mat(folder: Path) -> None:
    outcome = run("simulate", "Oscillator", "--tolerance", "1e-9")
    assert outcome.code == 0, outcome.err
    assert "wrote Oscillator.mat" in outcome.err
    result = load("Oscillator.mat")
    assert result.final("mass.s") == pytest.approx(_exact(5.0), abs=1e-7)
    assert [p.name for p in folder.iterdir()] == ["Oscillator.mat"]


def test_csv_has_the_names_of_the_result_in_si() -> None:
    outcome = run("simulate", "Oscillator", "--output-file", "o.csv", "--output-interval", "0.5", "--stop-time", "2")
    assert outcome.code == 0, outcome.err
    with open("o.csv", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0][0] == "time"
    assert "mass.s" in rows[0]
    times = [float(row[0]) for row in rows[1:]]
    assert times == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])


def test_values_are_converted_to_the_declared_unit() -> None:
    """1000 g, 0.1 kN/m, 10 N.s/m, 50 mm; times with units too."""
    outcome = run(
        *("simulate", "Oscillator", "--set", "m=1000g", "--set", "c=0.1kN/m", "--set", "d=10", "--set", "s0=50mm"),
        *("--stop-time", "500ms", "--tolerance", "1e-9", "-o", "o.npz"),
    )
    assert outcome.code == 0, outcome.err
    result = load("o.npz")
    assert result.final("m") == 1.0
    assert result.final("mass.s") == pytest.approx(_exact(0.5, d=10.0, s0=0.05), abs=1e-8)


def test_a_bound_parameter_can_be_set_apart_from_its_source() -> None:
    """mass.m is bound to m: set alone, only the mass changes."""
    outcome = run("simulate", "Oscillator", "--set", "mass.m=4", "--tolerance", "1e-9", "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.json["final"]["mass.s"]["value"] == pytest.approx(_exact(5.0, m=4.0), abs=1e-7)


def test_structural_arguments_rebuild_the_model() -> None:
    outcome = run("simulate", "RCLadder", "--set", "n=3", "--set", "capacitors[2].C=2000mF", "--json", "--no-output")
    assert outcome.code == 0, outcome.err
    assert list(outcome.json["final"]) == ["capacitors[0].v", "capacitors[1].v", "capacitors[2].v"]


def test_drilling_by_its_names() -> None:
    """The columns other checks rely on (DRILLING.md); steady cutting force of the thin plate from its table 1."""
    outcome = run("simulate", "ThinPlate", "--set", "workpiece.t=1mm", "--stop-time", "5", "--output-file", "p.csv")
    assert outcome.code == 0, outcome.err
    result = load("p.csv")
    for name in ["s", "d_O", "d_I", "F_c", "F_f", "k_c", "torque"]:
        assert f"drill.{name}" in result
    assert np.ptp(result["drill.F_c"]) > 0.0
    assert result.time[-1] == 5.0


def test_json_is_one_object_with_stages_and_files() -> None:
    outcome = run("simulate", "Oscillator", "--json", "--plot-file", "o.svg")
    assert outcome.code == 0, outcome.err
    content = outcome.json
    assert content["files"] == ["Oscillator.mat", "o.svg"]
    assert content["final"]["mass.s"]["unit"] == "m"
    assert {"import", "compile", "initialize", "integrate", "observe", "save", "plot", "total"} <= set(
        content["timings"]
    )
    stages = ("import", "compile", "initialize", "integrate", "observe", "save", "plot")
    assert sum(content["timings"][k] for k in stages) <= content["timings"]["total"]
    assert Path("o.svg").read_text().lstrip().startswith("<?xml")


def test_summary_on_stdout_remarks_on_stderr() -> None:
    outcome = run("simulate", "Oscillator", "--stats", "--no-output")
    assert outcome.code == 0
    for word in ("solver   rosenbrock", "whole process", "flatten", "steps", "mass.s", "mass.v"):
        assert word in outcome.out
    assert "wrote nothing" in outcome.err
    assert not list(Path.cwd().iterdir())


def test_a_field_is_one_row_of_the_summary() -> None:
    """Boiling water at one end (373.15 K), air at the other (293.15 K): all cells lie between them."""
    outcome = run("simulate", "HeatedBar", "--stop-time", "600", "-o", "h.csv")
    assert outcome.code == 0, outcome.err
    (row,) = [line for line in outcome.out.splitlines() if "bar.T" in line]
    name, least, most = re.fullmatch(r" *(.*?)  +([0-9.]+) \.\.\. ([0-9.]+) K", row).groups()  # type: ignore[union-attr]
    assert name == "bar.T, 50 elements"
    assert 293.14 < float(least) < float(most) < 373.15


def test_quiet_says_nothing() -> None:
    outcome = run("simulate", "Oscillator", "--quiet", "--plot")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    assert Path("Oscillator.mat").exists()
    assert Path("Oscillator.png").read_bytes().startswith(b"\x89PNG")


def test_a_model_without_a_figure_shows_its_states() -> None:
    Path("decay.py").write_text(
        "from __future__ import annotations\n"
        "from acausal import *\n\n\n"
        "class Decay(Component):\n"
        '    """x halves again and again."""\n\n'
        "    x: Real = variable(default=1.0)\n\n"
        "    def equations(self) -> Equations:\n"
        "        yield der(self.x) == -self.x\n"
    )
    outcome = run("simulate", "decay.py", "--plot", "--json", "--tolerance", "1e-9")
    assert outcome.code == 0, outcome.err
    assert outcome.json["final"]["x"]["value"] == pytest.approx(math.exp(-1.0), rel=1e-7)
    assert Path("Decay.png").stat().st_size > 1000


def test_no_step_is_longer_than_asked_for() -> None:
    """Without the bound, 10 s take 400 steps."""
    outcome = run("simulate", "Oscillator", "--stop-time", "10", "--max-step", "2ms", "--json", "--no-output")
    assert outcome.json["stats"]["steps"] >= 5000


def test_fixed_step_is_taken_as_given() -> None:
    """Runge and Kutta's order 4 at 1 ms on the oscillator: error of the order (w h)^4 * w t = 1e-8 * 50."""
    outcome = run("simulate", "Oscillator", "--solver", "rk", "--step", "1ms", "--json", "--no-output")
    assert outcome.code == 0, outcome.err
    assert outcome.json["stats"]["solver"] == "rk"
    assert outcome.json["final"]["mass.s"]["value"] == pytest.approx(_exact(5.0), abs=1e-9)
