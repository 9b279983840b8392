"""Files that will be written, checked before the work starts."""

from __future__ import annotations

from pathlib import Path


def check_result_file(path: Path) -> None:
    """Refuse a result file that cannot be written: UsageError AC012, or AC013 for an unknown suffix."""
    from acausal.errors import UsageError
    from acausal.files import WRITERS

    if path.suffix.lower() not in WRITERS:
        raise UsageError(
            "AC013",
            f"the suffix '{path.suffix}' of {path} names no result format",
            help=f"accepted are {', '.join(WRITERS)}",
        )
    check_writable(path)


def check_picture(path: Path) -> None:
    """Refuse a picture that cannot be written: UsageError AC012, or AC013 for an unknown suffix."""
    from acausal.errors import UsageError
    from acausal.plot import FORMATS

    if path.suffix.lower() not in FORMATS:
        raise UsageError(
            "AC013",
            f"the suffix '{path.suffix}' of {path} names no picture format",
            help=f"accepted are {', '.join(FORMATS)}",
        )
    check_writable(path)


class _Enough(Exception):
    pass


def check_writable(path: Path) -> None:
    """Open the file as its writer will, and leave nothing behind; UsageError AC012."""
    from acausal.files import atomic

    try:
        with atomic(path):
            raise _Enough
    except _Enough:
        pass
