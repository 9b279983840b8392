"""Places of statements in the source, read from the frame of the generator that yields them.

`(code, lasti)` is stored per equation (two words); line and columns are looked up only for a message. Works through
`yield from` too.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from types import CodeType
from typing import Any

from acausal.errors import Span


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
