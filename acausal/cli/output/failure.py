"""Errors as the command line shows them, and its exit codes.

0    done
1    the model or the solver failed
2    wrong usage
3    a comparison is out of tolerance
130  interrupted
143  terminated (SIGTERM)
"""

from __future__ import annotations

import signal
import sys
import threading
from pathlib import Path

from acausal.errors import AcausalError, InternalError, ModelCodeError, Span, UsageError, is_model_code
from acausal.language.model_code import model_code_error
from acausal.simulate.interrupt import terminate, was_terminated

FAILED, USAGE, OUT_OF_TOLERANCE, INTERRUPTED, TERMINATED = 1, 2, 3, 130, 143


def exit_code(error: AcausalError) -> int:
    """The exit code for an error."""
    return USAGE if isinstance(error, UsageError) else FAILED


def as_error(error: Exception) -> AcausalError:
    """The error to show for any exception: itself, a mistake in the model with its position, or a defect in acausal."""
    if isinstance(error, AcausalError):
        return error
    if (
        isinstance(error, SyntaxError)
        and error.filename
        and error.lineno
        and is_model_code(error.filename) is not False
    ):
        return ModelCodeError(
            "AC002", f"{Path(str(error.filename)).name} is not Python: {error.msg}", where=[_syntax_span(error)]
        )
    wrong = model_code_error(error)
    if wrong is not None:
        return wrong
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    if isinstance(error, MemoryError):
        return AcausalError("AC903", "there is not enough memory", help="shorten the run or increase --output-interval")
    return InternalError(
        "AC999",
        f"defect in acausal: {what}",
        help="please report it with the output of the same command with --debug",
    )


def interruption(stop: KeyboardInterrupt) -> AcausalError:
    """The message for Ctrl-C and SIGTERM; the exception has the partial result of a run."""
    result = getattr(stop, "result", None)
    what = "terminated" if interrupted_code(stop) == TERMINATED else "interrupted"
    return AcausalError("AC490", what + (f" at t = {result.time[-1]:.6g} s" if result is not None else ""))


def interrupted_code(stop: KeyboardInterrupt) -> int:
    """The exit code of an interrupted or terminated process."""
    return TERMINATED if was_terminated(stop) else INTERRUPTED


def heed_termination() -> None:
    """Let SIGTERM end a verb as Ctrl-C does, so that partial results are kept, unless it already has a handler."""
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, terminate)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = report_unraisable


def report_unraisable(unraisable: sys.UnraisableHookArgs) -> None:
    """Print, as Python does, an exception that cannot be caught, except Ctrl-C, which is handled later.

    A signal may arrive while a module is imported, inside a callback of a weak reference.
    """
    if not issubclass(unraisable.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(unraisable)


def _syntax_span(error: SyntaxError) -> Span:
    column = None if error.offset is None else error.offset - 1
    return Span(str(error.filename), error.lineno or 1, column)
