"""Work in a child process with a time limit, for solvers that may hang or crash.

The loop of a solver is C code and can only be stopped by ending its process. The child is a copy of this process
(`fork`), so that the compiled model need not be pickled; only measurements are sent back. Without `fork` (Windows), the
work is done in this process and the limit is not enforced. Limits apply to processor time if the system reports it
(Linux), so that a busy machine does not make a method fail.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from acausal.errors import AcausalError

T = TypeVar("T")

_LENGTH = 8
_POLL = 0.05
_PATIENCE = 8.0
"""Largest ratio of elapsed time to the limit, for work that does not get the processor."""


@dataclass(frozen=True)
class Outcome(Generic[T]):
    """Last value yielded by the work, and the reason if there is none or the work failed after it."""

    value: T | None
    failure: str = ""
    seconds: float = 0.0


def isolated(work: Callable[[], Iterator[T]], limit: float) -> Outcome[T]:
    """Run `work` in a child process; it must yield each value within `limit` seconds after the one before.

    The last value counts, so work that improves on a first value may be interrupted.
    """
    if not hasattr(os, "fork"):
        return _in_this_process(work)
    reader, writer = os.pipe()
    began = time.perf_counter()
    with warnings.catch_warnings():
        # Python 3.12 warns of threads at a fork; BLAS, which has them here, handles forks itself
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        _child(work, reader, writer)
    os.close(writer)
    try:
        value, failure = _collect(reader, child, limit)
    finally:
        os.close(reader)
        # also after Ctrl-C, so that no child process remains
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    if value is None and not failure:
        code = os.waitstatus_to_exitcode(status)
        failure = "the process ended without a message"
        if code < 0:
            failure = f"the process died ({signal.Signals(-code).name})"
    return Outcome(value, failure, time.perf_counter() - began)


def _in_this_process(work: Callable[[], Iterator[T]]) -> Outcome[T]:
    began, last = time.perf_counter(), None
    try:
        *_, last = work()
    except (AcausalError, RuntimeError, ArithmeticError, ValueError, MemoryError) as error:
        return Outcome(None, reason(error), time.perf_counter() - began)
    return Outcome(last, "", time.perf_counter() - began)


def reason(error: BaseException) -> str:
    """An exception as one short sentence."""
    if isinstance(error, AcausalError):
        return f"{error.code}: {error.fact}"
    return f"{type(error).__name__}: {str(error).splitlines()[-1] if str(error) else ''}".rstrip(": ")


def _child(work: Callable[[], Iterator[Any]], reader: int, writer: int) -> None:
    """Do the work, send the values it yields, and exit without the clean-up of the parent."""
    try:
        os.close(reader)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        # suppress messages of the solvers about failures
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        try:
            for value in work():
                _send(writer, ("value", value))
        except Exception as error:
            _send(writer, ("failure", reason(error)))
        _send(writer, ("end", None))
    finally:
        os._exit(0)


def _send(writer: int, message: tuple[str, Any]) -> None:
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    view = memoryview(len(data).to_bytes(_LENGTH, "big") + data)
    while view:
        view = view[os.write(writer, view) :]


def _collect(reader: int, child: int, limit: float) -> tuple[Any, str]:
    """(Last value, failure); (None, "") if the child died without a message."""
    value, failure = None, ""
    while True:
        clock = _Clock(child, limit)
        head = _read_exactly(reader, _LENGTH, clock)
        body = head and _read_exactly(reader, int.from_bytes(head, "big"), clock)
        if head is None or body is None:
            return value, "" if value is not None else f"no end after {limit:g} s"
        if not head or not body:
            return value, failure
        kind, content = pickle.loads(body)
        if kind == "end":
            return value, failure
        if kind == "failure":
            failure = failure or content
        else:
            value = content


class _Clock:
    """Timer of a child process, in processor time where known."""

    def __init__(self, child: int, limit: float) -> None:
        self.child, self.limit = child, limit
        self.began, self.spent = time.perf_counter(), _spent(child)

    def expired(self) -> bool:
        passed = time.perf_counter() - self.began
        if passed < self.limit:
            return False
        now = _spent(self.child)
        if now is None or self.spent is None or passed > _PATIENCE * self.limit:
            return True
        return now - self.spent >= self.limit


def _spent(child: int) -> float | None:
    """Processor time of a process [s] from /proc (Linux); None elsewhere."""
    try:
        with open(f"/proc/{child}/stat", "rb") as file:
            # after the name, which may contain anything: utime and stime are fields 14 and 15
            fields = file.read().rpartition(b")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError):
        return None


def _read_exactly(reader: int, count: int, clock: _Clock) -> bytes | None:
    """Read `count` bytes; None on timeout, b"" at the end."""
    data = b""
    while len(data) < count:
        ready, _, _ = select.select([reader], [], [], _POLL)
        if not ready:
            if clock.expired():
                return None
            continue
        part = os.read(reader, count - len(data))
        if not part:
            return b""
        data += part
    return data
