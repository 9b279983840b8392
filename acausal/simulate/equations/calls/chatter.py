"""Solvers that are asked how far they come, without a line on standard error each time that is not far.

SUNDIALS prints "At t = 0.1, mxstep steps taken before reaching tout" through `sys.stderr`, whatever CasADi's options
say. `contextlib.redirect_stderr` is not for threads: of two that overlap the second restores the sink of the first.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# A step that Newton's method does not solve is printed with its arguments, piece by piece.
_BEGINNINGS = "At t = ", "Function ", "Input "
_EXPECTED = re.compile(r"At t = |^Function \w+ \(0x|^Input \d+ \(")
_lock = threading.Lock()
_inside = 0


class _Sieve:
    """The stream behind it, without the expected lines."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream
        self._line = ""

    def write(self, text: str) -> int:
        """Pass on what is not expected; a line that begins as an expected one is held until it ends."""
        self._line += text
        if self._line.endswith("\n") or not any(begin in self._line for begin in _BEGINNINGS):
            self.pass_on()
        return len(text)

    def pass_on(self) -> None:
        """Write the line that is held, unless it is expected."""
        line, self._line = self._line, ""
        if not _EXPECTED.search(line):
            self.stream.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def without_chatter() -> Iterator[None]:
    """Inside, in any thread, the expected lines do not reach `sys.stderr`; everything else does."""
    global _inside
    with _lock:
        if not _inside and sys.stderr is not None:
            sys.stderr = _Sieve(sys.stderr)
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside and isinstance(sys.stderr, _Sieve):
                sieve, sys.stderr = sys.stderr, sys.stderr.stream
                sieve.pass_on()
