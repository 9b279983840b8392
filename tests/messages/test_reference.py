"""Every code stands in the reference of errors with an example or a sentence; `docs/generate.py` only warns."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def codes(pattern: str, *places: str) -> Iterator[str]:
    for place in places:
        for path in ROOT.glob(place):
            yield from re.findall(pattern, path.read_text(encoding="utf-8"), flags=re.MULTILINE)


def test_every_code_of_the_sources_has_an_example() -> None:
    """Errors have their code as a text of its own, notes begin with it."""
    stated = set(codes(r'"(AC\d{3})(?:"|: )', "acausal/**/*.py", "library/**/*.py"))
    shown = set(codes(r"^(AC\d{3})$", "docs/error-examples.txt")) | set(
        codes(r'(?:"|^|^\w[\w().]* )(AC\d{3})["\s]', "tests/messages/*.py")
    )
    assert {"AC101", "AC178", "AC191", "AC414"} <= stated
    assert sorted(stated - shown) == []
