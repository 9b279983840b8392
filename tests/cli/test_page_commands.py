"""The commands that pages show are run as they stand, with the page's classes in their files."""

from __future__ import annotations

import ast
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.running import run
from tests.pages import DOCS, blocks
from tests.pages import run as executed

# The pages' own models; the others are run in their sizes by tests of their verbs.
PAGES = ("tutorial/1-first-model", "how-to/family-of-curves", "how-to/measured-data", "finding", "explorer", "diagrams")


def commands(text: str) -> Iterator[str]:
    """Lines that begin with acausal, in blocks that are not executed by Python."""
    for block in re.findall(r"^```(?:text|console)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for line in block.splitlines():
            if line.startswith(("acausal ", "$ acausal ")):
                yield line.removeprefix("$ ")


def module(page: str) -> str:
    """Imports and classes of a page, as a reader puts them into a file."""
    kept = [
        ast.get_source_segment(cell, node) or ""
        for cell in blocks(page, "{code-cell}")
        for node in ast.parse(cell).body
        if isinstance(node, ast.Import | ast.ImportFrom | ast.ClassDef)
    ]
    return "\n\n".join(kept) + "\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_commands_of_pages_run(name: str) -> None:
    page = f"{name}.md"
    text = (DOCS / page).read_text(encoding="utf-8")
    lines = list(commands(text))
    assert lines
    written = set(re.findall(r"^acausal new (\S+)", "\n".join(lines), re.MULTILINE))
    for file in set(re.findall(r"\b\w+\.py\b", "\n".join(lines))) - written:
        Path(file).write_text(module(page), encoding="utf-8")
    if "push.csv" in text:
        shutil.copy(executed(page, "{code-cell}")["folder"] / "push.csv", "push.csv")
    for line in lines:
        outcome = run(*shlex.split(line)[1:])
        # The comparison on the page is of a model before it is fitted: out of tolerance.
        assert outcome.code == (3 if line.startswith("acausal compare") else 0), f"{line}\n{outcome.err}"
