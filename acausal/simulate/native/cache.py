"""Libraries on disk, found by what they were made from.

A library's file name is `<key>-<digest>`: the key is a hash of everything it was made from, the digest one of its own
bytes. One file is therefore complete and right, or not there at all: it is renamed into place when it is ready, and
two processes that build the same one at the same time do not disturb each other.

What is found is run. So the digest is keyed with a secret of the folder, and folder and files have to be this user's
and nobody else's to write; where they are not, a private temporary folder takes their place (`docs/security.md`).
"""

from __future__ import annotations

import atexit
import hashlib
import hmac
import logging
import os
import platform
import secrets
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

import casadi as ca

_log = logging.getLogger(__name__)

FLAGS = ("-O3", "-fPIC", "-shared", "-ffp-contract=off")
"""-O3 makes the linear algebra of an integrator 10 % faster than -O2. Without contraction a compiled run gives the
interpreter's numbers on machines with fused multiply-add as well."""

# Goes into every key: raised when the sources that `source.py` writes change their meaning.
_FORMAT = "6"
_SECRET = 32
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


def home() -> Path:
    """The folder to use: `folder()`, or a temporary one where others could have put something into that."""
    wanted = folder()
    try:
        wanted.mkdir(mode=0o700, parents=True, exist_ok=True)
        why = _distrusted(wanted)
    except OSError as error:
        why = error.strerror or str(error)
    return wanted if not why else _private(str(wanted), why)


@cache
def _private(instead: str, why: str) -> Path:
    """A folder of this process alone; made once, with a note, and removed at its end."""
    made = Path(tempfile.mkdtemp(prefix="acausal-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    _log.warning("compiled code is not kept: %s, %s", instead, why)
    return made


def _distrusted(path: Path) -> str:
    """Why code from a folder must not be run; empty when nobody but this user can have written to it."""
    if not hasattr(os, "geteuid"):
        return ""  # Windows: the user's own folder has an access list of its own
    found = path.lstat()
    if not stat.S_ISDIR(found.st_mode):
        return "which is no folder"
    if found.st_uid != os.geteuid():
        return "which belongs to another user"
    if found.st_mode & 0o022:
        return "to which others may write: chmod 700 it, or delete it"
    for above in path.absolute().parents:
        mode = above.stat().st_mode
        if mode & 0o002 and not mode & stat.S_ISVTX:
            return f"in {above}, where anybody may put another folder in its place"
    return ""


def _is_ours(path: Path) -> bool:
    """Whether a file is a plain one of this user's, which nobody else may write."""
    found = path.lstat()
    mine = not hasattr(os, "geteuid") or (found.st_uid == os.geteuid() and not found.st_mode & 0o022)
    return stat.S_ISREG(found.st_mode) and mine


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
    """The library of this key; files that are not as this program has written them are removed."""
    if is_empty():
        return None
    kept = home()
    for path in kept.glob(f"{wanted}-*{_SUFFIX}"):
        with suppress(OSError):
            if _is_ours(path) and hmac.compare_digest(_digest(path, kept), path.stem.rpartition("-")[2]):
                return path
        discard(path)
    return None


def build(wanted: str, source: str) -> Path | None:
    """Compile `source` and keep it; None, with a log entry, when there is no compiler or it fails."""
    command = compiler()
    if command is None:
        _log.info("no C compiler found: functions are interpreted")
        return None
    if command in _HUNG:
        return None
    try:
        return _build(command, wanted, source)
    except OSError as error:
        _log.info("the library could not be kept in %s: %s", folder(), error)
    return None


_HUNG: set[str] = set()
"""Compilers that did not come to an end; they are not asked again."""


def _build(command: str, wanted: str, source: str) -> Path | None:
    kept = home()
    with tempfile.TemporaryDirectory(prefix="build-", dir=kept) as scratch:
        written, made = Path(scratch) / "model.c", Path(scratch) / f"model{_SUFFIX}"
        written.write_text(source, encoding="utf-8")
        failure = _compile([command, *FLAGS, "-o", str(made), str(written), "-lm"], _patience(source))
        if failure is not None:
            _log.warning("%s failed, functions are interpreted: %s", command, failure)
            return None
        made.chmod(0o600)
        found = kept / f"{wanted}-{_digest(made, kept)}{_SUFFIX}"
        os.replace(made, found)
    return found


def _patience(source: str) -> float:
    """Seconds that a compiler is given: ten times what gcc takes at most, or `$ACAUSAL_COMPILER_TIMEOUT`."""
    return float(os.environ.get("ACAUSAL_COMPILER_TIMEOUT") or 120.0 + 3e-4 * len(source))


def _compile(command: list[str], patience: float) -> str | None:
    """Run a compiler; what it says when it fails. It and all it has started end with this call."""
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        # A group of its own: compilers start programs, which outlive them.
        start_new_session=True,
    )
    try:
        _, said = process.communicate(timeout=patience)
    except subprocess.TimeoutExpired:
        _HUNG.add(command[0])
        return f"not done after {patience:g} s"
    finally:
        if process.returncode is None:
            _end(process)
    return (said.strip()[:500] or f"status {process.returncode}") if process.returncode else None


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and its group."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.communicate()


def discard(path: Path) -> None:
    """Remove a library that cannot be used."""
    with suppress(OSError):
        path.unlink()


def _digest(path: Path, kept: Path) -> str:
    return hmac.new(_secret(kept), path.read_bytes(), hashlib.sha256).hexdigest()[:32]


def _secret(kept: Path) -> bytes:
    """The key of the digests in a folder, made when it is first needed; another process may be faster."""
    path = kept / "secret"
    with suppress(OSError):
        if _is_ours(path) and len(found := path.read_bytes()) == _SECRET:
            return found
        discard(path)  # somebody else's, or cut short: what it has signed is made again
    with tempfile.NamedTemporaryFile(dir=kept, prefix="secret-", delete=False) as file:  # mode 600
        file.write(secrets.token_bytes(_SECRET))
    try:
        os.link(file.name, path)
    except FileExistsError:
        pass
    finally:
        os.unlink(file.name)
    return path.read_bytes()
