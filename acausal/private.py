"""Files that this program writes for itself and trusts later: compiled code, compiled models.

Such files are executed or unpickled. Therefore the name of a file ends in a digest of its content, keyed with a secret
of its folder, and the folder and its files must belong to this user and be writable by nobody else; otherwise a private
temporary folder is used instead (`docs/security.md`). A file is either complete or absent: it is moved to its final
name when it is complete, so that two processes may write the same file at the same time.
"""

from __future__ import annotations

import atexit
import hashlib
import hmac
import logging
import os
import secrets
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

_log = logging.getLogger(__name__)
_SECRET_LENGTH = 32


def folder(kind: str) -> Path:
    """Folder for files of a kind: in `$ACAUSAL_CACHE`, else in the user's cache folder of this platform."""
    chosen = os.environ.get("ACAUSAL_CACHE")
    if chosen:
        return Path(chosen) / kind
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "acausal" / kind


def home(kind: str) -> Path:
    """The folder to use: `folder(kind)`, or a temporary one if others may have written to that."""
    preferred = folder(kind)
    try:
        preferred.mkdir(mode=0o700, parents=True, exist_ok=True)
        reason = _reason_for_distrust(preferred)
    except OSError as error:
        reason = error.strerror or str(error)
    return preferred if not reason else _temporary(str(preferred), reason)


@cache
def _temporary(rejected: str, reason: str) -> Path:
    """A folder for this process only; made once, with a warning, and removed when the process ends."""
    temporary = Path(tempfile.mkdtemp(prefix="acausal-"))
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    _log.warning("compiled code and models are not cached: %s, %s", rejected, reason)
    return temporary


def _reason_for_distrust(path: Path) -> str:
    """Why files from a folder must not be trusted; empty if only this user can have written to it."""
    if not hasattr(os, "geteuid"):
        return ""  # on Windows an access list protects the user's folder
    status = path.lstat()
    if not stat.S_ISDIR(status.st_mode):
        return "which is no folder"
    if status.st_uid != os.geteuid():
        return "which belongs to another user"
    if status.st_mode & 0o022:
        return "to which others may write: chmod 700 it, or delete it"
    for parent in path.absolute().parents:
        mode = parent.stat().st_mode
        if mode & 0o002 and not mode & stat.S_ISVTX:
            return f"in {parent}, where anybody may put another folder in its place"
    return ""


def _is_ours(path: Path) -> bool:
    """Whether a file is a regular one that belongs to this user, and that nobody else may write."""
    status = path.lstat()
    is_own = not hasattr(os, "geteuid") or (status.st_uid == os.geteuid() and not status.st_mode & 0o022)
    return stat.S_ISREG(status.st_mode) and is_own


def find(kind: str, key: str, suffix: str) -> Path | None:
    """The file of this key, None if there is none; files that this program has not written are removed."""
    if not folder(kind).is_dir():
        return None
    directory = home(kind)
    for path in directory.glob(f"{key}-*{suffix}"):
        with suppress(OSError):
            if _is_ours(path) and hmac.compare_digest(
                digest(path.read_bytes(), directory), path.stem.rpartition("-")[2]
            ):
                return path
        discard(path)
    return None


def place(made: Path, directory: Path, key: str, suffix: str) -> Path:
    """Move a complete file into its folder under the name of its key; return its path."""
    made.chmod(0o600)
    target = directory / f"{key}-{digest(made.read_bytes(), directory)}{suffix}"
    os.replace(made, target)
    return target


def discard(path: Path) -> None:
    """Remove a file that cannot be used."""
    with suppress(OSError):
        path.unlink()


def digest(content: bytes, directory: Path) -> str:
    """The digest with which the name of a file with this content ends."""
    return hmac.new(_secret(directory), content, hashlib.sha256).hexdigest()[:32]


def _secret(directory: Path) -> bytes:
    """The key of the digests in a folder; it is made on first use, possibly by another process at the same time."""
    path = directory / "secret"
    with suppress(OSError):
        if _is_ours(path) and len(found := path.read_bytes()) == _SECRET_LENGTH:
            return found
        discard(path)  # of another user, or truncated: files that it has signed are made again
    with tempfile.NamedTemporaryFile(dir=directory, prefix="secret-", delete=False) as file:  # mode 600
        file.write(secrets.token_bytes(_SECRET_LENGTH))
    try:
        os.link(file.name, path)
    except FileExistsError:
        pass
    finally:
        os.unlink(file.name)
    return path.read_bytes()
