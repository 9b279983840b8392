"""Tests of laws that do not hold yet, each with what is missing; strict: one that begins to pass has to leave the list.

Names are the ends of pytest's identifiers, `file.py::test[case]`; a name without `[` stands for all its cases. What
begins with "hangs" is not run.
"""

from __future__ import annotations

KNOWN: dict[str, str] = {}


def reason(nodeid: str) -> str | None:
    """Why the test with this identifier fails, if it is known to."""
    name = nodeid.rsplit("/", 1)[-1]
    return KNOWN.get(name) or KNOWN.get(name.split("[", 1)[0])
