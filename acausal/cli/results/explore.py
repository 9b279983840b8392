"""`acausal explore`: results in an interactive page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.completion import complete_result
from acausal.cli.arguments.outputs import check_writable
from acausal.cli.arguments.settings import listed
from acausal.cli.output.report import record, remark


def explore(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT...",
            help=".mat, .csv, .npz or .parquet files; differences are relative to the first.",
            show_default=False,
            autocompletion=complete_result,
        ),
    ],
    signals: options.Signals = None,
    output_file: Annotated[Path | None, options.output_file("The page. Default: RESULT.html.")] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write a page to explore results: all signals with units, overlaid curves, differences.

    Examples: acausal explore ThickBlock.mat; acausal explore before.mat after.mat --signals mass.s
    """
    from acausal.explore.explore import check_page_file
    from acausal.explore.explore import explore as make
    from acausal.reduce.outputs import fitting
    from acausal.result.result import load

    target = check_page_file(output_file or results[0].with_suffix(".html"))
    loaded = [load(path) for path in results]
    check_writable(target)
    names = [
        fit
        for name in listed(signals)
        for fit in fitting(name, dict.fromkeys(n for r in loaded for n in r.names)) or [name]
    ]
    labels = labels_of(results)
    make(*loaded, labels=labels, signals=names).save(target)
    if as_json:
        record({"results": labels, "signals": names, "files": [str(target)]})
    elif not quiet:
        remark(f"wrote {target}, {target.stat().st_size / 1e6:.2g} MB")


def labels_of(paths: list[Path]) -> list[str]:
    """Names of the files, or their paths where names coincide."""
    stems = [p.stem for p in paths]
    return [stem if stems.count(stem) == 1 else str(path) for stem, path in zip(stems, paths, strict=True)]
