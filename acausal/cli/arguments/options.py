"""Options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from acausal.cli.arguments.completion import (
    complete_component,
    complete_model,
    complete_parameter,
    complete_result,
    complete_signal,
    complete_solver,
)

ModelArgument = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="Name of a shipped model, path/file.py[:Class], or package.module:Class.",
        show_default=False,
        autocompletion=complete_model,
    ),
]
ComponentArgument = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="A model as everywhere, or a component of the library: Resistor, electrical.Resistor, its Modelica name.",
        show_default=False,
        autocompletion=complete_component,
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Value of a parameter, with or without unit, or of a structural argument of the model; repeatable.",
        show_default=False,
        autocompletion=complete_parameter,
    ),
]
DetailsOption = Annotated[
    bool, typer.Option("--details", help="Print all that was found, not only the ten lines that matter most.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object: the report, or the error.")]
ResultArgument = Annotated[
    Path,
    typer.Argument(
        metavar="RESULT",
        help="A .mat, .csv, .npz or .parquet file.",
        show_default=False,
        autocompletion=complete_result,
    ),
]
InputsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--input",
        metavar="NAME=VALUE",
        help="Input of the model: a number with or without unit; simulate takes FILE:COLUMN too (.csv with units in "
        "its first row, .mat, .npz, .parquet). Repeatable.",
        show_default=False,
    ),
]
FreeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--free",
        metavar="PATH",
        help="Disconnect the source of this signal input, which becomes an input of the model: force.u; repeatable.",
        show_default=False,
    ),
]
StartOption = Annotated[
    list[str] | None,
    typer.Option(
        "--start",
        metavar="PATH=VALUE",
        help="Start value of a variable instead of the declared one, with or without unit; repeatable.",
        show_default=False,
    ),
]
InterpolationOption = Annotated[
    str,
    typer.Option("--interpolation", help="Between the rows of a file: linear, hold (the last row), smooth (a spline)."),
]


def output_file_option(help: str) -> Any:
    """Where a verb writes; `help` says which suffixes it takes, and the default."""
    return typer.Option("--output-file", "-o", help=help, show_default=False)


def _time(flag: str, help: str) -> Any:
    return typer.Option(flag, metavar="TIME", help=f"{help}, in s or with a unit.", show_default=False)


StartTimeOption = Annotated[str | None, _time("--start-time", "Start of the run")]
StopTimeOption = Annotated[str | None, _time("--stop-time", "End of the run")]
OutputIntervalOption = Annotated[str | None, _time("--output-interval", "Time between two rows of the result")]
StepOption = Annotated[str | None, _time("--step", "Size of a fixed step")]
SolverOption = Annotated[
    str | None,
    typer.Option(
        "--solver",
        help="auto, idas, rosenbrock, cvodes, erk, collocation, rk, rk2.",
        show_default=False,
        autocompletion=complete_solver,
    ),
]
AccuracyOption = Annotated[
    float | None,
    typer.Option(
        "--accuracy",
        help="Wanted accuracy: a bench finds the cheapest solver and tolerance.",
        show_default=False,
    ),
]
ToleranceOption = Annotated[
    float | None, typer.Option("--tolerance", help="Relative tolerance of the solver.", show_default=False)
]
NativeOption = Annotated[
    bool | None,
    typer.Option("--native/--no-native", help="Compile to C; decided by the run's length when not given."),
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only errors and what was asked for: no remarks, no progress.")
]
RepeatOption = Annotated[
    int, typer.Option("--repeat", help="Number of runs after a warm-up; the shortest time counts.")
]
OutputsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--outputs",
        metavar="A,B",
        help="Variables that y holds, separated by commas; repeatable. Default: the model's own.",
        show_default=False,
    ),
]
SignalsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--signals",
        metavar="A,B",
        help="Signals to take, separated by commas, * for any text; repeatable.",
        show_default=False,
        autocompletion=complete_signal,
    ),
]
PlotOption = Annotated[bool, typer.Option("--plot", help="Draw a figure, to MODEL.png.")]
UnitsOption = Annotated[bool, typer.Option("--units", help="Give a .csv file a second row, with the units.")]
PlotFileOption = Annotated[
    Path | None, typer.Option("--plot-file", help="Draw it to this file: .png, .svg or .pdf.", show_default=False)
]
