"""docs/reduce.md and the table of materials in docs/drilling-beyond-the-paper.md: what they show comes out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"


def first_python_block(page: str) -> str:
    match = re.search(r"^```python\n(.*?)^```", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert match
    return match[1]


@pytest.mark.slow
def test_the_report_of_the_page_is_the_one_that_is_printed() -> None:
    """All lines but those of times and of the solver's steps, which differ by machine."""
    found: dict[str, Any] = {}
    exec(first_python_block("reduce.md"), found)
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
    exec(first_python_block("drilling-beyond-the-paper.md"), found)
    assert found["steels"]["C45"].k_c11 == pytest.approx(2.22e9)
    assert found["drill"].material.name == "C45"
