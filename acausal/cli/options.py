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
