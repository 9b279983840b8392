"""Solvers that are asked how far they come, without a line on standard error each time that is not far.

SUNDIALS prints "At t = 0.1, mxstep steps taken before reaching tout" through `sys.stderr`, whatever CasADi's options
say. `contextlib.redirect_stderr` is not for threads: of two that overlap the second restores the sink of the first.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_EXPECTED = "At t = "
_lock = threading.Lock()
_inside = 0


class _Sieve:
    """The stream behind it, without the expected lines."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream
        self._held = False

    def write(self, text: str) -> int:
        """Pass on what is not expected; its end of line may come alone."""
        expected = _EXPECTED in text or (self._held and not text.strip())
        self._held = _EXPECTED in text and not text.endswith("\n")
        if not expected:
            self.stream.write(text)
        return len(text)

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
                sys.stderr = sys.stderr.stream
