"""`acausal explore`: results in a page to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from acausal.cli.completion import complete_result, complete_signal
from acausal.cli.outputs import check_writable
from acausal.cli.report import remark


def explore(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT...",
            help=".mat, .csv, .npz or .parquet files; the first is what differences are taken to.",
            show_default=False,
            autocompletion=complete_result,
        ),
    ],
    signals: Annotated[
        list[str] | None,
        typer.Option(
            "--signal",
            metavar="VAR",
            help="What is shown first; repeatable.",
            show_default=False,
            autocompletion=complete_signal,
        ),
    ] = None,
    output_file: Annotated[
        Path | None,
        typer.Option("--output-file", "-o", help="The page. Default: RESULT.html.", show_default=False),
    ] = None,
) -> None:
    """Write a page to look at results: all signals with units and meanings, curves over each other, differences.

    Examples: acausal explore ThickBlock.mat; acausal explore before.mat after.mat --signal mass.s
    """
    from acausal.explore.explore import check_page_file
    from acausal.explore.explore import explore as make
    from acausal.result import load

    target = check_page_file(output_file or results[0].with_suffix(".html"))
    loaded = [load(path) for path in results]
    check_writable(target)
    make(*loaded, labels=labels_of(results), signals=tuple(signals or ())).save(target)
    remark(f"wrote {target}, {target.stat().st_size / 1e6:.2g} MB")


def labels_of(paths: list[Path]) -> list[str]:
    """Names of the files, or as much of their paths as tells them apart."""
    stems = [p.stem for p in paths]
    return [stem if stems.count(stem) == 1 else str(path) for stem, path in zip(stems, paths, strict=True)]
