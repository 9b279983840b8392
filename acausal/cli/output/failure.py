"""Errors as the command line shows them, and its exit codes.

0    done
1    the model or the solver failed
2    wrong usage
3    a comparison is out of tolerance
130  interrupted
143  terminated (SIGTERM)
"""

from __future__ import annotations

import re
import signal
import sys
import sysconfig
import threading
import traceback
from pathlib import Path
from types import FrameType, ModuleType, TracebackType

from acausal.cli.arguments.catalogue import families, library_parts, near_parts
from acausal.errors import AcausalError, InternalError, Span, UsageError, nearest
from acausal.language.component import Component
from acausal.language.expressions.expression import Expr
from acausal.simulate.interrupt import terminate, was_terminated

FAILED, USAGE, OUT_OF_TOLERANCE, INTERRUPTED, TERMINATED = 1, 2, 3, 130, 143

_PACKAGE = Path(__file__).resolve().parents[2]
_OPEN = tuple(_PACKAGE / name for name in ("library", "models"))
_FOREIGN = tuple({Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib")})


class ModelCodeError(AcausalError):
    """The Python code of a model raised another exception: NameError, SyntaxError, ImportError ..."""


def exit_code(error: AcausalError) -> int:
    """The exit code for an error."""
    return USAGE if isinstance(error, UsageError) else FAILED


def as_error(error: Exception) -> AcausalError:
    """The error to show for any exception: itself, a mistake in the model with its position, or a defect in acausal."""
    if isinstance(error, AcausalError):
        return error
    if isinstance(error, SyntaxError) and error.filename and error.lineno and not _is_ours(error.filename):
        return ModelCodeError(
            "AC002", f"{Path(error.filename).name} is not Python: {error.msg}", where=[_syntax_span(error)]
        )
    found = _model_frame(error.__traceback__)
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    if found is not None:
        span, frame = found
        return ModelCodeError("AC002", f"{_place(frame)} raised {what}", where=[span], help=advice(error, frame))
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


def _place(frame: FrameType) -> str:
    """The name of the code of a frame for the author of the model: `Model.equations`."""
    name = frame.f_code.co_qualname.replace("<locals>.", "")
    owner = frame.f_locals.get("self")
    if owner is not None and name.endswith(f".{frame.f_code.co_name}"):
        return f"{type(owner).__name__}.{frame.f_code.co_name}"
    return Path(frame.f_code.co_filename).name if name == "<module>" else name


def _model_frame(trace: TracebackType | None) -> tuple[Span, FrameType] | None:
    """The innermost frame, if it is in a model or a library rather than in the compiler.

    Frames of Python and of installed packages are skipped: the error is attributed to their caller.
    """
    for frame, line in reversed(list(traceback.walk_tb(trace))):
        file = frame.f_code.co_filename
        if file.startswith("<"):
            continue
        if _is_ours(file):
            return None
        path = Path(file).resolve()
        if any(path.is_relative_to(folder) for folder in _OPEN) or not any(path.is_relative_to(f) for f in _FOREIGN):
            return Span(file, line), frame
    return None


def _is_ours(file: str) -> bool:
    path = Path(file)
    # do not resolve the path: acausal/library is a link to a folder beside the package
    path = path if path.is_absolute() else Path.cwd() / path
    return path.is_relative_to(_PACKAGE) and not any(path.is_relative_to(folder) for folder in _OPEN)


def advice(error: Exception, frame: FrameType) -> str | None:
    """A line of help, or None if there is nothing to add to the error."""
    if isinstance(error, NameError):
        return _unknown_name(str(getattr(error, "name", "")), frame)
    if isinstance(error, AttributeError):
        return _unknown_attribute(str(getattr(error, "name", "")), getattr(error, "obj", None))
    if isinstance(error, ModuleNotFoundError):
        return _library(error.name or "")
    if isinstance(error, ImportError):
        wanted = re.search(r"cannot import name '(\w+)'", str(error))
        if wanted is None:
            return None
        return _unknown_attribute(wanted[1], sys.modules.get(error.name or "")) or _elsewhere(wanted[1])
    return _operation(str(error)) if isinstance(error, TypeError) else None


def _unknown_name(name: str, frame: FrameType) -> str | None:
    owner = frame.f_locals.get("self")
    if isinstance(owner, Component) and (name in owner._declarations or hasattr(type(owner), name)):
        return f"write self.{name}"
    if name in _public():
        return f"from acausal import {name}"
    known = [*frame.f_locals, *frame.f_globals, *_public()]
    return _did_you_mean(name, known) or _elsewhere(name)


def _public() -> list[str]:
    """The public names of acausal."""
    return [name for name in dir(sys.modules["acausal"]) if not name.startswith("_")]


def _unknown_attribute(name: str, owner: object) -> str | None:
    if isinstance(owner, Expr) and name == "der":
        return "write der(self.x)"
    if isinstance(owner, ModuleType):
        return _did_you_mean(name, [n for n in dir(owner) if not n.startswith("_")])
    return None


def _library(module: str) -> str | None:
    """Help for a library that does not exist."""
    if not module.startswith("acausal.library."):
        return None
    return _did_you_mean(module.split(".")[2], list(families())) or f"there are {', '.join(families())}"


def _operation(text: str) -> str | None:
    """Help for operations that expressions do not support."""
    if re.match(r"'(Symbol|Operation|Constant|Expr)' object is not callable", text):
        return "an expression is not a function: write time or self.x without brackets"
    return None


def _elsewhere(name: str) -> str | None:
    """Help with the libraries that have a component of this or a similar name."""
    exact = [f"from acausal.library.{p.family} import {name}" for p in library_parts() if p.name == name]
    if exact:
        return ", or ".join(exact)
    # names of components start with a capital letter
    close = near_parts(name) if name[:1].isupper() else []
    return f"did you mean {', '.join(close)} of acausal.library?" if close else None


def _did_you_mean(name: str, names: list[str]) -> str | None:
    close = nearest(name, names)
    return f"did you mean {', '.join(close)}?" if close else None
