"""Options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ModelArgument = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="Name of a shipped model, path/file.py[:Class], or package.module:Class.",
        show_default=False,
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Value of a parameter, with or without unit, or of a structural argument of the model; repeatable.",
        show_default=False,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
ResultArgument = Annotated[
    Path, typer.Argument(metavar="RESULT", help="A .mat, .csv or .npz file.", show_default=False)
]
InputsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--input",
        metavar="NAME=VALUE",
        help="Constant of a free input, with or without unit; repeatable.",
        show_default=False,
    ),
]
StartTimeOption = Annotated[
    str | None,
    typer.Option("--start-time", metavar="TIME", help="Start of the run, in s or with a unit.", show_default=False),
]
StopTimeOption = Annotated[
    str | None,
    typer.Option("--stop-time", metavar="TIME", help="End of the run, in s or with a unit.", show_default=False),
]
ToleranceOption = Annotated[
    float | None, typer.Option("--tolerance", help="Relative tolerance of the solver.", show_default=False)
]
NativeOption = Annotated[
    bool | None,
    typer.Option("--native/--no-native", help="Compile to C; decided by the run's length when not given."),
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
RepeatOption = Annotated[int, typer.Option("--repeat", help="Time is the best of so many runs after a warm-up.")]
OutputsOption = Annotated[
    list[str] | None,
    typer.Option("--output", metavar="VAR", help="What y holds; repeatable. Default: the model's own variables."),
]
