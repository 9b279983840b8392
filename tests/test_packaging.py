"""The wheel holds acausal/** and nothing else, and the linked folders are real files in it."""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy, so that a build leaves no folder in the repository."""
    copy = tmp_path_factory.mktemp("packaging") / "source"
    skipped = shutil.ignore_patterns(".git", ".venv", "*.egg-info", "build", "dist", "__pycache__", ".*_cache")
    shutil.copytree(ROOT, copy, symlinks=True, ignore=skipped)
    return copy


@pytest.fixture(scope="module")
def wheel(source: Path) -> list[zipfile.ZipInfo]:
    """Entries of the wheel."""
    folder = source.parent
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-q", "-w"]
    command += [str(folder), str(source)]
    build = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"PIP_NO_INDEX": "1"})
    assert build.returncode == 0, build.stderr
    (path,) = folder.glob("acausal-*.whl")
    with zipfile.ZipFile(path) as archive:
        return archive.infolist()


def test_wheel_holds_only_the_package(wheel: list[zipfile.ZipInfo]) -> None:
    tops = {entry.filename.split("/")[0] for entry in wheel}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"acausal"}
    assert len(tops) == 2


def test_wheel_holds_every_module(source: Path, wheel: list[zipfile.ZipInfo]) -> None:
    """Also those of library/ and models/, which reach the package through links."""
    names = {entry.filename for entry in wheel}
    expected = {path.relative_to(source).as_posix() for path in (source / "acausal").rglob("*.py")}
    for folder in ("library", "models"):
        expected |= {f"acausal/{path.relative_to(source).as_posix()}" for path in (source / folder).rglob("*.py")}
    assert expected <= names, f"not in the wheel: {sorted(expected - names)}"
    assert "acausal/py.typed" in names


def test_wheel_holds_files_not_links(wheel: list[zipfile.ZipInfo]) -> None:
    linked = [e for e in wheel if e.filename.startswith(("acausal/library/", "acausal/models/"))]
    assert linked
    assert not [e.filename for e in linked if (e.external_attr >> 16) & 0o170000 == 0o120000]


def test_links_are_relative_and_committed_as_links() -> None:
    for name in ("library", "models"):
        assert os.readlink(ROOT / "acausal" / name) == f"../{name}"


@pytest.mark.parametrize("name", ["library", "models"])
def test_one_name_per_module(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """`import library` from the repository's root would make a second class of everything."""
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(ImportError, match=rf"import acausal\.{name} instead of {name}"):
        importlib.import_module(name)
    assert importlib.import_module(f"acausal.{name}")
