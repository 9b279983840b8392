"""Checks of output files before the work starts."""

from __future__ import annotations

from pathlib import Path


def check_result_file(path: Path) -> None:
    """Refuse a result file that cannot be written: UsageError AC012, or AC013 for an unknown suffix."""
    from acausal.result.files import WRITERS, check_suffix

    check_suffix(path, WRITERS, "result format")
    check_writable(path)


def check_picture(path: Path) -> None:
    """Refuse a picture that cannot be written: UsageError AC012, or AC013 for an unknown suffix."""
    from acausal.plot import plot

    plot.check_picture(path)
    check_writable(path)


class _Enough(Exception):
    pass


def check_writable(path: Path) -> None:
    """Open the file as its writer will, without leaving a trace; UsageError AC012."""
    from acausal.result.files import atomic

    try:
        with atomic(path):
            raise _Enough
    except _Enough:
        pass
