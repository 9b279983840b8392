"""`acausal animate`: a 3D animation of a model or a result."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.completion import complete_model, complete_shown
from acausal.cli.arguments.outputs import check_writable
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import Prepared, prepare, seconds_of
from acausal.cli.arguments.shipped import shipped_models
from acausal.cli.output.report import record, remark
from acausal.errors import UsageError

if TYPE_CHECKING:
    from acausal.result.result import Result

RESULTS = (".mat", ".csv", ".npz", ".parquet")
ShownArgument = Annotated[
    str,
    typer.Argument(
        metavar="MODEL|RESULT",
        help="A model to simulate, or a result file: .mat, .csv, .npz, .parquet.",
        show_default=False,
        autocompletion=complete_shown,
    ),
]


def animate(
    shown: ShownArgument,
    model: Annotated[
        str | None,
        options.option(
            "--model",
            "The model of the result file; a shipped model is found by the name of the file.",
            metavar="MODEL",
            autocompletion=complete_model,
        ),
    ] = None,
    settings: options.Set = None,
    start_time: options.StartTime = None,
    stop_time: options.StopTime = None,
    tolerance: options.Tolerance = None,
    solver: options.Solver = None,
    poses: Annotated[int, typer.Option("--poses", min=2, help="Largest number of poses to store per body.")] = 2000,
    output_file: Annotated[Path | None, options.output_file(".html, .glb or .gif. Default: MODEL.html.")] = None,
    gif: Annotated[bool, typer.Option("--gif", help="Also write a moving picture, MODEL.gif.")] = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Animate a multibody model in 3D, with curves and a time slider: one HTML file.

    Examples: acausal animate ThickBlock; acausal animate arm.mat --model arm.py --gif; acausal animate arm.py -o a.glb
    """
    from acausal.animate.animate import animate as make
    from acausal.animate.animate import check_animation_file

    result, prepared = opened(shown, model, settings)
    name = type(prepared.model).__name__
    target = check_animation_file(output_file or Path(f"{name}.html"))
    files = [target] + ([target.with_suffix(".gif")] if gif and target.suffix != ".gif" else [])
    for file in files:
        check_writable(file)
    run: dict[str, Any] = {
        "start_time": seconds_of("start_time", start_time),
        "stop_time": seconds_of("stop_time", stop_time),
        "tolerance": tolerance,
        "solver": solver,
    }
    given = [key for key, value in run.items() if value is not None]
    if result is not None and given:
        raise UsageError("AC009", f"--{given[0].replace('_', '-')} is for a run, and {shown} is the result of one")
    options = {} if result is not None else {**run, "parameters": prepared.parameters}
    animation = make(prepared.model, result, poses=poses, **options)
    for file in files:
        animation.save(file)
    for note in () if quiet or as_json else animation.scene.notes:
        remark(f"note: {note}")
    if as_json:
        scene = animation.scene
        nodes = [{"name": n.name, "kind": n.kind} for n in scene.nodes]
        content = {"model": name, "files": [str(f) for f in files], "poses": len(scene.time), "nodes": nodes}
        record({**content, "notes": list(scene.notes)})
    elif not quiet:
        remark(f"wrote {', '.join(map(str, files))}")


def opened(shown: str, model: str | None, settings: list[str] | None) -> tuple[Result | None, Prepared]:
    """(The result to show, or None if the model has to be simulated; the model)."""
    path = Path(shown)
    if path.suffix.lower() not in RESULTS:
        return None, prepare(find_model(shown), settings or ())
    from acausal.result.result import load

    result = load(path)
    names = [m.name for m in shipped_models()]
    reference = model or next((n for n in (result.model, path.stem) if n in names), None)
    if reference is None:
        raise UsageError(
            "AC082",
            f"{shown} does not name its model",
            help=f"acausal animate {shown} --model MODEL, with the --set of the run",
        )
    return result, prepare(find_model(reference), settings or ())
