"""Every error a user can meet, as one tree.

    AcausalError
    |-- UsageError            AC0xx  unknown model, unknown parameter, bad option, unwritable file
    |-- DeclarationError      AC1xx  a class or an instance is declared wrongly
    |   |-- UnknownFieldError AC127  no such field; an AttributeError too
    |   `-- UnitError         AC15x  dimensions do not agree
    |-- StructureError        AC2xx  balance and structure of the equations
    |-- InitializationError   AC3xx  no consistent start
    |-- RunError                     the run stopped early; `result` holds what was computed
    |   |-- IntegrationError  AC4xx  the solver cannot go on
    |   `-- EventError        AC5xx  events do not settle, or an assertion is broken
    |-- ExportError           AC6xx
    |-- OptimizationError     AC7xx  an optimal-control problem without an answer
    `-- InternalError         AC9xx  a defect of acausal itself

A message says: what (one sentence), where (the user's source), evidence (the minimal subset), the
probable cause, and what to do.
"""

from __future__ import annotations

import linecache
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Span:
    """A place in a source file: the line and, where known, the columns (0-based, end exclusive)."""

    file: str
    line: int
    column: int | None = None
    end_column: int | None = None

    @property
    def text(self) -> str:
        """The source line, stripped; empty when the file is not readable."""
        return linecache.getline(self.file, self.line).strip()

    @property
    def of_library(self) -> bool:
        """True for a place in the library that acausal ships."""
        return self.file.startswith(_MODELLERS[0])

    @property
    def marks(self) -> str:
        """`^^^` below the columns in `text`; empty where they are unknown or are all of the statement."""
        if self.column is None or self.end_column is None:
            return ""
        line = linecache.getline(self.file, self.line)
        encoded = line.encode()  # columns count bytes
        first, last = (len(encoded[:k].decode(errors="ignore")) for k in (self.column, self.end_column))
        indent = len(line) - len(line.lstrip())
        rest = line.strip().removeprefix("yield ")
        if last <= first or last - first >= len(rest):
            return ""
        return " " * (first - indent) + "^" * (last - first)

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


_PACKAGE = os.path.dirname(os.path.abspath(__file__)) + os.sep
_PYTHON = os.path.dirname(os.path.abspath(os.__file__)) + os.sep
_COMMAND_LINE = _PACKAGE + "cli" + os.sep
_MODELLERS = tuple(_PACKAGE + name + os.sep for name in ("library", "models"))


def _only_calls(file: str) -> bool:
    """Whether a file is of Python's library or of numpy, which call what others wrote."""
    is_of_python = file.startswith(_PYTHON) and "site-packages" not in file and "dist-packages" not in file
    return is_of_python or f"{os.sep}numpy{os.sep}" in file


def calling_span() -> tuple[Span, ...]:
    """The innermost caller outside the compiler: code of a modeller, of the library or of the models."""
    frame = sys._getframe(1)
    # What code of the library refuses, was given to it by its user.
    raising = frame.f_back.f_code.co_filename if frame.f_back is not None else ""
    refused = raising.startswith(_MODELLERS[0]) and frame.f_code.co_name == "__init__"
    innermost: tuple[Span, ...] = ()
    while frame is not None:
        file = frame.f_code.co_filename
        if file.startswith(_COMMAND_LINE):
            return innermost  # behind it there is no source of the user's, only the option parser
        is_made = file == "<string>" and frame.f_code.co_name == "__init__"  # what `dataclass` writes
        if (
            not is_made
            and not file.startswith("<frozen")
            and not _only_calls(file)
            and (not file.startswith(_PACKAGE) or file.startswith(_MODELLERS))
        ):
            innermost = innermost or (Span(file, frame.f_lineno),)
            if not (refused and file.startswith(_MODELLERS[0])):
                return (Span(file, frame.f_lineno),)
        frame = frame.f_back  # type: ignore[assignment]
    return innermost


class AcausalError(Exception):
    """Base of all errors; `code`, `fact`, `where`, `evidence`, `cause`, `help` are what `str()` prints.

    Parameters
    ----------
    code
        `AC` and three digits.
    fact
        One sentence: what is wrong, with the path of the thing.
    where
        Places in the user's source, the most telling one first.
    evidence
        Lines that prove the fact: the smallest subset of equations, values, names.
    cause, help
        The probable cause, and what to do about it.
    """

    def __init__(
        self,
        code: str,
        fact: str,
        *,
        where: Sequence[Span] = (),
        evidence: Sequence[str] = (),
        cause: str | None = None,
        help: str | None = None,
    ) -> None:
        super().__init__(fact)
        self.code = code
        self.fact = fact
        self.where = tuple(where)
        self.evidence = tuple(evidence)
        self.cause = cause
        self.help = help

    def __reduce__(self) -> tuple[Any, ...]:
        """What workers fail of is told where the work was ordered; constructors of errors differ."""
        return _error, (type(self), self.args), {**self.__dict__, "where": tuple(self.where)}

    def __str__(self) -> str:
        lines = [f"error[{self.code}]: {self.fact}"]
        for span in dict.fromkeys(self.where):
            lines.append(f"  at      {span}")
            if span.text:
                lines.append(f"              {span.text}")
                if span.marks:
                    lines.append(f"              {span.marks}")
        lines.extend(f"          {line}" for line in self.evidence)
        if self.cause:
            lines.append(f"  cause   {self.cause}")
        if self.help:
            lines.append(f"  help    {self.help}")
        return "\n".join(lines)


def _error(cls: type[AcausalError], args: tuple[object, ...]) -> AcausalError:
    return cls.__new__(cls, *args)


class UsageError(AcausalError):
    """The request cannot be understood: unknown model, parameter, option, or an unwritable file."""


class DeclarationError(AcausalError):
    """A class body, an instance or an equation is written wrongly.

    Without `where`, the place is the innermost frame of the modeller's own code.
    """

    def __init__(self, code: str, fact: str, *, where: Sequence[Span] = (), **details: Any) -> None:
        self._nameless = sys._getframe(1).f_code.co_filename.startswith(_MODELLERS[0])
        super().__init__(code, fact, where=where or calling_span(), **details)

    def attribute_to(self, owner: str) -> bool:
        """Put the owner into the fact where a function of the library that does not know it has refused; once."""
        was_nameless, self._nameless = self._nameless, False
        if was_nameless and owner not in self.fact:
            self.fact = f"{owner}: {self.fact}"
        return was_nameless


class UnknownFieldError(DeclarationError, AttributeError):
    """A component has no field of this name; an AttributeError, so that `hasattr` and `getattr` with a default work."""


class UnitError(DeclarationError):
    """A unit cannot be read, or the dimensions of two things that must agree differ."""


class StructureError(AcausalError):
    """The equations do not determine the unknowns."""


class InitializationError(AcausalError):
    """No start values satisfy the equations."""


class RunError(AcausalError):
    """The run stopped before its end.

    `result` is the part that was computed, or None when nothing was.
    """

    def __init__(self, code: str, fact: str, *, result: Any = None, **details: Any) -> None:
        super().__init__(code, fact, **details)
        self.result = result


class IntegrationError(RunError):
    """The solver cannot go on."""


class EventError(RunError):
    """Events do not settle, or an assertion is broken."""


class ExportError(AcausalError):
    """The model cannot be exported in the wanted form."""


class OptimizationError(AcausalError):
    """No optimum was found: the demands contradict each other, bound nothing, or do not fit the model."""


class InternalError(AcausalError):
    """A defect of acausal itself."""


def counted(count: int, noun: str) -> str:
    """`1 equation`, `2 equations`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def nearest(name: str, names: Sequence[str], count: int = 3) -> list[str]:
    """The `count` names closest to `name`, best first; matches of the last path part come first."""
    import difflib

    tail = name.rsplit(".", 1)[-1]
    same_tail = [n for n in names if n.rsplit(".", 1)[-1] == tail]
    close = difflib.get_close_matches(name, names, n=count, cutoff=0.6)
    by_tail = {n.rsplit(".", 1)[-1]: n for n in reversed(names)}
    close += [by_tail[t] for t in difflib.get_close_matches(tail, list(by_tail), n=count, cutoff=0.6)]
    return list(dict.fromkeys(same_tail[:count] + close))[:count]


def meant(name: str, names: Sequence[str], count: int = 3) -> list[str]:
    """The evidence of a message about an unknown name: those that may have been meant, if there are any."""
    close = nearest(name, names, count)
    return [f"did you mean {', '.join(close)}?"] if close else []
