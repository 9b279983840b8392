"""Ctrl-C, or a request to end, while a solver runs."""

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
    """SIGTERM: a batch system, or a service manager, asks for the end."""


class Interrupted(KeyboardInterrupt):
    """A call that was ended on its way.

    `rows` are its outputs as far as it had come, one row an output time; `got` is what the solver has made of them;
    `signal` is the number of the signal.
    """

    def __init__(self, *rows: NDArray[np.float64]) -> None:
        super().__init__()
        self.rows = rows
        self.signal = _pressed()
        self.got: Any = None


def terminate(number: int, frame: FrameType | None) -> NoReturn:
    """Handler for SIGTERM of a program that wants its runs to keep what they have computed."""
    raise Terminated


_KNOWN = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: terminate}


class Interruptible:
    """Remembers Ctrl-C, and SIGTERM where `terminate` is its handler, inside the `with` block.

    CasADi raises KeyboardInterrupt inside the solver's callbacks, the solver takes it for a failure of the model and
    fails with a RuntimeError: only who remembers the signal can tell the two apart. The same goes for what compiles
    and starts a model, so that the blocks nest: the outermost one remembers for all, and whoever enters the next one
    or leaves the last after a signal that got lost is told then. A handler of the caller's own is left alone, and so
    is every thread but the main one, which alone receives signals.
    """

    def __init__(self) -> None:
        self._noted: int | None = None
        self._around: Interruptible | None = None
        self._installed: list[signal.Signals] = []

    @property
    def pressed(self) -> int | None:
        """The signal that came, in this block or in one around it."""
        return self._noted if self._around is None else self._around.pressed

    def __enter__(self) -> Interruptible:
        if threading.current_thread() is threading.main_thread():
            self._around = _heeding()
            self.check()
            if self._around is None:  # a block within another one leaves its handlers
                self._installed = [number for number, usual in _KNOWN.items() if signal.getsignal(number) is usual]
            for number in self._installed:
                signal.signal(number, self._note)
        return self

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._noted = number
        self.check()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number in self._installed:
            signal.signal(number, _KNOWN[number])
        if kind is None and self._around is None:
            self.check()

    def check(self) -> None:
        """Raise KeyboardInterrupt when Ctrl-C was pressed, Terminated after SIGTERM."""
        if self.pressed is not None:
            raise Terminated if self.pressed == signal.SIGTERM else KeyboardInterrupt


Parameters = ParamSpec("Parameters")
Answer = TypeVar("Answer")


def interruptible(function: Callable[Parameters, Answer]) -> Callable[Parameters, Answer]:
    """The function in a block of `Interruptible`: a signal is not lost, whatever it comes in."""

    @wraps(function)
    def run(*args: Parameters.args, **options: Parameters.kwargs) -> Answer:
        with Interruptible():
            return function(*args, **options)

    return run


def is_interrupted() -> bool:
    """Whether the run of this thread was asked to end: then the failure of a call is that of nothing else."""
    return _pressed() is not None


def was_terminated(stop: KeyboardInterrupt) -> bool:
    """Whether it was SIGTERM rather than Ctrl-C."""
    return isinstance(stop, Terminated) or (isinstance(stop, Interrupted) and stop.signal == signal.SIGTERM)


def _pressed() -> int | None:
    if threading.current_thread() is not threading.main_thread():
        return None
    heeding = _heeding()
    return None if heeding is None else heeding.pressed


def _heeding() -> Interruptible | None:
    """Who handles signals now."""
    owners = (getattr(signal.getsignal(number), "__self__", None) for number in _KNOWN)
    return next((owner for owner in owners if isinstance(owner, Interruptible)), None)
