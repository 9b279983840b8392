"""docs/optimal-control.md runs and says what comes out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "optimal-control.md"


def test_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text(encoding="utf-8")
    names: dict[str, object] = {"__name__": "page"}
    for block in re.finditer(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        lines = "\n" * text.count("\n", 0, block.start(1))
        exec(compile(lines + block[1], str(PAGE), "exec"), names)
    printed = capsys.readouterr().out
    assert "CasadiModel(Slider: 2 x, 0 z, 1 u, 2 p, 1 y)" in printed
    assert "dae:(x[2],z[0],u,p[2])->(ode[2],alg[0],y)" in printed
    assert "[[0. 3.]] [[2.]]" in printed
    solution, opti = names["solution"], names["opti"]
    # Least effort from rest to rest: the closed form of test_optimal_control.py.
    assert solution.value(opti.f) == pytest.approx(12.0, rel=1e-8)  # type: ignore[attr-defined]
