"""What a command prints: tables and JSON on stdout, remarks on stderr."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from acausal.errors import AcausalError, Span, UsageError


def say(text: str = "") -> None:
    """A line of the result, on stdout.

    Raises UsageError: AC012 when it cannot be written: a full disk.
    """
    try:
        # At once: what is lost at the end of the process is lost without a word.
        print(text, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  (what is in the buffer has no place)
        raise UsageError("AC012", f"cannot write to standard output: {error.strerror or error}") from error


def remark(text: str) -> None:
    """A line about the work, on stderr, so that stdout can be piped on."""
    print(text, file=sys.stderr, flush=True)


def table(rows: Sequence[Sequence[str]], head: Sequence[str] = (), indent: str = "") -> None:
    """Aligned columns on stdout, the last one of each row ragged: a row may end early, with a sentence.

    Not a table of rich: that one cuts paths to the width of a terminal which a pipe does not have.
    """
    lines = [list(map(str, row)) for row in ([head] if head else []) + list(rows)]
    if not lines:
        return
    most = max(map(len, lines))
    # a row that ends early ends with a sentence: that makes no column wide
    columns = [[line[k] for line in lines if len(line) > k + (len(line) < most)] for k in range(most)]
    widths = [max(map(len, column), default=0) for column in columns]
    for line in lines:
        cells = [cell.ljust(width) for cell, width in zip(line, widths, strict=False)]
        say((indent + "  ".join(cells)).rstrip())


def record(content: Mapping[str, Any]) -> None:
    """One JSON object on stdout."""
    say(json.dumps(plain(content), indent=2, ensure_ascii=False))


def plain(value: Any) -> Any:
    """JSON has no nan and no infinity: they become null and a text."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else ("inf" if value > 0 else "-inf")
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def record_error(error: AcausalError) -> None:
    """The message as one JSON object on stdout, for who has asked for --json."""
    places = [{"file": span.file, "line": span.line} for span in error.where]
    told = {"code": error.code, "fact": error.fact, "where": places, "evidence": list(error.evidence)}
    record({"error": {**told, "cause": error.cause, "help": error.help}})


def show_error(error: AcausalError) -> None:
    """The message on stderr, its first line in red on a terminal."""
    from rich.console import Console
    from rich.text import Text

    first, _, rest = str(error).partition("\n")
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    # Text, not a string: brackets such as masses[0] are no markup.
    console.print(Text(first, style="bold red"))
    if rest:
        console.print(Text(rest))


def place(span: Span | None) -> str:
    """`file:line`, the file as short as it is unmistakable: from here, or from the package's folder."""
    if span is None:
        return ""
    path = Path(span.file)
    for root in (Path.cwd(), Path(__file__).resolve().parents[3]):
        if path.is_relative_to(root):
            return f"{path.relative_to(root)}:{span.line}"
    return str(span)


def quantity(value: float, unit: str) -> str:
    """A number with its declared unit."""
    return f"{value:.6g} {unit}".rstrip() if unit not in ("", "1") else f"{value:.6g}"


def seconds(value: float) -> str:
    """A duration in milliseconds below one second."""
    return f"{value:.2f} s" if value >= 1.0 else f"{1e3 * value:.1f} ms"
