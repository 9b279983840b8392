"""CasADi functions called on NumPy memory, without CasADi's own matrices in between.

A matrix of CasADi's becomes an array of NumPy's through a Python list, 140 ns an entry: for 501 outputs of 10 000
states that is 0.7 s, four times what IDAS needs for them (measured, docs/devdocs/numerics.md).

Solvers are asked how far they come, without a line on standard error each time that is not far. SUNDIALS prints "At t =
0.1, mxstep steps taken before reaching tout" through `sys.stderr`, whatever CasADi's options say.
`contextlib.redirect_stderr` is not for threads: of two that overlap the second restores the sink of the first.
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
    """A function called again and again by one thread through the same memory, which nobody else may use."""

    def __init__(self, function: Any) -> None:
        self.function = function
        self._buffer, self._run = function.buffer()
        self._inputs: dict[str, Array] = {}
        self._outputs: dict[str, tuple[int, tuple[int, int]]] = {}
        self._counts: dict[str, int] | None = None

    def __call__(
        self, arguments: Mapping[str, Array], wanted: Sequence[str], *, partial: bool = False
    ) -> tuple[list[Array], dict[str, Any]]:
        """Outputs of one call and its statistics; arguments left out are zero.

        Matrices are column by column, as CasADi stores them: an output of shape (m, n) comes back as (n, m).

        Raises RuntimeError when the function fails, Interrupted with the rows it has written when it was asked to end.
        With `partial` it returns what an integrator has written before it failed, nan behind, and the statistics have
        an entry "stopped" with the failure.
        """
        self._set(arguments)
        results = [self._result(name) for name in wanted]
        stopped = ""
        try:
            with without_chatter():  # what fails is raised or tried again
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
        # a buffer has a memory of its own, behind the one that every function is made with
        stats = self.function.stats(1)
        if self._counts is None:
            self._counts = {name: 0 for name in stats if name.startswith("n_call_")}
        for name, before in self._counts.items():  # these go on from call to call
            self._counts[name] = count = stats[name]
            stats[name] = count - before
        if stopped:
            stats["stopped"] = stopped
        return results, stats

    def _set(self, arguments: Mapping[str, Array]) -> None:
        """Copy arguments to their place: to tell CasADi of another takes longer than to copy a small one."""
        for name, value in arguments.items():
            place = self._inputs.get(name)
            if place is None:
                place = self._inputs[name] = np.zeros(self.function.numel_in(name))
                if place.size:
                    self._buffer.set_arg(self.function.index_in(name), place.data)
            if place.size:
                place[:] = value if value.ndim == 1 else value.reshape(-1)
        if len(self._inputs) > len(arguments):
            for name in self._inputs.keys() - arguments.keys():
                self._inputs[name][:] = 0.0

    def _result(self, name: str) -> Array:
        """New memory for an output; what is written to it is not copied again."""
        known = self._outputs.get(name)
        if known is None:
            place = self.function.index_out(name)
            rows, columns = self.function.size_out(place)
            known = self._outputs[name] = place, (columns, rows)
        result = np.full(known[1], np.nan)
        if result.size:
            self._buffer.set_res(known[0], result.reshape(-1).data)
        return result


def _written(rows: Array) -> int:
    """How many rows are there: an integrator writes one after the other."""
    missing = ~np.isfinite(rows).all(axis=1)
    return int(np.argmax(missing)) if missing.any() else len(rows)


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
