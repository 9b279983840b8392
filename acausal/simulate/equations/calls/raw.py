"""CasADi functions called on NumPy memory, without CasADi's matrices in between.

CasADi converts its matrices to NumPy arrays through a Python list, which takes 140 ns per entry: for 501 outputs of
10 000 states that is 0.7 s, four times the integration time of IDAS (measured, docs/devdocs/numerics.md).

Solvers are also called to find out how far they come, and messages of expected failures are suppressed. SUNDIALS prints
"At t = 0.1, mxstep steps taken before reaching tout" through `sys.stderr`, whatever CasADi's options are.
`contextlib.redirect_stderr` is not thread-safe: of two that overlap, the second restores the sink of the first.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.simulate.interrupt import Interrupted, is_interrupted

Array = NDArray[np.float64]


class Kept:
    """A function that one thread calls repeatedly through the same memory, which no other thread may use."""

    def __init__(self, function: Any) -> None:
        self.function = function
        self._buffer, self._run = function.buffer()
        self._inputs: dict[str, Array] = {}
        self._outputs: dict[str, tuple[int, tuple[int, int]]] = {}
        self._counts: dict[str, int] | None = None

    def __call__(
        self, arguments: Mapping[str, Array], wanted: Sequence[str], *, partial: bool = False
    ) -> tuple[list[Array], dict[str, Any]]:
        """Return the `wanted` outputs of one call, and its statistics; missing arguments are zero.

        CasADi stores matrices by columns: an output of shape (m, n) is returned with shape (n, m).

        Raises RuntimeError if the function fails, and Interrupted, with the rows written so far, after a signal. With
        `partial`, an integrator that fails returns the rows written before, followed by nan, and the statistics have an
        entry "stopped" with the message.
        """
        self._copy_arguments(arguments)
        results = [self._new_output(name) for name in wanted]
        stopped = ""
        try:
            with without_chatter():  # failures are raised below, or lead to another attempt
                self._run()
            if self._buffer.ret():
                raise RuntimeError(f"{self.function.name()} returned {self._buffer.ret()}")
        except (RuntimeError, KeyboardInterrupt) as error:
            if is_interrupted():
                done = min(_written(rows) for rows in results)
                raise Interrupted(*(rows[:done] for rows in results)) from None
            if not partial:
                raise
            stopped = str(error)
        # memory 0 belongs to the function itself, memory 1 to the buffer
        stats = self.function.stats(1)
        if self._counts is None:
            self._counts = {name: 0 for name in stats if name.startswith("n_call_")}
        for name, before in self._counts.items():  # CasADi accumulates these over all calls
            self._counts[name] = count = stats[name]
            stats[name] = count - before
        if stopped:
            stats["stopped"] = stopped
        return results, stats

    def _copy_arguments(self, arguments: Mapping[str, Array]) -> None:
        """Copy arguments to the same memory at each call: passing CasADi a new address takes longer than a copy."""
        for name, value in arguments.items():
            memory = self._inputs.get(name)
            if memory is None:
                memory = self._inputs[name] = np.zeros(self.function.numel_in(name))
                if memory.size:
                    self._buffer.set_arg(self.function.index_in(name), memory.data)
            if memory.size:
                memory[:] = value if value.ndim == 1 else value.reshape(-1)
        if len(self._inputs) > len(arguments):
            for name in self._inputs.keys() - arguments.keys():
                self._inputs[name][:] = 0.0

    def _new_output(self, name: str) -> Array:
        """Allocate new memory for an output, so that the result needs no copy."""
        layout = self._outputs.get(name)
        if layout is None:
            index = self.function.index_out(name)
            rows, columns = self.function.size_out(index)
            layout = self._outputs[name] = index, (columns, rows)
        result = np.full(layout[1], np.nan)
        if result.size:
            self._buffer.set_res(layout[0], result.reshape(-1).data)
        return result


def _written(rows: Array) -> int:
    """The number of rows that an integrator has written; it writes them in order."""
    missing = ~np.isfinite(rows).all(axis=1)
    return int(np.argmax(missing)) if missing.any() else len(rows)


# Starts of the expected messages. CasADi prints a failed Newton step with its arguments, in several writes.
_MESSAGE_STARTS = "At t = ", "Function ", "Input "
_EXPECTED = re.compile(r"At t = |^Function \w+ \(0x|^Input \d+ \(")
_lock = threading.Lock()
_inside = 0


class _FilteredStream:
    """Forwards to a stream, but drops the expected lines."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream
        self._line = ""

    def write(self, text: str) -> int:
        """Forward unexpected text; a line that begins like an expected one is held back until it is complete."""
        self._line += text
        if self._line.endswith("\n") or not any(begin in self._line for begin in _MESSAGE_STARTS):
            self.pass_on()
        return len(text)

    def pass_on(self) -> None:
        """Write the line that is held back, unless it is expected."""
        line, self._line = self._line, ""
        if not _EXPECTED.search(line):
            self.stream.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def without_chatter() -> Iterator[None]:
    """Keep the expected lines, from any thread, from reaching `sys.stderr`; everything else passes."""
    global _inside
    with _lock:
        if not _inside and sys.stderr is not None:
            sys.stderr = _FilteredStream(sys.stderr)
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside and isinstance(sys.stderr, _FilteredStream):
                sieve, sys.stderr = sys.stderr, sys.stderr.stream
                sieve.pass_on()
