"""Handling of Ctrl-C and SIGTERM while a solver runs."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from functools import wraps
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any, NoReturn, ParamSpec, TypeVar

if TYPE_CHECKING:  # the command line starts without NumPy
    import numpy as np
    from numpy.typing import NDArray


class Terminated(KeyboardInterrupt):
    """Raised on SIGTERM, by which a batch system or a service manager ends a program."""


class Interrupted(KeyboardInterrupt):
    """Raised by a call that was interrupted.

    `rows` are the outputs that it had computed, one row per output time; `piece` is the piece that the solver made of
    them; `signal` is the number of the signal.
    """

    def __init__(self, *rows: NDArray[np.float64]) -> None:
        super().__init__()
        self.rows = rows
        self.signal = _pressed()
        self.piece: Any = None


def terminate(number: int, frame: FrameType | None) -> NoReturn:
    """Handler for SIGTERM in programs whose runs shall keep the results computed so far."""
    raise Terminated


_HANDLERS = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: terminate}


class Interruptible:
    """Records Ctrl-C, and SIGTERM if `terminate` is its handler, inside the `with` block.

    CasADi raises KeyboardInterrupt inside the solver's callbacks; the solver takes it for a failure of the model and
    fails with a RuntimeError. Only a recorded signal distinguishes the two. Compiling and starting a model lose signals
    in the same way, so blocks nest: the outermost one records for all. A signal that was lost is raised when the next
    block is entered, or when the outermost one is left. A handler that the caller has installed is not replaced, and
    threads other than the main one, which alone receives signals, are not affected.
    """

    def __init__(self) -> None:
        self._received: int | None = None
        self._outer: Interruptible | None = None
        self._installed: list[signal.Signals] = []

    @property
    def pressed(self) -> int | None:
        """The number of the signal received in this block or an enclosing one; None if there was none."""
        return self._received if self._outer is None else self._outer.pressed

    def __enter__(self) -> Interruptible:
        global _outermost
        if threading.current_thread() is threading.main_thread():
            self._outer = _outermost
            self.check()
            if self._outer is None:  # an inner block keeps the handlers of the outermost one
                _outermost = self
                self._installed = [number for number, usual in _HANDLERS.items() if signal.getsignal(number) is usual]
            for number in self._installed:
                signal.signal(number, self._note)
        return self

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._received = number
        self.check()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        global _outermost
        if _outermost is self:
            _outermost = None
        for number in self._installed:
            signal.signal(number, _HANDLERS[number])
        if kind is None and self._outer is None:
            self.check()

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed, Terminated after SIGTERM."""
        if self.pressed is not None:
            raise Terminated if self.pressed == signal.SIGTERM else KeyboardInterrupt


_outermost: Interruptible | None = None
"""The outermost block of the main thread."""

Parameters = ParamSpec("Parameters")
Answer = TypeVar("Answer")


def interruptible(function: Callable[Parameters, Answer]) -> Callable[Parameters, Answer]:
    """Run the function in an `Interruptible` block, so that no signal is lost in whatever code it arrives."""

    @wraps(function)
    def run(*args: Parameters.args, **options: Parameters.kwargs) -> Answer:
        with Interruptible():
            return function(*args, **options)

    return run


def is_interrupted() -> bool:
    """Whether the run of this thread received a signal, which then is the reason why a call failed."""
    return _pressed() is not None


def was_terminated(stop: KeyboardInterrupt) -> bool:
    """Whether the signal was SIGTERM rather than Ctrl-C."""
    return isinstance(stop, Terminated) or (isinstance(stop, Interrupted) and stop.signal == signal.SIGTERM)


def _pressed() -> int | None:
    is_main = threading.current_thread() is threading.main_thread()
    return _outermost.pressed if is_main and _outermost is not None else None
