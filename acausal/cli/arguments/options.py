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


def option(flag: str, help: str, **more: Any) -> Any:
    """An option; its help text states the default, if there is one."""
    return typer.Option(flag, help=help, show_default=False, **more)


def output_file(help: str) -> Any:
    """The option for an output file; `help` states the accepted suffixes and the default."""
    return typer.Option("--output-file", "-o", help=help, show_default=False)


def _time(flag: str, help: str) -> Any:
    return option(flag, f"{help}, in s or with a unit.", metavar="TIME")


def _argument(metavar: str, help: str, complete: Any) -> Any:
    return typer.Argument(metavar=metavar, help=help, show_default=False, autocompletion=complete)


Model = Annotated[
    str, _argument("MODEL", "Name of a shipped model, path/file.py[:Class], or package.module:Class.", complete_model)
]
Component = Annotated[
    str,
    _argument(
        "MODEL",
        "A model, or a library component: Resistor, electrical.Resistor, or its Modelica name.",
        complete_component,
    ),
]
Set = Annotated[
    list[str] | None,
    option(
        "--set",
        "Set a parameter, with or without a unit, or a structural argument of the model; repeatable.",
        metavar="PATH=VALUE",
        autocompletion=complete_parameter,
    ),
]
Details = Annotated[
    bool, typer.Option("--details", help="Print the full report instead of its ten most important lines.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object: the report, or the error.")]
Result = Annotated[Path, _argument("RESULT", "A .mat, .csv, .npz or .parquet file.", complete_result)]
Inputs = Annotated[
    list[str] | None,
    option(
        "--input",
        "Input of the model: a number with or without unit; simulate takes FILE:COLUMN too (.csv with units in "
        "its first row, .mat, .npz, .parquet). Repeatable.",
        metavar="NAME=VALUE",
    ),
]
Free = Annotated[
    list[str] | None,
    option(
        "--free",
        "Disconnect the source of this signal input, which becomes an input of the model: force.u; repeatable.",
        metavar="PATH",
    ),
]
Start = Annotated[
    list[str] | None,
    option(
        "--start",
        "Start value of a variable instead of the declared one, with or without unit; repeatable.",
        metavar="PATH=VALUE",
    ),
]
Interpolation = Annotated[
    str,
    typer.Option(
        "--interpolation",
        help="Interpolation between the rows of a file: linear, hold (the last row), smooth (a spline).",
    ),
]
StartTime = Annotated[str | None, _time("--start-time", "Start of the run")]
StopTime = Annotated[str | None, _time("--stop-time", "End of the run")]
OutputInterval = Annotated[str | None, _time("--output-interval", "Time between two rows of the result")]
Step = Annotated[str | None, _time("--step", "Size of a fixed step")]
MaxStep = Annotated[str | None, _time("--max-step", "Longest step of a variable-step solver")]
Solver = Annotated[
    str | None,
    option("--solver", "auto, idas, rosenbrock, cvodes, erk, collocation, rk, rk2.", autocompletion=complete_solver),
]
Accuracy = Annotated[
    float | None, option("--accuracy", "Wanted accuracy: a small bench picks the cheapest solver and tolerance.")
]
Tolerance = Annotated[float | None, option("--tolerance", "Relative tolerance of the solver.")]
Native = Annotated[
    bool | None, typer.Option("--native/--no-native", help="Compile to C. Default: when the runs are long enough.")
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only errors and the requested output: no remarks, no progress.")
]
Repeat = Annotated[int, typer.Option("--repeat", help="Number of runs after a warm-up; the shortest time counts.")]
Outputs = Annotated[
    list[str] | None,
    option(
        "--outputs", "Variables that y holds, separated by commas; repeatable. Default: the model's own.", metavar="A,B"
    ),
]
Signals = Annotated[
    list[str] | None,
    option(
        "--signals",
        "Signals to take, separated by commas, * for any text; repeatable.",
        metavar="A,B",
        autocompletion=complete_signal,
    ),
]
Plot = Annotated[bool, typer.Option("--plot", help="Draw a figure, to MODEL.png.")]
Units = Annotated[bool, typer.Option("--units", help="Write the units to a second row of a .csv file.")]
PlotFile = Annotated[Path | None, option("--plot-file", "Draw it to this file: .png, .svg or .pdf.")]
