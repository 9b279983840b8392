"""Runs the Python code of pages in `docs/` from top to bottom."""

from __future__ import annotations

import linecache
import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[1] / "docs"


def blocks(page: str, fence: str = "python") -> list[str]:
    """The fenced blocks of a page."""
    text = (DOCS / page).read_text(encoding="utf-8")
    found = re.findall(rf"^```{re.escape(fence)}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert found, f"{page} has no block of {fence}"
    return found


def run(page: str, fence: str = "python") -> dict[str, Any]:
    """The names that are there after all blocks; messages find their lines as in a notebook."""
    names: dict[str, Any] = {"__name__": "page"}
    for k, block in enumerate(blocks(page, fence)):
        name = f"<{page} {k}>"
        linecache.cache[name] = (len(block), None, block.splitlines(keepends=True), name)
        exec(compile(block, name, "exec", dont_inherit=True), names)
    return names
