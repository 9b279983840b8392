"""Tests that count as slow although they are not marked: a list written by a measurement.

A case is on it if it takes 0.15 s of processor time or more, and if a cheaper case of the same test stays in the quick
part; a whole test if it takes 0.7 s or more, and if its file keeps five others. `pytest --durations=0 -vv` on a quiet
machine says what is to be added.
"""

from __future__ import annotations

from pathlib import Path

import pytest

FILE = Path(__file__).with_suffix(".txt")
CASES = frozenset(FILE.read_text(encoding="utf-8").splitlines())
COLLECTED = pytest.StashKey[dict[str, bool]]()
"""For each case of the files passed to pytest, whether it is slow."""


def is_slow(nodeid: str) -> bool:
    """Whether the list contains the case with this identifier."""
    return nodeid.removeprefix("tests/") in CASES
