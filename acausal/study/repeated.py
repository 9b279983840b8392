"""Runs that repeat another one: their messages are known already."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def unheard() -> Iterator[None]:
    """Log errors only: the messages of these runs repeat those of an earlier one."""
    log = logging.getLogger("acausal")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)
