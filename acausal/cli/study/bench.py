"""`acausal bench`: speed against accuracy of a model."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.completion import complete_solver
from acausal.cli.arguments.inputs import numbers_of
from acausal.cli.arguments.outputs import check_picture, check_writable
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import listed, prepare, seconds_of
from acausal.cli.output.report import record, remark, say, seconds, table
from acausal.errors import UsageError

if TYPE_CHECKING:
    from acausal.study.bench.report import Bench
    from acausal.study.bench.run import Recommendation


SolversOption = Annotated[
    list[str] | None, options.option("--solver", "Try only this solver; repeatable.", autocompletion=complete_solver)
]
TolerancesOption = Annotated[
    list[float] | None, options.option("--tolerance", "Tolerance to try; repeatable. Default: 1e-3 to 1e-10.")
]
FormulationsOption = Annotated[
    list[str] | None, options.option("--formulation", "torn, dae or projected; repeatable. Default: all.")
]
StepsOption = Annotated[
    list[str] | None,
    options.option("--step", "Fixed step to try; repeatable. Default: 100, 1000, 10000 steps.", metavar="TIME"),
]
ReferenceOption = Annotated[
    Path | None, options.option("--reference", "Result file, or JSON with end values. Default: runs that converge.")
]
ChartsOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--output-file",
        "-o",
        help="Chart (.png, .svg, .pdf) or data (.json); repeatable. Default: no file.",
        show_default=False,
    ),
]


def bench(
    model: options.Model,
    settings: options.Set = None,
    inputs: options.Inputs = None,
    solver: SolversOption = None,
    tolerance: TolerancesOption = None,
    formulation: FormulationsOption = None,
    step: StepsOption = None,
    start_time: options.StartTime = None,
    stop_time: options.StopTime = None,
    reference: ReferenceOption = None,
    signals: options.Signals = None,
    repeat: options.Repeat = 5,
    time_limit: Annotated[float, typer.Option("--time-limit", help="Time limit of a single run in seconds.")] = 20.0,
    native: Annotated[
        bool, typer.Option("--native/--no-native", help="Compile to C where the solver supports it.")
    ] = True,
    recommend: Annotated[
        bool, typer.Option("--recommend", help="Name the cheapest solver for --accuracy, or for the model's tolerance.")
    ] = False,
    accuracy: options.Accuracy = None,
    output: ChartsOption = None,
    as_json: options.Json = False,
    details: options.Details = False,
    quiet: options.Quiet = False,
) -> None:
    """Chart speed against accuracy: solvers, tolerances, forms of the equations, fixed steps.

    Every case runs in a process of its own, up to the time limit. The report shows failed cases with their reason.

    Example: acausal bench Oscillator --recommend --accuracy 1e-6
    """
    if accuracy is not None and not 0 < accuracy < 1:
        raise UsageError("AC041", f"--accuracy {accuracy:g} is not between 0 and 1")
    prepared = prepare(find_model(model), settings or ())
    if recommend and accuracy is None:
        accuracy = type(prepared.model).experiment.tolerance
    for file in output or ():
        check_writable(file) if file.suffix.lower() == ".json" else check_picture(file)
    from acausal.study.bench.bench import bench as made_by

    found = made_by(
        prepared.model,
        solvers=solver,
        tolerances=tolerance,
        formulations=formulation,
        # with tolerances alone, no fixed steps are requested
        steps=[seconds_of("step", text) or 0.0 for text in step] if step else [] if tolerance else None,
        reference=reference,
        variables=listed(signals) or None,
        parameters=prepared.parameters,
        inputs=numbers_of("--input", prepared.model, inputs),
        repeat=repeat,
        time_limit=time_limit,
        native=native,
        start_time=seconds_of("start_time", start_time),
        stop_time=seconds_of("stop_time", stop_time),
        progress=None if quiet or as_json else remark,
    )
    for file in output or ():
        _write(found, file)
    advice = found.recommend(accuracy) if accuracy is not None else None
    if as_json:
        recommendation = None if advice is None else advice.record()
        record({**found.record(), "recommendation": recommendation, "files": [str(file) for file in output or ()]})
        return
    arguments = [model, *_repeated("--set", settings), *_repeated("--input", inputs)]
    arguments += [*_repeated("--start-time", [start_time]), *_repeated("--stop-time", [stop_time])]
    _summary(found, advice, shlex.join(arguments), recommend, details)
    if quiet:
        return
    for note in found.notes:
        remark(f"note: {note}")
    for file in output or ():
        remark(f"wrote {file}")


def _write(found: Bench, output: Path) -> None:
    import json

    from acausal.cli.output.report import plain
    from acausal.result.files import atomic

    if output.suffix.lower() != ".json":
        found.plot(output)
        return
    with atomic(output) as file:
        file.write(json.dumps(plain(found.record()), indent=1).encode())


def _repeated(flag: str, values: Sequence[str | None] | None) -> list[str]:
    return [part for value in values or () if value is not None for part in (flag, value)]


def _summary(found: Bench, advice: Recommendation | None, model: str, brief: bool, details: bool) -> None:
    if not brief:
        for line in found.lines():
            say(line)
    if details:
        head, *rows = found.rows()
        table(rows, head, indent="  ")
        for name, (observed, classical) in found.orders.items():
            lost = ": order reduction, by stiffness, kinks or events" if observed < 0.7 * classical else ""
            say(f"  order      {name}: observed {observed:.1f} of {classical}{lost}")
        parts = [f"{name} {seconds(t)}" for name, t in found.times.items() if t == t]
        say(f"  besides    {', '.join(parts)}")
    if advice is not None:
        say(f"  recommended for {advice.accuracy:g}: {advice.text}")
        say(f"  acausal simulate {model} {advice.command}")
