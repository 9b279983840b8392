"""`acausal sweep` as a user calls it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import acausal
from tests.cli.running import run

DECAY = """
from acausal import Component, Equations, Real, der, fixed, parameter, variable


class Decay(Component):
    k: Real = parameter(default=1.0, unit="1/s", min=0.0, doc="Rate")
    T: Real = parameter(default=300.0, unit="K", doc="Temperature")
    x: Real = variable(default=fixed(1.0), unit="m", doc="Length")

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x
"""
COMMON = ("--stop-time", "1s", "--workers", "1")


@pytest.fixture(autouse=True)
def model(folder: Path) -> None:
    (folder / "decay.py").write_text(DECAY)


def test_a_sweep_writes_its_file_its_table_and_its_picture(folder: Path) -> None:
    done = run("sweep", "decay.py", "--vary", "k=1 1/s:2 1/s:3", *COMMON, "--table", "x.csv", "--plot")
    assert done.code == 0
    assert "3 members, 3 finished" in done.out
    found = acausal.load_sweep(folder / "Decay.sweep")
    assert found["k"].tolist() == [1.0, 1.5, 2.0]
    assert found.final("x") == pytest.approx(np.exp(-found["k"]), abs=1e-5)
    assert (folder / "x.csv").read_text().count("\n") == 4
    assert (folder / "Decay.png").stat().st_size > 10_000


def test_units_logarithms_lists_and_distributions(folder: Path) -> None:
    def values(vary: str, name: str, *more: str) -> list[float]:
        assert run("sweep", "decay.py", "--vary", vary, *COMMON, "-q", *more).code == 0
        found: list[float] = acausal.load_sweep(folder / "Decay.sweep")[name].tolist()
        (folder / "Decay.sweep").unlink()
        return found

    assert values("k=6 1/min,12 1/min", "k") == pytest.approx([0.1, 0.2])
    assert values("k=log:0.1:10:3", "k") == pytest.approx([0.1, 1.0, 10.0])
    assert values("T=20 degC,30 degC", "T") == pytest.approx([293.15, 303.15])
    drawn = np.array(values("T=normal:20 degC:2 degC", "T", "--sample", "halton:64"))
    assert (drawn.mean(), drawn.std()) == pytest.approx((293.15, 2.0), abs=0.3)


def test_failed_members_are_told_and_resumed_ones_not_run_again(folder: Path) -> None:
    vary = ("sweep", "decay.py", "--vary", "k=1,-1", *COMMON)
    done = run(*vary)
    assert (done.code, "1 member with AC136" in done.err) == (0, True)
    first = acausal.load_sweep(folder / "Decay.sweep")
    again = run(*vary, "--resume", "--json")
    assert again.json["status"] == ["ok", "failed"]
    assert again.json["seconds"][0] == first.seconds[0]
    kept = run(*vary)
    assert (kept.code, "AC062" in kept.err, "--resume" in kept.err) == (2, True, True)
    lost = run("sweep", "decay.py", "--vary", "k=-1,-2", *COMMON, "-q", "-o", "lost.sweep")
    assert (lost.code, lost.out, "2 members with AC136" in lost.err) == (1, "", True)  # an error, quiet or not


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ((), "AC060"),
        (("--vary", "k"), "AC009"),
        (("--vary", "k=1:2:3:4"), "AC009"),
        (("--vary", "k=log:1"), "AC009"),
        (("--vary", "k=1:2"), "AC060"),
        (("--vary", "k=1m:2m:3"), "AC15"),
        (("--vary", "k=2:1:3"), "AC060]: --vary k=2:1:3: "),
        (("--vary", "k=1,2", "--vary", "k=3"), "AC009"),
        (("--vary", "k=1,2", "--set", "k=3"), "AC060"),
        (("--vary", "q=1,2"), "AC020"),
        (("--vary", "k=1,2", "-o", "x.mat"), "AC013"),
        (("--vary", "k=1,2", "--table", "x.mat"), "AC013"),
        (("--vary", "k=1,2", "--signals", "z"), "AC010"),
    ],
)
def test_wrong_requests_end_with_2_and_leave_no_file(folder: Path, arguments: tuple[str, ...], code: str) -> None:
    done = run("sweep", "decay.py", *COMMON, *arguments)
    assert (done.code, code in done.err) == (2, True), done.err
    assert {p.name for p in folder.iterdir()} <= {"decay.py", "__pycache__", "Decay.sweep"}
    assert not (folder / "Decay.sweep").exists() or "q=1" in str(arguments)


def test_an_executor_that_nobody_knows_ends_a_small_sweep(folder: Path) -> None:
    done = run("sweep", "decay.py", "--vary", "k=1,2", "--stop-time", "1s", "--executor", "dask:/x", "--json")
    assert (done.code, done.json["error"]["code"]) == (2, "AC060")
    assert "'dask:/x'" in done.json["error"]["fact"]
    assert not (folder / "Decay.sweep").exists()
