"""Compiled code is run only where nobody but this user can have written it, and a compiler always ends."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from acausal.simulate.native import cache

pytestmark = pytest.mark.skipif(
    cache.compiler() is None or not hasattr(os, "geteuid"), reason="needs a C compiler and a POSIX system"
)
SOURCE = "int answer(void) { return 42; }\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path))
    monkeypatch.setattr(cache, "_HUNG", set())
    return tmp_path / "native"


def kept(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.name != "secret")


def test_what_is_built_is_found_and_private(folder: Path) -> None:
    made = cache.build("one", SOURCE)
    assert made is not None
    assert made == cache.find("one")
    assert made.parent == folder
    assert {p.stat().st_mode & 0o777 for p in folder.iterdir()} == {0o600}
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_planted_library_is_not_opened(folder: Path) -> None:
    """With the digest of its own bytes in its name, as anybody can compute it, and from a cache that came as a copy."""
    made = cache.build("one", SOURCE)
    assert made is not None
    content = made.read_bytes()
    planted = folder / f"two-{hashlib.sha256(content).hexdigest()[:32]}{made.suffix}"
    planted.write_bytes(content)
    assert cache.find("two") is None
    assert not planted.exists()
    (folder / "secret").unlink()
    assert cache.find("one") is None


@pytest.mark.parametrize("change", ["others may write", "a link", "other bytes"])
def test_a_changed_library_is_not_opened(folder: Path, tmp_path: Path, change: str) -> None:
    made = cache.build("one", SOURCE)
    assert made is not None
    if change == "others may write":
        made.chmod(0o622)
    elif change == "a link":
        shutil.move(made, tmp_path / "elsewhere")
        made.symlink_to(tmp_path / "elsewhere")
    else:
        made.write_bytes(made.read_bytes() + b"\0")
    assert cache.find("one") is None


@pytest.mark.parametrize("mode", [0o777, 0o770])
def test_a_folder_of_others_is_not_used(folder: Path, mode: int, caplog: pytest.LogCaptureFixture) -> None:
    """A private temporary one is, with a note."""
    folder.mkdir()
    folder.chmod(mode)
    made = cache.build("one", SOURCE)
    assert made is not None
    assert made.parent != folder
    assert made.parent.stat().st_mode & 0o777 == 0o700
    assert cache.find("one") == made
    assert not kept(folder)
    assert "others may write" in caplog.text


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_another_user_is_not_used(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder.mkdir(mode=0o700)
    os.chown(folder, 12345, 12345)
    made = cache.build("one", SOURCE)
    assert made is not None
    assert made.parent != folder
    assert "belongs to another user" in caplog.text


def test_a_compiler_that_hangs_is_ended_with_all_it_has_started(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Its folder is removed, and it is not asked a second time."""
    pid = tmp_path / "pid"
    hanging = tmp_path / "hanging"
    hanging.write_text(f"#!/bin/sh\nsleep 600 &\necho $! > {pid}\nwait\n")
    hanging.chmod(0o700)
    monkeypatch.setenv("CC", str(hanging))
    monkeypatch.setenv("ACAUSAL_COMPILER_TIMEOUT", "1")
    began = time.monotonic()
    assert cache.build("one", SOURCE) is None
    assert cache.build("two", SOURCE) is None
    assert time.monotonic() - began < 5.0
    assert "not done after 1 s" in caplog.text
    assert not kept(folder)
    time.sleep(0.1)
    state = subprocess.run(["ps", "-o", "stat=", "-p", pid.read_text().strip()], capture_output=True, text=True)
    assert state.stdout.strip()[:1] in ("", "Z")  # what follows is its priority
