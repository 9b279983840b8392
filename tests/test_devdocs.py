"""The map of the code in docs/devdocs/README.md: all that it names is there, and it names every folder."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs/devdocs/README.md").read_text(encoding="utf-8")
FOLDERS = {p.parent for p in (ROOT / "acausal").rglob("*.py")}


def rows() -> list[tuple[tuple[Path, ...], str, str]]:
    """Folders, meaning and files of each row of the two tables of folders."""
    found = []
    for line in PAGE.split("## Extension points")[0].splitlines():
        cells = [c.strip() for c in line.strip("|").split(" | ")]
        if line.startswith("| `"):
            names = re.findall(r"`([\w/]+/)`", cells[0])
            whole = ("acausal", "library", "models")
            bases = tuple((ROOT if n.startswith(whole) else ROOT / "acausal/simulate") / n for n in names)
            found.append((bases, cells[1], cells[2]))
    return found


def test_all_that_is_named_is_there() -> None:
    missing = []
    for folders, _, files in rows():
        for name in re.findall(r"`([\w/]+(?:\.py|/))`", files):
            if not any((base / name).exists() for base in (*folders, ROOT)):
                missing.append(f"{folders[0].relative_to(ROOT)}: {name}")
    for name in re.findall(r"`((?:acausal|library|models|tests)/[\w/.]*)`", PAGE):
        if not (ROOT / name).exists():
            missing.append(name)
    assert not missing


def test_every_folder_is_named() -> None:
    """A folder of the package stands in a row of its own, or in the meaning of the row of its owner."""
    named = {folder for folders, _, _ in rows() for folder in folders}
    inner = {f / name for folders, *text in rows() for f in folders for name in re.findall(r"`(\w+)/`", "".join(text))}
    own = {f for f in FOLDERS if not str(f.relative_to(ROOT)).startswith(("acausal/library", "acausal/models"))}
    assert own - named - inner == {ROOT / "acausal"}


def test_every_page_is_listed() -> None:
    pages = {p.name for p in (ROOT / "docs/devdocs").glob("*.md")} - {"README.md"}
    assert pages <= set(re.findall(r"\]\(([\w-]+\.md)\)", PAGE))
