"""`acausal bench`, `simulate --accuracy`, `--real-time-factor` and `export step` as a user calls them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from acausal.lower.compile import compile as compile_model
from acausal.models.bouncing_ball import BouncingBall
from acausal.simulate.native import cache
from tests.cli.running import run

DRIVEN = """
from acausal import Component, Equations, Real, der, fixed, signal_input, variable


class Driven(Component):
    u: Real = signal_input()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.u - self.x
"""
QUICK = ("--repeat", "1", "--no-native", "--stop-time", "0.5s")


def test_the_table_names_runs_and_reference() -> None:
    asked = ("bench", "Pendulum", "--solver", "rosenbrock", "--tolerance", "1e-4", "--tolerance", "1e-8", *QUICK)
    found = run(*asked, "--details", "--accuracy", "1e-5")
    assert found.code == 0
    lines = found.out.splitlines()
    assert lines[0].startswith("verdict: rosenbrock")
    assert any("digits trusted" in line for line in lines[1:5])
    first = next(k for k, line in enumerate(lines) if line.split()[0] == "series")
    assert [line.split()[:3] for line in lines[first + 1 : first + 3]] == [
        ["rosenbrock", "tolerance", "0.0001"],
        ["rosenbrock", "tolerance", "1e-08"],
    ]
    assert "reference: rosenbrock" in found.err
    # what is recommended can be typed in
    command = lines[-1].split()
    assert command[:3] == ["acausal", "simulate", "Pendulum"]
    assert run(*command[1:], "--no-output").code == 0


def test_json_and_chart(folder: Path) -> None:
    found = run(
        "bench", "Pendulum", "--solver", "rk2", "--step", "10ms", "--formulation", "torn", "-q", "--json",
        "--output-file", "chart.svg", "-o", "data.json", *QUICK,
    )  # fmt: skip
    assert found.code == 0
    assert found.err == ""
    content = found.json
    (only,) = content["runs"]
    assert only["solver"] == "rk2"
    assert only["step"] == 0.01
    assert only["steps"] == 50  # the grid of errors does not cut the steps that were asked for
    assert only["error"] > 0
    assert not only["failed"]
    assert content["reference"]["trusted_digits"] > 8
    assert "<svg" in (folder / "chart.svg").read_text()
    assert json.loads((folder / "data.json").read_text())["model"] == "Pendulum"


@pytest.mark.slow
def test_inputs_are_given_as_for_a_run(folder: Path) -> None:
    (folder / "driven.py").write_text(DRIVEN)
    missing = run("bench", "driven.py", "--tolerance", "1e-4", "-q", *QUICK)
    assert (missing.code, "AC033" in missing.err) == (2, True)
    asked = ("driven.py", "--input", "u=2", "--solver", "erk", "--tolerance", "1e-4", "--tolerance", "1e-6")
    found = run("bench", *asked, "--recommend", "-q", "-o", "a.svg", "-o", "a.json", *QUICK)
    assert found.code == 0
    # the accuracy is that of the model's experiment when none is named
    assert "recommended for 1e-06" in found.out
    command = found.out.strip().splitlines()[-1].split()
    assert run(*command[1:], "--no-output").code == 0
    assert (folder / "a.svg").exists()
    assert json.loads((folder / "a.json").read_text())["components"] == ["x"]
    assert run("stability", "driven.py", "--input", "u=2").code == 0
    assert run("reduce", "driven.py", "--outputs", "x", "--input", "u=2", "--repeat", "1").code == 0


@pytest.mark.slow
def test_accuracy_instead_of_a_tolerance() -> None:
    found = run("simulate", "Pendulum", "--accuracy", "1e-5", "--stop-time", "0.2s", "--json", "--no-output")
    assert found.code == 0
    chosen = found.json["stats"]["accuracy"]
    assert chosen["error"] <= 1e-5
    assert found.json["stats"]["solver"] == chosen["solver"]
    assert found.json["stats"]["tolerance"] == chosen["tolerance"]


@pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")
def test_real_time_factor() -> None:
    found = run("simulate", "ThinPlate", "--real-time-factor", "--json", "--no-output")
    paced = found.json["real_time"]
    assert paced["method"] == "rk2"
    assert paced["steps"] == 10_000
    assert paced["factor"] == pytest.approx(1e-3 / paced["mean"])
    # rk2 is exact for constant feed, and so is the run
    assert paced["largest_difference"] < 1e-9


def test_a_model_without_compiled_steps_says_why() -> None:
    found = run(
        "simulate", "RCLadder", "--set", "n=100", "--solver", "idas", "--real-time-factor", "--json", "--no-output"
    )
    assert found.json["real_time"]["failure"].startswith("AC606")


def test_a_step_function_is_exported(folder: Path) -> None:
    assert run("export", "step", "Pendulum", "--step", "2ms", "--method", "rosenbrock").code == 0
    whole = (folder / "Pendulum_step.c").read_text()
    assert "pendulum_step(" in whole
    assert "step.error [1]" in whole
    assert run("export", "step", "Pendulum", "--step", "2ms", "--method", "rosenbrock", "--no-error").code == 0
    bare = (folder / "Pendulum_step.c").read_text()
    assert "step.error" not in bare
    assert len(bare) < len(whole)


def test_outputs_of_a_step_are_separated_by_commas() -> None:
    named = run("export", "step", "BouncingBall", "--outputs", "h,v", "--json").json
    assert [port["name"] for port in named["y"][:2]] == ["h", "v"]


def test_a_step_is_written_to_c_files_only(folder: Path) -> None:
    """`-o rt` left a file whose name tells nobody what it holds."""
    found = run("export", "step", "Pendulum", "-o", "rt")
    assert found.code == 2
    assert "AC013" in found.err
    assert ".c" in found.err
    assert not (folder / "rt").exists()


def test_operations_of_a_step_with_events_are_those_of_what_it_calls() -> None:
    """A step evaluates the rates four times at least (RK4), so it takes more operations than a handful of calls."""
    found = run("export", "step", "BouncingBall", "--json").json
    assert found["operations"] > 4 * compile_model(BouncingBall()).rhs.n_instructions()


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("bench", "Pendulum", "--recommend", "--accuracy", "2"), "AC041"),
        (("bench", "Pendulum", "--solver", "euler"), "AC032"),
        (("bench", "Pendulum", "-o", "chart.bmp"), "AC013"),
        (("simulate", "Pendulum", "--accuracy", "1e-6", "--tolerance", "1e-6"), "AC043"),
    ],
)
def test_wrong_requests(arguments: tuple[str, ...], code: str) -> None:
    found = run(*arguments)
    assert found.code == 2
    assert code in found.err


def test_failures_and_orders_stand_in_the_table(tmp_path: Path) -> None:
    # x' = -50 x: steps of 0.1 s are far beyond the limit 2/50 of Heun's method, which is of order 2 below it
    (tmp_path / "fast.py").write_text(
        "from acausal import Component, Equations, Experiment, Real, der, fixed, variable\n"
        "class Fast(Component):\n"
        "    x: Real = variable(default=fixed(1.0))\n"
        "    experiment = Experiment(stop_time=1.0)\n"
        "    def equations(self) -> Equations:\n"
        "        yield der(self.x) == -50.0 * self.x\n"
    )
    steps = [part for step in ("100ms", "2ms", "1ms") for part in ("--step", step)]
    found = run("bench", f"{tmp_path / 'fast.py'}:Fast", "--solver", "rk2", *steps, "--repeat", "1", "-q", "--details")
    assert found.code == 0
    assert "failed: AC405: a step of 0.1 s is unstable with Heun (RK2)" in found.out
    assert "order      rk2: observed 2." in found.out
    assert "drift" not in found.out


@pytest.mark.slow
def test_a_solution_that_ends_has_no_reference_beyond(tmp_path: Path) -> None:
    (tmp_path / "pole.py").write_text(
        "from acausal import Component, Equations, Experiment, Real, der, fixed, variable\n"
        "class Pole(Component):\n"
        "    x: Real = variable(default=fixed(1.0))\n"
        "    experiment = Experiment(stop_time=2.0)\n"
        "    def equations(self) -> Equations:\n"
        "        yield der(self.x) == self.x**2\n"
    )
    found = run("bench", f"{tmp_path / 'pole.py'}:Pole", "--solver", "erk", "--repeat", "1", "-q")
    assert found.code == 1
    assert "AC410" in found.err
    assert "seems to end near t = 1 s" in found.err


def test_solvers_that_count_nothing_have_steps_and_orders(tmp_path: Path) -> None:
    (tmp_path / "lag.py").write_text(
        "from acausal import Component, Equations, Experiment, Real, der, fixed, variable\n"
        "class Lag(Component):\n"
        "    x: Real = variable(default=fixed(1.0))\n"
        "    y: Real = variable()\n"
        "    experiment = Experiment(stop_time=10.0)\n"
        "    def equations(self) -> Equations:\n"
        "        yield der(self.x) == -self.x\n"
        "        yield self.y == 2.0 * self.x\n"
    )
    steps = ("--step", "16.7ms", "--step", "8.4ms")  # two and four between every two of 300 points
    found = run(
        *("bench", f"{tmp_path / 'lag.py'}:Lag", "--solver", "rk", "--signals", "y*", *steps, "--repeat", "1"),
        *("-q", "--json"),
    )
    assert found.code == 0
    assert found.json["components"] == ["y"]
    assert [r["steps"] for r in found.json["runs"]] == [600, 1200]
    assert found.json["orders"]["rk"]["observed"] == pytest.approx(4.0, abs=0.1)
    assert found.json["orders"]["rk"]["classical"] == 4
