"""Base class of statements, and detection of statements that are made and not yielded.

`connect(a, b)` and `a == b` are values: made and not yielded they would be lost, and the model would run without them.
Each statement therefore enters the ledger of the running method when it is made, and leaves it when it is yielded or
becomes part of another one; an error is raised for those left at the end.

The place of a statement is read from the frame of the generator that yields it, also through `yield from`. It is stored
as `(code, lasti)`, two words; line and columns are looked up only for a message.
"""

from __future__ import annotations

import ast
import dis
import inspect
import sys
import textwrap
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from types import CodeType, FrameType
from typing import Any

from acausal.errors import DeclarationError, Span

_COMPUTES = frozenset(("BINARY_OP", "COMPARE_OP", "UNARY_NEGATIVE", "UNARY_INVERT"))


@dataclass(frozen=True, slots=True)
class Located:
    """A resolved place: the pickled form of an `Origin`, since code objects cannot be pickled."""

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


def origin_of(generator: Generator[Any, Any, Any]) -> Origin:
    """The place of the statement that `generator`, just resumed, has yielded from."""
    inner: Any = generator
    while getattr(inner.gi_yieldfrom, "gi_frame", None) is not None:
        inner = inner.gi_yieldfrom
    frame = inner.gi_frame
    return Origin(frame.f_code, frame.f_lasti)


Ledger = dict[int, tuple[object, Origin]]
"""(Statement, place) by `id`; holding the statements keeps their ids unique."""

# Ledger of the running method. A context variable rather than a module variable, so that models can be made in several
# threads at a time.
_ledger: ContextVar[Ledger | None] = ContextVar("statements", default=None)


class Statement:
    """What `equations`, `initial_equations` and `ties` may yield: an equation, a connection, a `when`, ..."""

    __slots__ = ()


def made(item: object) -> None:
    """Enter a statement, or an action of a `when`, in the ledger of the running method."""
    ledger = _ledger.get()
    if ledger is not None:
        frame: FrameType | None = sys._getframe(2)
        while frame is not None and frame.f_globals.get("__name__", "").startswith("acausal.language."):
            frame = frame.f_back
        if frame is not None:
            ledger[id(item)] = item, Origin(frame.f_code, frame.f_lasti)


def is_recording() -> bool:
    """Whether a method runs whose statements are recorded; outside of one nobody would hear a statement."""
    return _ledger.get() is not None


def used(items: Iterable[object]) -> None:
    """Remove items from the ledger that have become part of another statement."""
    ledger = _ledger.get()
    if ledger is not None:
        for item in items:
            ledger.pop(id(item), None)


@contextmanager
def recorded(ledger: Ledger) -> Iterator[None]:
    """Record the statements made inside the block in `ledger`."""
    token = _ledger.set(ledger)
    try:
        yield
    finally:
        _ledger.reset(token)


def stepped(generator: Iterator[Any], ledger: Ledger) -> Iterator[Any]:
    """Iterate over a generator; statements that it makes without yielding them stay in the ledger."""
    while True:
        token = _ledger.set(ledger)
        try:
            item = next(generator)
        except StopIteration:
            return
        finally:
            _ledger.reset(token)
        ledger.pop(id(item), None)
        yield item


def refuse_lost(where: str, ledger: Ledger) -> None:
    """Refuse statements that were made and not yielded (AC186); `where` is the class and its method."""
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
        cause="it would be lost: the model knows only what is yielded",
        help="an action stands in a `when` that is yielded: yield when(condition, reset(x, value))"
        if not isinstance(item, Statement)
        else f"yield it in `equations`: yield {item}"
        if in_build
        else f"put `yield` in front: yield {item}",
    )


def refuse_unheard(cls: type, where: str, function: Callable[..., Any]) -> None:
    """Refuse `self.method()` alone on a line when the method is a generator, which then never runs (AC186)."""
    code = getattr(function, "__code__", None)
    if code is None:
        return
    suspects = tuple(n for n in code.co_names if _yields(cls, function, n))
    for line, text in _ignored_calls(code, suspects) if suspects else ():
        raise DeclarationError(
            "AC186",
            f"{where} calls `{text}` and does not yield what it states",
            where=(Span(code.co_filename, line),),
            cause="a generator that nobody asks states nothing",
            help=f"yield from {text}",
        )


def refuse_idle(where: str, function: Callable[..., Any]) -> None:
    """Refuse a sum, a product or a relation alone on a line: `der(x) + x` without `== 0` (AC186)."""
    code = getattr(function, "__code__", None)
    line = _idle(code) if code is not None else None
    if code is not None and line is not None:
        raise DeclarationError(
            "AC186",
            f"{where} computes an expression that reaches nothing",
            where=(Span(code.co_filename, line),),
            cause="an expression alone on a line is no equation: the model knows only what is yielded",
            help="yield an equation: yield left == right",
        )


@cache
def _idle(code: CodeType) -> int | None:
    """First line whose value is computed and discarded; equations are excluded, which the ledger finds."""
    before = None
    for step in dis.get_instructions(code):
        if step.opname == "POP_TOP" and before is not None and before.opname in _COMPUTES and before.argrepr != "==":
            return before.positions.lineno if before.positions else code.co_firstlineno
        before = step
    return None


def _yields(cls: type, function: Callable[..., Any], name: str) -> bool:
    found = inspect.getattr_static(cls, name, None) or getattr(function, "__globals__", {}).get(name)
    return inspect.isgeneratorfunction(found)


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
