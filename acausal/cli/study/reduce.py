"""`acausal reduce`: the smallest model that gives wanted outputs."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from acausal.cli.arguments.completion import complete_solver
from acausal.cli.arguments.options import (
    InputsOption,
    JsonOption,
    ModelArgument,
    QuietOption,
    RepeatOption,
    SetOption,
    StopTimeOption,
    ToleranceOption,
)
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import listed, numbers_of, prepare, seconds_of
from acausal.cli.output.report import record, say
from acausal.errors import UsageError


def reduce(
    model: ModelArgument,
    outputs: Annotated[
        list[str] | None,
        typer.Option(
            "--outputs", metavar="A,B", help="Variables to keep, separated by commas; repeatable.", show_default=False
        ),
    ] = None,
    more: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="More variables to keep: --outputs A B.", show_default=False),
    ] = None,
    settings: SetOption = None,
    freeze: Annotated[
        list[str] | None,
        typer.Option(
            "--freeze",
            metavar="NAME",
            help="Parameters or components to replace by their numbers, separated by commas; zeros: all that are 0.",
            show_default=False,
        ),
    ] = None,
    quasi_static: Annotated[
        list[str] | None,
        typer.Option(
            "--quasi-static",
            metavar="NAME",
            help="States or components to put at their quasi-static limit, an approximation; repeatable.",
            show_default=False,
        ),
    ] = None,
    inputs: InputsOption = None,
    stop_time: StopTimeOption = None,
    tolerance: ToleranceOption = None,
    solver: Annotated[
        str | None,
        typer.Option(
            "--solver", help="Solver of the compared runs.", show_default=False, autocompletion=complete_solver
        ),
    ] = None,
    repeat: RepeatOption = 5,
    compare: Annotated[
        bool, typer.Option("--compare/--no-compare", help="Run both models: speed gained and error caused.")
    ] = True,
    as_json: JsonOption = False,
    quiet: QuietOption = False,  # nothing but the report is printed anyway
) -> None:
    """Remove what the wanted outputs do not depend on and what never moves; report what was removed and why.

    Example: acausal reduce ThickBlock --outputs drill.s,drill.F_f
    """
    names = listed([*(outputs or ()), *(more or ())])
    if not names or not outputs:
        raise UsageError(
            "AC018", "no outputs are asked for", help=f"acausal reduce {model} --outputs a,b; acausal info lists names"
        )
    prepared = prepare(find_model(model), settings or ())
    from acausal.study.reduction.reduction import reduce as reduced

    options: dict[str, Any] = {
        "stop_time": seconds_of("stop_time", stop_time),
        "tolerance": tolerance,
        "solver": solver,
        "inputs": numbers_of("--input", inputs, prepared.model),
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
