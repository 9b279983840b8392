"""Long straight-line functions in pieces: the time a compiler takes for one is more than linear in its length.

What CasADi writes for a large model is one function of ten thousands of assignments without a branch, in which
thousands of values are alive at once; gcc spends four fifths of its time on giving them registers. Cut into pieces that
hand on in an array what later ones read, 64 hinged links (50 000 assignments) compile in seconds instead of minutes,
and the values alive inside a piece are few.
"""

from __future__ import annotations

import re

LINES = 400
"""Assignments of a piece."""

LONG = 3000
"""Assignments from which on a function is cut."""

_ASSIGNMENT = re.compile(r"  (a\d+|out\d+\[\d+\])=[^;]*;")
_VARIABLE = re.compile(r"\ba\d+\b")
_POINTER = re.compile(r"\b(?:in|out)\d+\b")
_DECLARATION = re.compile(r"  casadi_real a\d+(?:, a\d+)*;")


def in_pieces(name: str, head: str, body: str) -> tuple[str, str] | None:
    """Functions for the pieces, and the lines that call them; None when the body is short, or not straight.

    `name`: Of the function; the pieces are called after it.
    `head`: Its lines up to the declarations of `a0, a1, ...`: pointers `in0, ..., out0, ...`.
    `body`: The declarations, the assignments, and `return 0;`.
    """
    lines = body.split("\n")
    steps = [line for line in lines if not _DECLARATION.fullmatch(line)]
    if len(steps) <= LONG or steps[-1] != "  return 0;" or not all(map(_ASSIGNMENT.fullmatch, steps[:-1])):
        return None
    cuts = [steps[k : min(k + LINES, len(steps) - 1)] for k in range(0, len(steps) - 1, LINES)]
    pointers = sorted(set(_POINTER.findall(head)))
    formal = ", ".join(f"casadi_real *restrict {p}" if p[0] == "o" else f"const casadi_real* {p}" for p in pointers)
    actual = ", ".join(("kept", *pointers))
    written = [_written(cut) for cut in cuts]
    read_later: set[str] = set()
    pieces: list[str] = []
    for k in range(len(cuts) - 1, -1, -1):
        taken = _taken(cuts[k])
        given = sorted(written[k] & read_later)
        text = [
            f"static __attribute__((noinline)) void {name}_{k}(casadi_real* kept, {formal}) {{",
            *_declared(sorted(written[k] | taken)),
            *(f"  {v}=kept[{int(v[1:])}];" for v in sorted(taken)),
            *cuts[k],
            *(f"  kept[{int(v[1:])}]={v};" for v in given),
            "}\n",
        ]
        pieces.append("\n".join(text))
        read_later = (read_later - written[k]) | taken
    size = 1 + max(int(v[1:]) for cut in written for v in cut)
    calls = [f"  casadi_real kept[{size}];", *(f"  {name}_{k}({actual});" for k in range(len(cuts))), "  return 0;"]
    return "".join(reversed(pieces)), "\n".join(calls)


def _written(lines: list[str]) -> set[str]:
    return {line[2:].partition("=")[0] for line in lines if line.startswith("  a")}


def _taken(lines: list[str]) -> set[str]:
    """Variables that are read before they are written."""
    taken: set[str] = set()
    known: set[str] = set()
    for line in lines:
        left, _, right = line.partition("=")
        taken.update(v for v in _VARIABLE.findall(right) if v not in known)
        known.add(left.strip())
    return taken


def _declared(variables: list[str]) -> list[str]:
    return [f"  casadi_real {', '.join(variables)};"] if variables else []
