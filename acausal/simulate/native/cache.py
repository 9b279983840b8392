"""Libraries on disk, found by what they were made from.

A library's file name is `<key>-<digest>`: the key is a hash of everything it was made from, the digest one of its own
bytes. One file is therefore complete and right, or not there at all: it is renamed into place when it is ready, and
two processes that build the same one at the same time do not disturb each other.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import casadi as ca

_log = logging.getLogger(__name__)

FLAGS = ("-O3", "-fPIC", "-shared", "-ffp-contract=off")
"""-O3 makes the linear algebra of an integrator 10 % faster than -O2. Without contraction a compiled run gives the
interpreter's numbers on machines with fused multiply-add as well."""

# Goes into every key: raised when the sources that `source.py` writes change their meaning.
_FORMAT = "6"
_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def folder() -> Path:
    """Where libraries are kept: `$ACAUSAL_CACHE`, else the user's cache folder of this platform."""
    chosen = os.environ.get("ACAUSAL_CACHE")
    if chosen:
        return Path(chosen) / "native"
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "acausal" / "native"


def is_empty() -> bool:
    """Whether nothing was ever kept, so that no key has to be computed."""
    return not folder().is_dir()


def compiler() -> str | None:
    """Path of a C compiler: `$CC`, cc, gcc or clang; None without one."""
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        found = shutil.which(name) if name else None
        if found:
            return found
    return None


def key(kind: str, *made_from: str) -> str:
    """Hash of a kind of library and all it is made from; a compiler is not part of it, so that a hit needs none."""
    words = (_FORMAT, kind, ca.CasadiMeta.version(), sys.platform, platform.machine(), *FLAGS, *made_from)
    return hashlib.sha256("\0".join(words).encode()).hexdigest()


def find(wanted: str) -> Path | None:
    """The library of this key; files whose bytes are not those that were written are removed."""
    for path in folder().glob(f"{wanted}-*{_SUFFIX}"):
        with suppress(OSError):
            if _digest(path) == path.stem.rpartition("-")[2]:
                return path
        discard(path)
    return None


def build(wanted: str, source: str) -> Path | None:
    """Compile `source` and keep it; None, with a log entry, when there is no compiler or it fails."""
    command = compiler()
    if command is None:
        _log.info("no C compiler found: functions are interpreted")
        return None
    try:
        return _build(command, wanted, source)
    except OSError as error:
        _log.info("the library could not be kept in %s: %s", folder(), error)
    return None


def _build(command: str, wanted: str, source: str) -> Path | None:
    home = folder()
    # Code is loaded from here: nobody else may write to it.
    home.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="build-", dir=home) as scratch:
        written, made = Path(scratch) / "model.c", Path(scratch) / f"model{_SUFFIX}"
        written.write_text(source, encoding="utf-8")
        run = subprocess.run(
            [command, *FLAGS, "-o", str(made), str(written), "-lm"], capture_output=True, text=True, check=False
        )
        if run.returncode:
            _log.warning("%s failed, functions are interpreted: %s", command, run.stderr.strip()[:500])
            return None
        kept = home / f"{wanted}-{_digest(made)}{_SUFFIX}"
        os.replace(made, kept)
    return kept


def discard(path: Path) -> None:
    """Remove a library that cannot be used."""
    with suppress(OSError):
        path.unlink()


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
