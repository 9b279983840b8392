"""Types are behaviour: wrong calls of constructors are found by mypy and pyright, right ones are not complained about.

One process per checker for all cases of `wrong_calls.txt`, which is no `.py` because lint and types would find fault
with it.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow  # the checkers are tools of developers: not there where only the tests are installed

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(__file__).with_name("wrong_calls.txt")


def expected(mark: str) -> dict[int, str]:
    """Lines with a mark, and mypy's code of the error on them."""
    lines = CASES.read_text().splitlines()
    return {k: m[1] for k, line in enumerate(lines, 1) if (m := re.search(rf"# {mark}$", line))}


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """The cases as a Python file."""
    file = tmp_path / "wrong_calls.py"
    file.write_text(CASES.read_text())
    return file


def test_mypy(program: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", str(program)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    found = {
        int(m[1]): m[2]
        for line in run.stdout.splitlines()
        if (m := re.search(r"wrong_calls\.py:(\d+):(?:\d+:)? error: .*\[([\w-]+)\]$", line))
    }
    assert found == expected(r"E: ([\w-]+)"), run.stdout + run.stderr


def test_pyright(program: Path) -> None:
    pytest.importorskip("pyright")
    run = subprocess.run(
        [sys.executable, "-m", "pyright", "--outputjson", str(program)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    if not run.stdout.startswith("{"):
        pytest.skip(f"pyright does not start: {run.stderr[:200]}")
    diagnostics = json.loads(run.stdout)["generalDiagnostics"]
    found = {d["range"]["start"]["line"] + 1 for d in diagnostics if d["severity"] == "error"}
    assert found == {*expected(r"E: ([\w-]+)"), *expected("(P)")}, run.stdout
