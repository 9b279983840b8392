"""Links and names on pages exist; the map of the code in docs/devdocs/README.md lists every folder."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from operator import attrgetter
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
    """A folder of the package has its own row, or is named in the row of its parent."""
    named = {folder for folders, _, _ in rows() for folder in folders}
    inner = {f / name for folders, *text in rows() for f in folders for name in re.findall(r"`(\w+)/`", "".join(text))}
    own = {f for f in FOLDERS if not str(f.relative_to(ROOT)).startswith(("acausal/library", "acausal/models"))}
    assert own - named - inner == {ROOT / "acausal"}


def test_every_page_is_listed() -> None:
    pages = {p.name for p in (ROOT / "docs/devdocs").glob("*.md")} - {"README.md"}
    assert pages <= set(re.findall(r"\]\(([\w-]+\.md)\)", PAGE))


PAGES = [ROOT / "README.md", ROOT / "benchmarks/README.md", *sorted((ROOT / "docs").glob("**/*.md"))]


def unknown(page: Path) -> Iterator[str]:
    """Links, files and dotted names of a page that do not exist."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    spans = re.findall(r"`([^`]+)`", text)
    for link in re.findall(r"\]\((?!https?:|mailto:|#)([^)#\s]+)", re.sub(r"`[^`]+`", "", text)):
        if not (page.parent / link).exists():
            yield link
    for span in spans:
        if (
            re.fullmatch(r"(acausal|library|models|tests|benchmarks|docs)/[\w/.-]+", span)
            and not (ROOT / span).exists()
        ):
            yield span
        elif (name := re.match(r"acausal(\.\w+)+", span)) and not resolves(name[0]):
            yield name[0]


def resolves(name: str) -> bool:
    """Whether a dotted name is a module of the package or something in one."""
    module, _, rest = name.rpartition(".")
    try:
        importlib.import_module(name)
    except ImportError:
        try:
            attrgetter(rest)(importlib.import_module(module))
        except ImportError:  # an attribute of a class
            return bool(module) and resolves(module)
        except AttributeError:
            return False
    return True


def test_pages_name_what_exists() -> None:
    # The cache on disk is in a folder of the user.
    wrong = {f"{page.relative_to(ROOT)}: {name}" for page in PAGES for name in unknown(page)}
    assert wrong <= {"docs/devdocs/native.md: acausal/native"}
