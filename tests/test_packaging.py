"""The wheel contains only acausal/**, with the linked folders as real files."""

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
    """A copy of the repository, so that a build leaves nothing behind in the original."""
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
    assert {top for top in tops if not top.endswith(".dist-info")} == {"acausal", "acausal_command.py"}
    assert len(tops) == 3


def test_wheel_holds_every_module(source: Path, wheel: list[zipfile.ZipInfo]) -> None:
    """Including those of library/ and models/, which are linked into the package."""
    names = {entry.filename for entry in wheel}
    expected = {path.relative_to(source).as_posix() for path in (source / "acausal").rglob("*.py")}
    for folder in ("library", "models"):
        expected |= {f"acausal/{path.relative_to(source).as_posix()}" for path in (source / folder).rglob("*.py")}
    assert expected <= names, f"not in the wheel: {sorted(expected - names)}"
    assert "acausal/py.typed" in names


def test_wheel_holds_what_pages_embed(source: Path, wheel: list[zipfile.ZipInfo]) -> None:
    """Scripts, styles, symbols and licences are included, since pages are made without a network."""
    names = {entry.filename for entry in wheel}
    files = [p for folder in ("browser", "diagram") for p in (source / "acausal" / folder).iterdir() if p.is_file()]
    expected = {f"acausal/{p.parent.name}/{p.name}" for p in files}
    assert {"acausal/browser/LICENSES.md", "acausal/diagram/symbols.json"} < expected
    assert expected <= names, f"not in the wheel: {sorted(expected - names)}"


def test_wheel_holds_files_not_links(wheel: list[zipfile.ZipInfo]) -> None:
    linked = [e for e in wheel if e.filename.startswith(("acausal/library/", "acausal/models/"))]
    assert linked
    assert not [e.filename for e in linked if (e.external_attr >> 16) & 0o170000 == 0o120000]


def test_links_are_relative_and_committed_as_links() -> None:
    for name in ("library", "models"):
        assert os.readlink(ROOT / "acausal" / name) == f"../{name}"


@pytest.mark.parametrize("name", ["library", "models"])
def test_one_name_per_module(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """`import library` from the root of the repository would create every class twice."""
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(ImportError, match=rf"import acausal\.{name} instead of {name}"):
        importlib.import_module(name)
    assert importlib.import_module(f"acausal.{name}")


@pytest.fixture(scope="module")
def editable(source: Path) -> Path:
    """Interpreter of an environment into which the copy is installed for editing."""
    folder = source.parent / "editable"
    folder.mkdir()
    build = f"from setuptools import build_meta; build_meta.build_editable({str(folder)!r})"
    made = subprocess.run([sys.executable, "-c", build], capture_output=True, text=True, check=False, cwd=source)
    assert made.returncode == 0, made.stderr
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], check=True)
    (packages,) = (folder / "venv").glob("lib/python3*/site-packages")
    (path,) = folder.glob("acausal-*.whl")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(packages)
    return folder / "venv" / "bin" / "python"


def test_an_editable_install_is_a_path(source: Path, editable: Path) -> None:
    """Editors and type checkers read paths in .pth files; they do not run hooks of the import system."""
    (packages,) = editable.parents[1].glob("lib/python3*/site-packages")
    lines = [line for file in packages.glob("*acausal*.pth") for line in file.read_text().splitlines()]
    assert [Path(line).resolve() for line in lines] == [source.resolve()]


USER = """\
from typing import assert_type
from acausal import Expr
from acausal.library.translational import Spring
from acausal.models.oscillator import Oscillator
assert_type(Spring(c=1.0).c, Expr)
assert_type(Oscillator().spring, Spring)
Spring(k=1.0)
"""


@pytest.mark.slow
@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_checkers_find_an_editable_install_from_outside(editable: Path, tmp_path: Path, checker: str) -> None:
    """From an unrelated folder, the types of library and models are known, and the only wrong call is reported."""
    pytest.importorskip(checker)
    (tmp_path / "user.py").write_text(USER)
    option = {"mypy": "--python-executable", "pyright": "--pythonpath"}[checker]
    outside = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "MYPYPATH")}
    command = [sys.executable, "-m", checker, option, str(editable), "user.py"]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=outside)
    lines = {line.split(":")[1] for line in run.stdout.splitlines() if "error:" in line or " - error" in line}
    assert lines == {"7"}, run.stdout + run.stderr


def test_the_package_runs_as_a_program() -> None:
    run = subprocess.run([sys.executable, "-m", "acausal", "--version"], capture_output=True, text=True, check=False)
    assert run.stdout.startswith("acausal ")


def test_what_pages_embed_is_compressed(wheel: list[zipfile.ZipInfo]) -> None:
    """2.4 MB of JavaScript libraries take 0.7 MB in an installed package."""
    sizes = {e.filename: e.file_size for e in wheel if e.filename.startswith("acausal/browser/")}
    assert sum(sizes.values()) < 0.8e6, sizes
