"""The list of slow cases contains only existing cases, and leaves a quick one of each test."""

from __future__ import annotations

import re

import pytest

from tests.slow_cases import CASES, COLLECTED, FILE


def test_every_row_names_a_test() -> None:
    names = {tuple(row.split("[", 1)[0].split("::")) for row in CASES}
    text = {file: (FILE.parent / file).read_text(encoding="utf-8") for file, _ in names}
    assert not [f"{file}::{name}" for file, name in sorted(names) if not re.search(rf"^def {name}\(", text[file], re.M)]


def test_every_row_names_a_case_beside_a_quick_one(request: pytest.FixtureRequest) -> None:
    """The cases in the files of this session: all of them in a run of the whole suite."""
    slow = {case.removeprefix("tests/"): is_slow for case, is_slow in request.config.stash[COLLECTED].items()}
    files = {case.split("::")[0] for case in slow}
    rows = {row for row in CASES if row.split("::")[0] in files}
    assert not sorted(rows - slow.keys())
    quick = {case.split("[")[0] for case, is_slow in slow.items() if not is_slow}
    assert not sorted({row.split("[")[0] for row in rows if "[" in row} - quick)
