"""`acausal reduce`: the smallest model that computes the requested outputs."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.completion import complete_solver
from acausal.cli.arguments.inputs import numbers_of
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import listed, prepare, seconds_of
from acausal.cli.output.report import record, say
from acausal.errors import UsageError


def reduce(
    model: options.Model,
    outputs: Annotated[
        list[str] | None,
        options.option("--outputs", "Variables to keep, separated by commas; repeatable.", metavar="A,B"),
    ] = None,
    more: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="More variables to keep: --outputs A B.", show_default=False),
    ] = None,
    settings: options.Set = None,
    freeze: Annotated[
        list[str] | None,
        options.option(
            "--freeze",
            "Parameters or components to replace by their numbers, separated by commas; zeros: all that are 0.",
            metavar="NAME",
        ),
    ] = None,
    quasi_static: Annotated[
        list[str] | None,
        options.option(
            "--quasi-static",
            "States or components to put at their quasi-static limit, an approximation; repeatable.",
            metavar="NAME",
        ),
    ] = None,
    inputs: options.Inputs = None,
    stop_time: options.StopTime = None,
    tolerance: options.Tolerance = None,
    solver: Annotated[
        str | None, options.option("--solver", "Solver of the compared runs.", autocompletion=complete_solver)
    ] = None,
    repeat: options.Repeat = 5,
    compare: Annotated[
        bool, typer.Option("--compare/--no-compare", help="Run both models to measure the speedup and the error.")
    ] = True,
    as_json: options.Json = False,
    quiet: options.Quiet = False,  # nothing but the report is printed anyway
) -> None:
    """Remove whatever the given outputs do not depend on or never moves, and report why.

    Example: acausal reduce ThickBlock --outputs drill.s,drill.F_f
    """
    names = listed([*(outputs or ()), *(more or ())])
    if not names or not outputs:
        raise UsageError(
            "AC018", "no outputs are requested", help=f"acausal reduce {model} --outputs a,b; acausal info lists names"
        )
    prepared = prepare(find_model(model), settings or ())
    from acausal.study.reduction.reduction import reduce as reduced

    options: dict[str, Any] = {
        "stop_time": seconds_of("stop_time", stop_time),
        "tolerance": tolerance,
        "solver": solver,
        "inputs": numbers_of("--input", prepared.model, inputs),
    }
    found = reduced(
        prepared.model,
        names,
        freeze=listed(freeze),
        quasi_static=listed(quasi_static),
        parameters=prepared.parameters,
        compare=compare,
        repeat=repeat,
        **options,
    )
    if as_json:
        record(found.record())
    else:
        for line in found.lines():
            say(line)
