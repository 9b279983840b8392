"""Output of a command: tables and JSON on stdout, remarks on stderr."""

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
    """Print a line of the report on stdout.

    Raises UsageError: AC012 if it cannot be written, for example to a full disk.
    """
    try:
        # flush at once, because a failure at the end of the process would not be reported
        print(text, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  (the buffer cannot be written either)
        raise UsageError("AC012", f"cannot write to standard output: {error.strerror or error}") from error


def remark(text: str) -> None:
    """Print a line on stderr, so that stdout has the report only."""
    print(text, file=sys.stderr, flush=True)


def table(rows: Sequence[Sequence[str]], head: Sequence[str] = (), indent: str = "") -> None:
    """Print aligned columns on stdout; a row may end early, with a sentence.

    Tables of rich are not used, because they shorten paths to the width of the terminal, even in a pipe.
    """
    lines = [list(map(str, row)) for row in ([head] if head else []) + list(rows)]
    if not lines:
        return
    most = max(map(len, lines))
    # the sentence of a row that ends early does not count for the width of its column
    columns = [[line[k] for line in lines if len(line) > k + (len(line) < most)] for k in range(most)]
    widths = [max(map(len, column), default=0) for column in columns]
    for line in lines:
        cells = [cell.ljust(width) for cell, width in zip(line, widths, strict=False)]
        say((indent + "  ".join(cells)).rstrip())


def record(content: Mapping[str, Any]) -> None:
    """Print one JSON object on stdout."""
    say(json.dumps(plain(content), indent=2, ensure_ascii=False))


def plain(value: Any) -> Any:
    """A value for JSON, in which nan becomes null and infinity a text."""
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
    """Print an error as one JSON object on stdout, for --json."""
    spans = [{"file": span.file, "line": span.line} for span in error.where]
    content = {"code": error.code, "fact": error.fact, "where": spans, "evidence": list(error.evidence)}
    record({"error": {**content, "cause": error.cause, "help": error.help}})


def show_error(error: AcausalError) -> None:
    """Print an error on stderr, its first line in red on a terminal."""
    from rich.console import Console
    from rich.text import Text

    first, _, rest = str(error).partition("\n")
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    # use Text, because brackets in a string, such as masses[0], would be markup
    console.print(Text(first, style="bold red"))
    if rest:
        console.print(Text(rest))


def place(span: Span | None) -> str:
    """`file:line`, with the file relative to the working directory or the folder of the package if it is inside."""
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
