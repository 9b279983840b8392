"""Cache of compiled libraries on disk; the key of a library is a hash of everything from which it is built."""

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
"""-O3 makes the linear algebra of an integrator 10 % faster than -O2. Without contraction, compiled runs have the same
results as interpreted ones, also on machines with fused multiply-add. As floating-point exceptions are not trapped,
comparisons need not preserve them; that saves 3 % of a compiled loop, with the same results."""

_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def folder() -> Path:
    """The folder of the libraries."""
    return folder_of("native")


def home() -> Path:
    """The folder to use; see `private.home`."""
    return home_of("native")


def is_empty() -> bool:
    """Whether no library was ever stored, so that no key has to be computed."""
    return not folder().is_dir()


def compiler() -> str | None:
    """Path of a C compiler: `$CC`, cc, gcc or clang; None if there is none."""
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        path = shutil.which(name) if name else None
        if path:
            return path
    return None


@cache
def _program() -> str:
    """Hash of all files here, which write the sources; a version number to be raised by hand would be forgotten."""
    files = sorted(path for path in Path(__file__).parent.rglob("*") if path.suffix in {".c", ".py"})
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in files)).hexdigest()


def key(kind: str, *made_from: str) -> str:
    """Hash of a kind of library and everything it is built from; without the compiler, which a hit does not need."""
    words = (_program(), kind, ca.CasadiMeta.version(), sys.platform, platform.machine(), *FLAGS, *made_from)
    return hashlib.sha256("\0".join(words).encode()).hexdigest()


def find(wanted: str) -> Path | None:
    """The library with this key, or None; files that acausal has not written in this form are removed."""
    return file_of("native", wanted, _SUFFIX)


def build(wanted: str, source: str) -> Path | None:
    """Compile `source` and store the library; None, with a log entry, if there is no compiler or it fails."""
    command = compiler()
    if command is None:
        _log.info("no C compiler found: functions are interpreted")
        return None
    if command in _HUNG:
        return None
    try:
        return _build(command, wanted, source)
    except OSError as error:
        _log.info("the library could not be stored in %s: %s", folder(), error)
    return None


_HUNG: set[str] = set()
"""Compilers that exceeded the time limit; they are not called again."""


def trial(command: str) -> str | None:
    """Test a compiler with a small function, without storing it; returns a description of the failure, or None."""
    x = ca.SX.sym("x")
    small = ca.Function("trial", [x], [x * ca.sin(x)])
    with tempfile.TemporaryDirectory(prefix="acausal-") as scratch:
        written, library = Path(scratch) / "trial.c", Path(scratch) / f"trial{_SUFFIX}"
        written.write_text(functions(small), encoding="utf-8")
        try:
            failure = _compile([command, *FLAGS, "-o", str(library), str(written), "-lm"], _time_limit(""))
            if failure is not None:
                return failure
            result = float(ca.external("trial", str(library))(0.5))
        except (OSError, RuntimeError) as error:
            return str(error)
    return None if abs(result - float(small(0.5))) < 1e-12 else f"its code gives {result:g} for {float(small(0.5)):g}"


def _build(command: str, wanted: str, source: str) -> Path | None:
    kept = home()
    with tempfile.TemporaryDirectory(prefix="build-", dir=kept) as scratch:
        written, library = Path(scratch) / "model.c", Path(scratch) / f"model{_SUFFIX}"
        written.write_text(source, encoding="utf-8")
        failure = _compile([command, *FLAGS, "-o", str(library), str(written), "-lm"], _time_limit(source))
        if failure is not None:
            _log.warning("%s failed, functions are interpreted: %s", command, failure)
            return None
        return place(library, kept, wanted, _SUFFIX)


def _time_limit(source: str) -> float:
    """Time limit for a compiler [s]: ten times the longest time of gcc, or `$ACAUSAL_COMPILER_TIMEOUT`."""
    return float(os.environ.get("ACAUSAL_COMPILER_TIMEOUT") or 120.0 + 3e-4 * len(source))


def _compile(command: list[str], time_limit: float) -> str | None:
    """Run a compiler; returns its message if it fails, otherwise None. Its child processes end with this call."""
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        # a process group of its own, to end the programs that a compiler has started too
        start_new_session=True,
    )
    try:
        _, message = process.communicate(timeout=time_limit)
    except subprocess.TimeoutExpired:
        _HUNG.add(command[0])
        return f"not done after {time_limit:g} s"
    finally:
        if process.returncode is None:
            _end(process)
    return (message.strip()[:500] or f"status {process.returncode}") if process.returncode else None


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and its group."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.communicate()


def native(function: Any, *companions: Any) -> Any | None:
    """The CasADi function in compiled C, under the same name; None, and no error, if it cannot be compiled.

    `companions` are further functions for the same library. CasADi takes a function that it would derive from an
    external one, such as an integrator's `jacF`, from the library if that contains the name.
    """
    parts = (function, *companions)
    library_key = key("functions", *(part.serialize() for part in parts))
    return made(library_key, lambda: functions(*parts), lambda path: ca.external(function.name(), str(path)))


def made(wanted: str, text: Callable[[], str | None] | None, load: Callable[[Path], Any]) -> Any | None:
    """Load the library with this key by `load`, and build it from `text()` if it is missing; None if that fails.

    Without `text` a missing library is not built. A library that fails to load is removed and built again, once.
    """
    path = find(wanted)
    loaded = _loaded(path, load)
    if loaded is not None or text is None or compiler() is None:
        return loaded
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
