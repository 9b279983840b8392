"""README.md is correct: its Python code and its commands run in order, and the simulated models move.

Blocks are taken in the order of the page, in one empty folder and one namespace:

- ```python blocks are executed; one whose first line is `# name.py` is also saved there under that name;
- every `$ acausal ...` line of a ```console block is run;
- a Result in the namespace, or a result file a command has written, in which nothing moves fails the test.
"""

from __future__ import annotations

import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.cli.running import Outcome, run

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
# The quick test runs the Python code of the page and these commands; each verb has its own tests in tests/cli.
QUICK = frozenset({"simulate", "plot", "new"})
RESULT_FILES = {".csv", ".mat", ".npz"}
_FENCE = re.compile(
    r"^(?P<fence>`{3,}) *(?P<language>\w*)[^\n]*\n(?P<body>.*?)^(?P=fence) *$", re.MULTILINE | re.DOTALL
)
_LINK = re.compile(r"\]\((?!https?:|#|mailto:)(?P<path>[^)#\s]+)")


class Block(NamedTuple):
    language: str
    body: str
    line: int


def blocks(text: str) -> list[Block]:
    """The fenced blocks of a page and the lines at which their bodies start."""
    found = _FENCE.finditer(text)
    return [Block(m["language"], m["body"], text.count("\n", 0, m.start("body")) + 1) for m in found]


def commands(block: Block) -> Iterator[tuple[int, list[str]]]:
    """The arguments of every `$ acausal ...` line with its line number; a backslash continues a line."""
    lines = block.body.split("\n")
    for i, line in enumerate(lines):
        joined = line
        while joined.endswith("\\"):
            i += 1
            joined = joined[:-1] + lines[i]
        if match := re.match(r"\$ (?:\.venv/bin/)?acausal\b(.*)", joined):
            yield block.line + i, shlex.split(match[1], comments=True)


@pytest.fixture(scope="module")
def page() -> str:
    assert README.is_file(), "there is no README.md"
    return README.read_text(encoding="utf-8")


def run_python(block: Block, namespace: dict[str, Any], folder: Path) -> None:
    named = re.match(r"# *([\w-]+\.py)\s*\n", block.body)
    # A real file, so that messages and source spans find the lines.
    file = folder / (named[1] if named else f"readme_line_{block.line}.py")
    file.write_text(block.body, encoding="utf-8")
    if named:  # a file is run like `python oscillator.py`, including the code below its guard
        namespace |= {k: v for k, v in runpy.run_path(str(file), run_name="__main__").items() if not k.startswith("__")}
        return
    exec(compile(block.body, str(file), "exec", dont_inherit=True), namespace)


def assert_done(line: int, arguments: list[str], found: Outcome) -> None:
    shown = f"README.md:{line}: acausal {shlex.join(arguments)}"
    assert found.code == 0, f"{shown}\nexit {found.code}\n{found.out}\n{found.err}"
    assert "Traceback" not in found.err, f"{shown}\n{found.err}"


def assert_moves(result: Any, origin: str) -> None:
    matrix = np.asarray(result.matrix)
    assert matrix.size, f"{origin}: the result is empty"
    assert np.all(np.isfinite(result.time)), f"{origin}: the times are not finite"
    assert np.ptp(matrix, axis=0).max() > 0.0, f"{origin}: nothing moves in this result"


# For a reader plt.show() opens a window, which is not possible here.
@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")
@pytest.mark.parametrize("verbs", [QUICK, pytest.param(None, marks=pytest.mark.slow)], ids=["quick", "all"])
def test_readme_runs_and_moves(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verbs: frozenset[str] | None
) -> None:
    from acausal.result.result import Result, load

    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    module = ModuleType("readme")
    monkeypatch.setitem(sys.modules, "readme", module)
    namespace = vars(module)
    checked: set[int] = set()
    moved = 0
    for block in blocks(page):
        before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
        if block.language == "python":
            run_python(block, namespace, tmp_path)
        elif block.language == "console":
            for line, arguments in commands(block):
                if verbs is None or arguments[0] in verbs:  # in this process, which saves the imports of a new one
                    assert_done(line, arguments, run(*arguments))
        for name, value in namespace.items():
            if isinstance(value, Result) and id(value) not in checked:
                checked.add(id(value))
                assert_moves(value, f"README.md:{block.line}: {name}")
                moved += 1
        for path in tmp_path.rglob("*"):
            is_table = path.suffix == ".csv" and path.read_text(encoding="utf-8").startswith("member")
            if path.suffix in RESULT_FILES and not is_table and before.get(path) != path.stat().st_mtime_ns:
                assert_moves(load(path), f"README.md:{block.line}: {path.name}")
                moved += 1
            assert path.is_dir() or path.stat().st_size > 0, f"README.md:{block.line}: {path.name} is empty"
    assert moved, "README.md simulates nothing"


def test_readme_shows_python_and_shell(page: str) -> None:
    found = blocks(page)
    assert [b for b in found if b.language == "python"], "README.md has no python block"
    assert [c for b in found if b.language == "console" for c in commands(b)], "README.md has no `$ acausal` line"


@pytest.mark.parametrize(("name", "word"), [("run", "acausal"), ("test", "pytest")])
def test_readme_has_the_two_complete_commands(page: str, name: str, word: str) -> None:
    """`.ci/run` executes the blocks behind these two comments, so that the page and the checks cannot differ."""
    match = re.search(rf"^<!-- ci: {name} -->\s*\n+```\w*\n(?P<body>.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert match, f"README.md has no block behind <!-- ci: {name} -->"
    assert word in match["body"]


def test_local_links_lead_somewhere(page: str) -> None:
    missing = [m["path"] for m in _LINK.finditer(page) if not (ROOT / m["path"]).exists()]
    assert not missing
