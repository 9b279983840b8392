"""The list of slow cases names tests that are there."""

from __future__ import annotations

import re

from tests.slow_cases import CASES, FILE


def test_every_row_names_a_test() -> None:
    names = {tuple(row.split("[", 1)[0].split("::")) for row in CASES}
    text = {file: (FILE.parent / file).read_text(encoding="utf-8") for file, _ in names}
    assert not [f"{file}::{name}" for file, name in sorted(names) if not re.search(rf"^def {name}\(", text[file], re.M)]
