"""Regenerative turning against the roots of its characteristic equation, and what a model with delays is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import acausal
from acausal.cli.main import app
from acausal.errors import UsageError
from acausal.models.turning import RegenerativeTurning

M, W, ZETA, K, TURN = 1.0, 1570.8, 0.03, 2e9, 0.02


def root(b: float) -> complex:
    """The rightmost root of M s^2 + 2 zeta M W s + M W^2 + K b (1 - exp(-s T)), by Newton's method from many starts."""
    found = []
    for w in np.linspace(0.9 * W, 1.4 * W, 120):
        s = complex(0.0, w)
        for _ in range(60):
            e = K * b * np.exp(-s * TURN)
            value = M * s**2 + 2 * ZETA * M * W * s + M * W**2 + K * b - e
            s -= value / (2 * M * s + 2 * ZETA * M * W + TURN * e)
        found.append(s)
    return max(found, key=lambda s: s.real)


@pytest.mark.parametrize("b", [0.14e-3, 0.18e-3])
def test_amplitudes_grow_as_the_rightmost_root_says(b: float) -> None:
    s = root(b)
    r = acausal.simulate(RegenerativeTurning(b=b))
    assert r.stats["solver"] == "rosenbrock"

    def size(start: float) -> float:
        """Amplitude of the motion that goes like exp(s t), over forty of its periods of about 4 ms."""
        part = (r.time >= start) & (r.time < start + 0.04)
        basis = np.exp(s.real * (r.time[part] - start)) * np.exp(1j * s.imag * r.time[part])
        parts = np.column_stack([basis.real, basis.imag, np.ones(part.sum())])
        return float(np.hypot(*np.linalg.lstsq(parts, r["tool.s"][part], rcond=None)[0][:2]))

    # roots next to it have not quite died out
    assert np.log(size(0.34) / size(0.24)) / 0.1 == pytest.approx(s.real, abs=0.6)
    assert (s.real > 0) == (b > 0.164e-3)


def test_native_code_gives_the_same() -> None:
    one, other = (acausal.simulate(RegenerativeTurning(), stop_time=0.1, native=n) for n in (True, False))
    assert one.final("tool.s") == pytest.approx(other.final("tool.s"), rel=1e-5)


REFUSED: dict[str, Callable[[Any], object]] = {
    "linearize": lambda m: acausal.linearize(m),
    "sensitivities": lambda m: acausal.sensitivities(m, parameters=["b"], outputs=["tool.s"], stop_time=0.1),
    "stability": lambda m: acausal.stability(m),
    "reduce": lambda m: acausal.reduce(m, outputs=["tool.s"]),
    "casadi": lambda m: acausal.compile(m).casadi(),
    "outputs": lambda m: acausal.compile(m, outputs=["tool.s"]),
    "freeze": lambda m: acausal.compile(m, freeze=["b"]),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_knows_one_instant_only_is_refused_with_place_and_remedy(what: str) -> None:
    with pytest.raises(UsageError) as caught:
        REFUSED[what](RegenerativeTurning())
    text = str(caught.value)
    assert caught.value.code == "AC035"
    assert "delay(cut.flange.s, cut.turn)" in text or "delay(" in text
    assert "turning.py" in text
    assert caught.value.help


@pytest.mark.slow
def test_a_bench_of_a_model_with_delays() -> None:
    found = acausal.bench(
        RegenerativeTurning(),
        stop_time=0.022,  # into the second turn, which meets what the first has left
        solvers=["rosenbrock"],
        tolerances=[1e-5],
        repeat=1,
        native=False,
    )
    assert all(run.error is not None for run in found.runs)


def test_the_command_line_prints_and_runs_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = CliRunner()
    shown = run.invoke(app, ["equations", "RegenerativeTurning"])
    assert shown.exit_code == 0
    assert "delay(" in shown.stdout
    done = run.invoke(app, ["simulate", "RegenerativeTurning", "--stop-time", "0.05", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["stats"]["solver"] == "rosenbrock"
    wrong = run.invoke(app, ["simulate", "RegenerativeTurning", "--set", "turn=-1"])
    assert wrong.exit_code == 1
    assert "AC182" in wrong.output
    assert "in cut" in wrong.output
