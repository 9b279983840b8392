"""The code on pages of `docs/` runs and produces the stated results."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal
from tests.pages import DOCS, blocks, run


@pytest.fixture(scope="module")
def events() -> dict[str, Any]:
    return run("events.md")


def test_the_thermostat_switches_between_its_limits(events: dict[str, Any]) -> None:
    """After the first switching the room stays between 19 and 21 degrees; it cools for 600*ln(16/14) s."""
    r = events["result"]
    after = r.time >= r.events[0].time
    assert (r["T"][after].min(), r["T"][after].max()) == pytest.approx((19.0, 21.0), abs=1e-6)
    heating = r["heating"]
    at = np.flatnonzero(np.diff(heating)) + 1
    off, on = (next(float(r.time[k]) for k in at[first:]) for first in (0, 1))
    assert on - off == pytest.approx(600.0 * np.log(16.0 / 14.0), rel=1e-5)
    assert r.final("starts") == sum(heating[k] > 0.5 for k in at)


def test_what_the_page_says_of_ball_and_clutches_is_so(events: dict[str, Any]) -> None:
    """Accumulation at sqrt(2*h0/g)*(1 + e)/(1 - e) = 2.5586 s."""
    ball = events["ball"]
    assert ball.final("h") == pytest.approx(0.0, abs=1e-6)
    assert ball.events[-1].time == pytest.approx(np.sqrt(2.0 / 9.81) * 1.7 / 0.3, abs=1e-4)
    assert "2.558" in ball.stats["notes"][0]
    drive = events["drive"]
    assert set(np.unique(drive["clutch1.mode"])) <= {-1.0, 0.0, 1.0, 2.0}
    assert len(events["control"].events) >= 99


def test_the_cart_of_the_page_bounces(events: dict[str, Any]) -> None:
    """The wall takes momentum, P = 2 dv + dv_x; the impulse acts along the rod: dv_x / dv_y = (x - s) / y."""
    r = acausal.simulate(events["Cart"](), stop_time=1.0, tolerance=1e-8)
    k = int(np.flatnonzero(np.diff(r.time) == 0.0)[0])
    assert r["v"][k + 1] == pytest.approx(-0.5 * r["v"][k], abs=1e-9)
    dx, dy = (r[n][k + 1] - r[n][k] for n in "uw")
    assert dx * r["y"][k] == pytest.approx(dy * (r["x"][k] - r["s"][k]), abs=1e-8)
    assert abs(dx) > 0.01


def test_names_of_the_table_exist() -> None:
    table = re.findall(r"^\| `.*", (DOCS / "events.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(table) >= 15
    called = {name for row in table for name in re.findall(r"`[^`]*`", row.split(" | ")[1])}
    functions = {f for text in called for f in re.findall(r"(?<![.\w])([a-z_]+)\(", text)}
    missing = [f for f in functions if not hasattr(acausal, f)]
    assert not missing


@pytest.fixture(scope="module")
def inputs() -> dict[str, Any]:
    return run("inputs.md")


def test_the_cart_follows_its_push(inputs: dict[str, Any]) -> None:
    """m v' + d v = sin(w t), v(0) = 0: (d sin - m w cos + m w exp(-d t / m)) / (d^2 + m^2 w^2)."""
    m, d, w = 2.0, 3.0, 3.0
    for name, within in (("function", 1e-6), ("rows", 5e-5)):
        result = inputs[name]
        t = result.time
        exact = (d * np.sin(w * t) - m * w * np.cos(w * t) + m * w * np.exp(-d * t / m)) / (d**2 + (m * w) ** 2)
        assert np.abs(result["mass.v"] - exact).max() < within
    assert np.abs(inputs["held"]["f"]).max() == pytest.approx(1e-3, rel=1e-3)


def test_the_sine_is_replayed(inputs: dict[str, Any]) -> None:
    whole, replayed = inputs["whole"], inputs["replayed"]
    assert np.abs(replayed["cart.mass.s"] - whole.at(replayed.time, "cart.mass.s")).max() < 1e-6


def test_the_cart_coasts(inputs: dict[str, Any]) -> None:
    """Without a push it slows down with the time constant m / d."""
    assert inputs["moving"].final("mass.v") == pytest.approx(np.exp(-4.0 * 3.0 / 2.0), abs=1e-6)


ALONE = """
import sys
sys.path = [p for p in sys.path if p != {root!r}]
sys.modules["acausal"] = None  # whoever imports it fails
{five}
rate, y = functions["ode"]([0.0, 2.0], 3.0, [entry["start"] for entry in about["p"]])
print([float(v) for v in (*rate.elements(), *y.elements())], [entry["name"] for entry in about["x"]])
"""


@pytest.fixture(scope="module")
def casadi(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder in which all blocks have run, and the resulting namespace."""
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, run("casadi.md")


def test_five_lines_read_the_file_without_acausal(casadi: tuple[Path, dict[str, Any]]) -> None:
    """v' = F/m = 3 at v = 2, F = 3, m = 1; power F v = 6."""
    (five,) = (block for block in blocks("casadi.md") if block.startswith("import casadi, json"))
    assert len([line for line in five.splitlines() if line]) == 5
    code = ALONE.format(five=five, root=str(DOCS.parent))
    run = subprocess.run([sys.executable, "-I", "-c", code], cwd=casadi[0], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == "[2.0, 3.0, 6.0] ['mass.s', 'mass.v']"


def test_casadi_alone_bounces_the_ball(casadi: tuple[Path, dict[str, Any]]) -> None:
    """Free fall: first impact after sqrt(2 h/g), then flights of 2 e^k sqrt(2 g h)/g each, up to 2 s."""
    first = math.sqrt(2 / 9.81)
    times: list[float] = []
    while not times or times[-1] < 2.0:
        k = len(times)
        times.append(first if not k else times[-1] + 2 * 0.8**k * first)
    np.testing.assert_allclose(casadi[1]["impacts"], times[:-1], atol=1e-9)
    assert casadi[1]["x"][2] == len(times) - 1


def test_a_decision_by_name(casadi: tuple[Path, dict[str, Any]]) -> None:
    heavier = casadi[1]["heavier"]
    assert heavier.p.names == ("mass.m",)
    assert float(heavier.ode([0.0, 0.0], 1.0, 4.0)[0][1]) == 0.25


@pytest.mark.slow
def test_the_steel_is_found() -> None:
    """34CrMo4 has k_c1.1 = 2240 N/mm2 and z = 0.21 in the paper; one chip thickness cannot determine both."""
    found = run("fit.md")
    low, high = found["found"].interval.T
    truth = np.array([2.24e9, 0.21])
    assert (low <= truth).all()
    assert (truth <= high).all()
    # A gradient takes from a fifth of a run to less than two.
    assert found["found"].runs + 0.4 * found["found"].gradients <= 25
    assert "combination of drill.k_c11, drill.z" in found["alone"].notes[0]


@pytest.mark.slow
def test_the_report_of_the_page_is_the_one_that_is_printed() -> None:
    """All lines except those with times and solver steps, which depend on the machine."""
    found: dict[str, Any] = {}
    exec(blocks("reduce.md")[0], found)
    page = (DOCS / "reduce.md").read_text(encoding="utf-8")
    match = re.search(r"^\$ acausal reduce [^\n]*\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert match
    measured = ("run up to", "steps")
    shown = [line.rstrip() for line in match[1].splitlines() if not line.strip().startswith(measured)]
    printed = [line.rstrip() for line in str(found["found"]).splitlines() if not line.strip().startswith(measured)]
    assert printed == shown


def test_a_table_of_materials_as_shown_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "drilling-beyond-the-paper.md").read_text(encoding="utf-8")
    rows = re.findall(r"^    (name, .*|C45, .*table.*)$", text, re.MULTILINE)
    Path("steels.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    found: dict[str, Any] = {}
    exec(blocks("drilling-beyond-the-paper.md")[0], found)
    assert found["steels"]["C45"].k_c11 == pytest.approx(2.22e9)
    assert found["drill"].material.name == "C45"


def test_members_of_the_sweep_oscillate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """m s'' + d s' + c s = 0 from s = 0.1 m, at rest, m = 1 kg."""
    pytest.importorskip("xarray")
    monkeypatch.chdir(tmp_path)
    found = run("sweep.md")["found"]
    c, d, t = found["c"][:, None], found["d"][:, None], found.time
    damping = d / 2.0
    w = np.sqrt(c - damping**2)
    exact = 0.1 * np.exp(-damping * t) * (np.cos(w * t) + damping / w * np.sin(w * t))
    assert np.abs(found["mass.s"] - exact).max() < 1e-4
    assert (tmp_path / "oscillators.png").exists()


def test_least_effort_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names = run("optimal-control.md")
    printed = capsys.readouterr().out
    assert "CasadiModel(Slider: 2 x, 0 z, 1 u, 2 p, 1 y)" in printed
    assert "dae:(x[2],z[0],u,p[2])->(ode[2],alg[0],y)" in printed
    assert "[[0. 3.]] [[2.]]" in printed
    solution, opti = names["solution"], names["opti"]
    # Least effort from rest to rest: the closed form of tests/export/test_casadi_file.py.
    assert solution.value(opti.f) == pytest.approx(12.0, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted(path.name for path in (DOCS / "optimal-control").glob("*.md")))
def test_example_page_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "best" in run(f"optimal-control/{page}")
