"""docs/events.md runs, and its table names what exists."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal

PAGE = Path(__file__).resolve().parents[1] / "docs" / "events.md"


@pytest.fixture(scope="module")
def namespace(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What is there after all blocks of the page have run, saved as a file so that messages can show their lines."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert len(blocks) >= 4
    path = tmp_path_factory.mktemp("page") / "page.py"
    path.write_text("\n".join(blocks), encoding="utf-8")
    found: dict[str, Any] = {"__name__": "page"}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), found)
    return found


def test_the_thermostat_switches_between_its_limits(namespace: dict[str, Any]) -> None:
    """From its first switch on the room stays between 19 and 21 degrees; times of cooling: 600*ln(16/14) s."""
    r = namespace["result"]
    after = r.time >= r.events[0].time
    assert (r["T"][after].min(), r["T"][after].max()) == pytest.approx((19.0, 21.0), abs=1e-6)
    heating = r["heating"]
    at = np.flatnonzero(np.diff(heating)) + 1
    off, on = (next(float(r.time[k]) for k in at[first:]) for first in (0, 1))
    assert on - off == pytest.approx(600.0 * np.log(16.0 / 14.0), rel=1e-5)
    assert r.final("starts") == sum(heating[k] > 0.5 for k in at)


def test_what_the_page_says_of_ball_and_clutches_is_so(namespace: dict[str, Any]) -> None:
    """Accumulation at sqrt(2*h0/g)*(1 + e)/(1 - e) = 2.5586 s."""
    ball = namespace["ball"]
    assert ball.final("h") == pytest.approx(0.0, abs=1e-6)
    assert ball.events[-1].time == pytest.approx(np.sqrt(2.0 / 9.81) * 1.7 / 0.3, abs=1e-4)
    assert "2.558" in ball.stats["notes"][0]
    drive = namespace["drive"]
    assert set(np.unique(drive["clutch1.mode"])) <= {-1.0, 0.0, 1.0, 2.0}
    assert len(namespace["control"].events) >= 99


def test_the_cart_of_the_page_bounces(namespace: dict[str, Any]) -> None:
    """The wall takes momentum, P = 2 dv + dv_x; the rod's impulse lies along the rod: dv_x / dv_y = (x - s) / y."""
    r = acausal.simulate(namespace["Cart"](), stop_time=1.0, tolerance=1e-8)
    k = int(np.flatnonzero(np.diff(r.time) == 0.0)[0])
    assert r["v"][k + 1] == pytest.approx(-0.5 * r["v"][k], abs=1e-9)
    dx, dy = (r[n][k + 1] - r[n][k] for n in "uw")
    assert dx * r["y"][k] == pytest.approx(dy * (r["x"][k] - r["s"][k]), abs=1e-8)
    assert abs(dx) > 0.01


def test_names_of_the_table_exist() -> None:
    table = re.findall(r"^\| `.*", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(table) >= 15
    called = {name for row in table for name in re.findall(r"`[^`]*`", row.split(" | ")[1])}
    functions = {f for text in called for f in re.findall(r"(?<![.\w])([a-z_]+)\(", text)}
    missing = [f for f in functions if not hasattr(acausal, f)]
    assert not missing
