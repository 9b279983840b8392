"""docs/sweep.md runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).resolve().parents[1] / "docs" / "sweep.md"


def test_the_blocks_run_and_members_oscillate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """m s'' + d s' + c s = 0 from s = 0.1 m, at rest, m = 1 kg."""
    pytest.importorskip("xarray")
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    path = tmp_path / "page.py"
    path.write_text("\n".join(blocks), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, Any] = {"__name__": "page"}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), namespace)
    found = namespace["found"]
    c, d, t = found["c"][:, None], found["d"][:, None], found.time
    damping = d / 2.0
    w = np.sqrt(c - damping**2)
    exact = 0.1 * np.exp(-damping * t) * (np.cos(w * t) + damping / w * np.sin(w * t))
    assert np.abs(found["mass.s"] - exact).max() < 1e-4
    assert (tmp_path / "oscillators.png").exists()
