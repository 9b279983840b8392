"""`acausal diagram`: the connection diagram of a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.outputs import check_writable
from acausal.cli.arguments.reference import find_component
from acausal.cli.arguments.settings import prepare
from acausal.cli.output.report import record, remark


def diagram(
    model: options.Component,
    settings: options.Set = None,
    depth: Annotated[int, typer.Option("--depth", min=1, help="Number of hierarchy levels to show.")] = 1,
    opened: Annotated[
        list[str] | None, options.option("--open", "A component whose parts are shown too; repeatable.", metavar="PATH")
    ] = None,
    output_file: Annotated[
        Path | None, options.output_file(".svg, or .html to open blocks by a click. Default: MODEL.svg.")
    ] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Draw the connection diagram of a model or of a component of the library.

    Examples: acausal diagram ThickBlock; acausal diagram DrillingForce -o force.html; acausal diagram arm.py --depth 2
    """
    from acausal.diagram.diagram import check_diagram_file
    from acausal.diagram.diagram import diagram as make

    cls, _ = find_component(model)
    target = check_diagram_file(output_file or Path(f"{cls.__name__}.svg"))
    check_writable(target)
    make(prepare(cls, settings or ()).model, depth=depth, opened=tuple(opened or ())).save(target)
    if as_json:
        record({"model": cls.__name__, "files": [str(target)]})
    elif not quiet:
        remark(f"wrote {target}")
