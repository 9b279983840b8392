"""`acausal plot`: signals of a result file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.completion import complete_drawn, complete_signal
from acausal.cli.output.report import record, remark, say


def plot(
    result: options.Result,
    signals: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RESULT...] VAR...",
            help="More results to overlay, and signals (* matches any text). Without signals, list them.",
            show_default=False,
            autocompletion=complete_drawn,
        ),
    ] = None,
    file: Annotated[Path | None, options.output_file(".png, .svg or .pdf. Default: RESULT.png.")] = None,
    together: Annotated[
        bool, typer.Option("--together", help="Draw all signals in one panel, with up to two axes.")
    ] = False,
    against: Annotated[
        str | None,
        typer.Option(
            "--against",
            metavar="VAR",
            help="Signal on the horizontal axis instead of time.",
            autocompletion=complete_signal,
        ),
    ] = None,
    title: Annotated[str | None, options.option("--title", "Text above the figure.")] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    window: Annotated[bool, typer.Option("--show", help="Open a window, too.")] = False,
) -> None:
    """Draw signals of result files, one panel per unit.

    Examples: acausal plot ThickBlock.mat drill.s "drill.F_*"; acausal plot before.mat after.mat mass.s
    """
    from acausal.cli.results.explore import labels_of
    from acausal.result.files import READERS
    from acausal.result.result import load

    more = [Path(text) for text in signals or () if Path(text).suffix.lower() in READERS]
    signals = [text for text in signals or () if Path(text).suffix.lower() not in READERS]
    loaded, *others = (
        replace(load(path), model=label)
        for path, label in zip([result, *more], labels_of([result, *more]), strict=True)
    )
    if not signals and as_json:
        record({"model": loaded.model, "signals": {n: s.unit for n, s in loaded.signals.items()}, "files": []})
        return
    if not signals:
        for name, signal in loaded.signals.items():
            say(f"{name} [{signal.unit}]" if signal.unit else name)
        return
    from acausal.reduce.outputs import fitting

    names = [fit for name in signals for fit in fitting(name, loaded.names) or [name]]
    # import matplotlib only after the file has been read
    from acausal.plot.plot import plot as draw
    from acausal.plot.plot import show

    # the default cannot overwrite the result, because its suffix differs
    target = file or result.with_suffix(".png")
    heading = title if title is not None or not others else ""
    drawing = draw(loaded, *names, file=target, together=together, against=against, title=heading, also=others)
    if as_json:
        record({"model": loaded.model, "drawn": names, "files": [str(target)]})
    elif not quiet:
        remark(f"wrote {target}")
    if window:
        show(drawing)
