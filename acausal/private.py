"""Files that this program writes for itself and trusts later on: compiled code, compiled models.

What is found is run or believed. So a file's name ends in a digest of its bytes, keyed with a secret of its folder, and
folder and files have to be this user's and nobody else's to write; where they are not, a private temporary folder takes
their place (`docs/security.md`). One file is complete and right, or not there at all: it is renamed into place when it
is ready, and two processes that write the same one at the same time do not disturb each other.
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
_SECRET = 32


def folder(kind: str) -> Path:
    """Where files of a kind are kept: in `$ACAUSAL_CACHE`, else in the user's cache folder of this platform."""
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
    """The folder to use: `folder(kind)`, or a temporary one where others could have put something into that."""
    wanted = folder(kind)
    try:
        wanted.mkdir(mode=0o700, parents=True, exist_ok=True)
        why = _distrusted(wanted)
    except OSError as error:
        why = error.strerror or str(error)
    return wanted if not why else _temporary(str(wanted), why)


@cache
def _temporary(instead: str, why: str) -> Path:
    """A folder of this process alone; made once, with a note, and removed at its end."""
    made = Path(tempfile.mkdtemp(prefix="acausal-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    _log.warning("what is compiled is not kept: %s, %s", instead, why)
    return made


def _distrusted(path: Path) -> str:
    """Why files from a folder must not be believed; empty when nobody but this user can have written to it."""
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


def find(kind: str, wanted: str, suffix: str) -> Path | None:
    """The file of this key; files that are not as this program has written them are removed."""
    if not folder(kind).is_dir():
        return None
    kept = home(kind)
    for path in kept.glob(f"{wanted}-*{suffix}"):
        with suppress(OSError):
            if _is_ours(path) and hmac.compare_digest(digest(path.read_bytes(), kept), path.stem.rpartition("-")[2]):
                return path
        discard(path)
    return None


def place(made: Path, kept: Path, wanted: str, suffix: str) -> Path:
    """A file that is ready, moved into its folder under the name of its key."""
    made.chmod(0o600)
    found = kept / f"{wanted}-{digest(made.read_bytes(), kept)}{suffix}"
    os.replace(made, found)
    return found


def discard(path: Path) -> None:
    """Remove a file that cannot be used."""
    with suppress(OSError):
        path.unlink()


def digest(content: bytes, kept: Path) -> str:
    """What the name of a file with this content ends in."""
    return hmac.new(_secret(kept), content, hashlib.sha256).hexdigest()[:32]


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
