"""Errors that tests expect."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import pytest

from acausal.errors import AcausalError

Kind = TypeVar("Kind", bound=AcausalError)


@contextmanager
def fails_with(
    kind: type[Kind], code: str, *words: str, match: str | None = None
) -> Iterator[pytest.ExceptionInfo[Kind]]:
    """What is inside raises an error of this class and code, with these words in its fact and a pattern in its text."""
    with pytest.raises(kind, match=match) as caught:
        yield caught
    assert caught.value.code == code, caught.value
    for part in words:
        assert part in caught.value.fact, caught.value
