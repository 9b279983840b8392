"""The pages of the examples run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "optimal-control"


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted(path.name for path in FOLDER.glob("*.md")))
def test_example_page_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    for block in re.findall(r"^```python\n(.*?)^```$", (FOLDER / page).read_text(encoding="utf-8"), re.M | re.S):
        exec(compile(block, page, "exec"), names)
    assert "best" in names
