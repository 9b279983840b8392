"""`acausal stability`: which methods fail on a model, and which solver to use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.completion import complete_solver
from acausal.cli.arguments.inputs import numbers_of
from acausal.cli.arguments.outputs import check_picture
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import prepare, seconds_of
from acausal.cli.output.report import record, remark, say


def stability(
    model: options.Model,
    settings: options.Set = None,
    inputs: options.Inputs = None,
    points: Annotated[int, typer.Option("--points", help="Number of points along the run at which to linearise.")] = 20,
    solver: Annotated[
        str | None,
        options.option("--solver", "Solver of the run: idas, rosenbrock, cvodes, erk.", autocompletion=complete_solver),
    ] = None,
    tolerance: options.Tolerance = None,
    start_time: options.StartTime = None,
    stop_time: options.StopTime = None,
    step: Annotated[str | None, options.option("--step", "Fixed step to scale the picture by.", metavar="TIME")] = None,
    check: Annotated[bool, typer.Option("--check/--no-check", help="Verify the largest stable steps by runs.")] = True,
    output: Annotated[Path | None, options.output_file("Picture: .png, .svg or .pdf. Default: none.")] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    details: options.Details = False,
) -> None:
    """Recommend a solver, and explain which ones to avoid, from eigenvalues and stable steps along a run.

    Example: acausal stability ThickBlock -o ThickBlock.png
    """
    cls = find_model(model)
    prepared = prepare(cls, settings or ())
    if output is not None:
        check_picture(output)
    from acausal.lower.compile import compile
    from acausal.study.stability.stability import stability as study

    found = study(
        compile(prepared.model, parameters=prepared.parameters),
        points=points,
        solver=solver,
        step=seconds_of("step", step),
        start_time=seconds_of("start_time", start_time),
        stop_time=seconds_of("stop_time", stop_time),
        tolerance=tolerance,
        inputs=numbers_of("--input", prepared.model, inputs),
        check=check,
    )
    if output is not None:
        found.plot(output)
    if as_json:
        record({**found.content(), "files": [] if output is None else [str(output)]})
        return
    for line in found.lines(details):
        say(line)
    if output is not None and not quiet:
        remark(f"wrote {output}")
