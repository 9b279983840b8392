"""Compiled libraries on disk, and the functions made of them; the key is a hash of all they are made from."""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca

from acausal.private import discard, place
from acausal.private import find as file_of
from acausal.private import folder as folder_of
from acausal.private import home as home_of
from acausal.simulate.native.source import functions

_log = logging.getLogger(__name__)

FLAGS = ("-O3", "-fPIC", "-shared", "-ffp-contract=off", "-fno-trapping-math")
"""-O3 makes the linear algebra of an integrator 10 % faster than -O2. Without contraction a compiled run gives the
interpreter's numbers on machines with fused multiply-add as well. Nobody handles traps of floating-point exceptions:
comparisons without them are 3 % of a compiled loop, and give the same numbers."""

_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def folder() -> Path:
    """Where libraries are kept."""
    return folder_of("native")


def home() -> Path:
    """The folder to use; see `private.home`."""
    return home_of("native")


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


@cache
def _program() -> str:
    """Hash of this folder, which writes the sources: a number to be raised by hand was forgotten."""
    files = sorted(path for path in Path(__file__).parent.iterdir() if path.suffix in {".c", ".py"})
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in files)).hexdigest()


def key(kind: str, *made_from: str) -> str:
    """Hash of a kind of library and all it is made from; a compiler is not part of it, so that a hit needs none."""
    words = (_program(), kind, ca.CasadiMeta.version(), sys.platform, platform.machine(), *FLAGS, *made_from)
    return hashlib.sha256("\0".join(words).encode()).hexdigest()


def find(wanted: str) -> Path | None:
    """The library of this key; files that are not as this program has written them are removed."""
    return file_of("native", wanted, _SUFFIX)


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


def trial(command: str) -> str | None:
    """What is wrong with a compiler, found by a small function of which nothing is kept; None where it works."""
    x = ca.SX.sym("x")
    small = ca.Function("trial", [x], [x * ca.sin(x)])
    with tempfile.TemporaryDirectory(prefix="acausal-") as scratch:
        written, made = Path(scratch) / "trial.c", Path(scratch) / f"trial{_SUFFIX}"
        written.write_text(functions(small), encoding="utf-8")
        try:
            failure = _compile([command, *FLAGS, "-o", str(made), str(written), "-lm"], _time_limit(""))
            if failure is not None:
                return failure
            found = float(ca.external("trial", str(made))(0.5))
        except (OSError, RuntimeError) as error:
            return str(error)
    return None if abs(found - float(small(0.5))) < 1e-12 else f"its code gives {found:g} for {float(small(0.5)):g}"


def _build(command: str, wanted: str, source: str) -> Path | None:
    kept = home()
    with tempfile.TemporaryDirectory(prefix="build-", dir=kept) as scratch:
        written, made = Path(scratch) / "model.c", Path(scratch) / f"model{_SUFFIX}"
        written.write_text(source, encoding="utf-8")
        failure = _compile([command, *FLAGS, "-o", str(made), str(written), "-lm"], _time_limit(source))
        if failure is not None:
            _log.warning("%s failed, functions are interpreted: %s", command, failure)
            return None
        return place(made, kept, wanted, _SUFFIX)


def _time_limit(source: str) -> float:
    """Seconds that a compiler is given: ten times what gcc takes at most, or `$ACAUSAL_COMPILER_TIMEOUT`."""
    return float(os.environ.get("ACAUSAL_COMPILER_TIMEOUT") or 120.0 + 3e-4 * len(source))


def _compile(command: list[str], time_limit: float) -> str | None:
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
        _, said = process.communicate(timeout=time_limit)
    except subprocess.TimeoutExpired:
        _HUNG.add(command[0])
        return f"not done after {time_limit:g} s"
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


def native(function: Any, *companions: Any) -> Any | None:
    """The function as compiled C; None when it cannot be had, which is never an error.

    `function`: A CasADi function; its name stays.
    `companions`: More functions for the same library. CasADi takes a function that is derived from an external one,
    such as an integrator's `jacF`, from the library when it is there by that name.
    """
    parts = (function, *companions)
    known = key("functions", *(part.serialize() for part in parts))
    return made(known, lambda: functions(*parts), lambda path: ca.external(function.name(), str(path)))


def made(wanted: str, text: Callable[[], str | None] | None, load: Callable[[Path], Any]) -> Any | None:
    """What `load` makes of the library of this key; without `text` only when it is there already.

    A library that does not load is removed and made again, once.
    """
    path = find(wanted)
    found = _loaded(path, load)
    if found is not None or text is None or compiler() is None:
        return found
    written = text()
    return None if written is None else _loaded(build(wanted, written), load)


def _loaded(path: Path | None, load: Callable[[Path], Any]) -> Any | None:
    if path is None:
        return None
    try:
        return load(path)
    except (OSError, AttributeError, RuntimeError):
        discard(path)
        return None
