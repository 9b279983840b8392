"""Base class of statements, and detection of statements that are made but not yielded.

`connect(a, b)` and `a == b` are values. One that is made but not yielded would be lost, and the model run without it.
Each statement is therefore added to the ledger of the running method when it is made, and removed when it is yielded or
becomes part of another one; an error is raised for those that remain at the end.

A place in the source is stored as `(code, lasti)`, two words; line and columns are looked up only for a message.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from types import CodeType, FrameType
from typing import Any

from acausal.errors import DeclarationError, Span


@dataclass(frozen=True, slots=True)
class Located:
    """A place with its line and columns: the pickled form of an `Origin`, since code objects cannot be pickled."""

    place: Span

    def span(self) -> Span:
        """File, line and columns."""
        return self.place


@dataclass(frozen=True, slots=True)
class Origin:
    """A place in a code object; `span()` resolves it."""

    code: CodeType
    lasti: int

    def __reduce__(self) -> tuple[type[Located], tuple[Span]]:
        return Located, (self.span(),)

    def span(self) -> Span:
        """File, line and columns of the instruction."""
        positions = list(self.code.co_positions())
        line, end_line, column, end_column = positions[self.lasti // 2]
        same_line = line == end_line
        return Span(
            self.code.co_filename,
            line or self.code.co_firstlineno,
            column if same_line else None,
            end_column if same_line else None,
        )


Ledger = dict[int, tuple[object, Origin]]
"""(Statement, place) by `id`; references to the statements keep their ids unique."""

# The ledger of the running method; a context variable, so that models can be made in several threads at the same time.
RECORDING: ContextVar[Ledger | None] = ContextVar("statements", default=None)


class Statement:
    """Base of everything that `equations`, `initial_equations` and `ties` may yield: equations, connections, `when`."""

    __slots__ = ()


def made(item: object) -> None:
    """Add a statement, or an action of a `when`, to the ledger of the running method."""
    ledger = RECORDING.get()
    if ledger is not None:
        frame: FrameType | None = sys._getframe(2)
        while frame is not None and frame.f_globals.get("__name__", "").startswith("acausal.language."):
            frame = frame.f_back
        if frame is not None:
            ledger[id(item)] = item, Origin(frame.f_code, frame.f_lasti)


def used(items: Iterable[object]) -> None:
    """Remove items that have become part of another statement from the ledger."""
    ledger = RECORDING.get()
    if ledger is not None:
        for item in items:
            ledger.pop(id(item), None)


@contextmanager
def recorded(ledger: Ledger) -> Iterator[None]:
    """Record the statements made inside the block in `ledger`."""
    token = RECORDING.set(ledger)
    try:
        yield
    finally:
        RECORDING.reset(token)


def refuse_lost(where: str, ledger: Ledger) -> None:
    """Refuse statements that were made but not yielded (AC186); `where` is the class and its method."""
    if not ledger:
        return
    lost = list(ledger.values())
    item = lost[0][0]
    more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
    in_build = where.endswith(".build")
    raise DeclarationError(
        "AC186",
        f"{where} makes `{item}`{more} and does not yield it",
        where=[o.span() for _, o in lost[:3]],
        cause="it would be lost: only yielded statements are part of the model",
        help="an action belongs in a `when` that is yielded: yield when(condition, reset(x, value))"
        if not isinstance(item, Statement)
        else f"yield it in `equations`: yield {item}"
        if in_build
        else f"put `yield` in front: yield {item}",
    )


def refuse_discarded_generators(cls: type, where: str, function: Callable[..., Any]) -> None:
    """Refuse `self.method()` alone on a line if the method is a generator, which then never runs (AC186)."""
    code = getattr(function, "__code__", None)
    if code is None:
        return
    generators = tuple(n for n in code.co_names if _yields(cls, function, n))
    for line, text in _ignored_calls(code, generators) if generators else ():
        raise DeclarationError(
            "AC186",
            f"{where} calls `{text}` and does not yield its statements",
            where=(Span(code.co_filename, line),),
            cause="a generator does not run until its statements are requested",
            help=f"yield from {text}",
        )


def _yields(cls: type, function: Callable[..., Any], name: str) -> bool:
    member = inspect.getattr_static(cls, name, None) or getattr(function, "__globals__", {}).get(name)
    return inspect.isgeneratorfunction(member)


@cache
def _ignored_calls(code: CodeType, names: tuple[str, ...]) -> tuple[tuple[int, str], ...]:
    """(Line, text) of calls of functions with these names whose value is discarded; empty without source."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(code)))
    except (OSError, SyntaxError):
        return ()
    calls = (node.value for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call))
    called = ((c, getattr(c.func, "attr", getattr(c.func, "id", ""))) for c in calls)
    return tuple((code.co_firstlineno + c.lineno - 1, ast.unparse(c)) for c, name in called if name in names)
