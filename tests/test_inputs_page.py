"""docs/inputs.md runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).resolve().parents[1] / "docs" / "inputs.md"


@pytest.fixture(scope="module")
def namespace(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What is there after all blocks of the page have run."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    path = tmp_path_factory.mktemp("page") / "page.py"
    path.write_text("\n".join(blocks), encoding="utf-8")
    found: dict[str, Any] = {"__name__": "page"}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), found)
    return found


def test_the_cart_follows_its_push(namespace: dict[str, Any]) -> None:
    """m v' + d v = sin(w t), v(0) = 0: (d sin - m w cos + m w exp(-d t / m)) / (d^2 + m^2 w^2)."""
    m, d, w = 2.0, 3.0, 3.0
    for name, within in (("function", 1e-6), ("rows", 5e-5)):
        result = namespace[name]
        t = result.time
        exact = (d * np.sin(w * t) - m * w * np.cos(w * t) + m * w * np.exp(-d * t / m)) / (d**2 + (m * w) ** 2)
        assert np.abs(result["mass.v"] - exact).max() < within
    assert np.abs(namespace["held"]["f"]).max() == pytest.approx(1e-3, rel=1e-3)


def test_the_sine_is_replayed(namespace: dict[str, Any]) -> None:
    whole, replayed = namespace["whole"], namespace["replayed"]
    assert np.abs(replayed["cart.mass.s"] - whole.at(replayed.time, "cart.mass.s")).max() < 1e-6


def test_the_cart_coasts(namespace: dict[str, Any]) -> None:
    """Without a push it slows down with the time constant m / d."""
    assert namespace["moving"].final("mass.v") == pytest.approx(np.exp(-4.0 * 3.0 / 2.0), abs=1e-6)
