"""`acausal simulate`: one run, its summary, its files."""

from __future__ import annotations

import io
from contextlib import redirect_stderr
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.clock import Clock
from acausal.cli.options import JsonOption, ModelArgument, SetOption
from acausal.cli.outputs import check_picture, check_result_file
from acausal.cli.progress import ProgressBar
from acausal.cli.real_time import paces, say_paces
from acausal.cli.reference import find_model
from acausal.cli.report import record
from acausal.cli.session import Session
from acausal.cli.settings import numbers_of, prepare
from acausal.errors import AcausalError, UsageError

if TYPE_CHECKING:
    from acausal.result import Result

TimeOption = str | None


def _time(flag: str, help: str) -> Any:
    return typer.Option(flag, metavar="TIME", help=help + ", in s or with a unit.", show_default=False)


def simulate(
    model: ModelArgument,
    settings: SetOption = None,
    start_time: Annotated[TimeOption, _time("--start-time", "Start of the run")] = None,
    stop_time: Annotated[TimeOption, _time("--stop-time", "End of the run")] = None,
    output_interval: Annotated[TimeOption, _time("--output-interval", "Distance of the rows of the result")] = None,
    tolerance: Annotated[
        float | None, typer.Option("--tolerance", help="Relative tolerance of the solver.", show_default=False)
    ] = None,
    accuracy: Annotated[
        float | None,
        typer.Option(
            "--accuracy",
            help="Wanted accuracy: a bench finds the cheapest solver and tolerance first.",
            show_default=False,
        ),
    ] = None,
    solver: Annotated[
        str | None,
        typer.Option("--solver", help="auto, idas, rosenbrock, cvodes, erk, collocation, rk, rk2.", show_default=False),
    ] = None,
    step: Annotated[TimeOption, _time("--step", "Size of a fixed step")] = None,
    formulation: Annotated[
        str,
        typer.Option(
            "--formulation",
            help="torn: solve blocks symbolically; dae: leave them to the DAE solver; projected: keep all constraints.",
        ),
    ] = "torn",
    native: Annotated[
        bool | None,
        typer.Option("--native/--no-native", help="Compile to C; decided by the run's length when not given."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Run a fixed step that is too large to be stable too.")
    ] = False,
    inputs: Annotated[
        list[str] | None,
        typer.Option("--input", metavar="NAME=VALUE", help="Constant of a free input; repeatable.", show_default=False),
    ] = None,
    output_file: Annotated[
        Path | None,
        typer.Option("--output-file", "-o", help="Result: .mat, .csv or .npz. Default: MODEL.mat.", show_default=False),
    ] = None,
    no_output: Annotated[bool, typer.Option("--no-output", help="Write no result file.")] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Draw the model's figure to MODEL.png.")] = False,
    plot_file: Annotated[
        Path | None,
        typer.Option("--plot-file", help="Draw it to this file: .png, .svg or .pdf.", show_default=False),
    ] = None,
    real_time_factor: Annotated[
        bool,
        typer.Option("--real-time-factor", help="Report how fast the run and compiled fixed steps are."),
    ] = False,
    stats: Annotated[bool, typer.Option("--stats", help="Solver counters and times of all stages too.")] = False,
    as_json: JsonOption = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
) -> None:
    """Simulate a model.

    The defaults of times, tolerance, solver and step are those of the model's experiment: see acausal info MODEL.
    """
    clock = Clock()
    cls = find_model(model)
    prepared = prepare(cls, settings or ())
    if no_output and output_file is not None:
        raise UsageError("AC009", "--output-file and --no-output exclude each other")
    result_file = None if no_output else output_file or Path(f"{cls.__name__}.mat")
    picture = plot_file or (Path(f"{cls.__name__}.png") if plot else None)
    times = {
        name: seconds_of(name, text)
        for name, text in (
            ("start_time", start_time),
            ("stop_time", stop_time),
            ("output_interval", output_interval),
            ("step", step),
        )
    }
    if result_file is not None:
        check_result_file(result_file)
    if picture is not None:
        check_picture(picture)
    from acausal.lower.compile import compile
    from acausal.simulate.restructure import shrink
    from acausal.simulate.run import simulate as _  # noqa: F401  (its import belongs to the first stage)

    clock.lap("import")
    changing = shrink(prepared.model)
    compiled = compile(prepared.model, parameters=prepared.parameters, formulation=formulation)
    clock.lap("compile")
    session = Session(model, prepared.model, compiled, result_file, picture, clock)
    result = _run(
        session,
        quiet,
        {
            **times,
            "tolerance": tolerance,
            "accuracy": accuracy,
            "solver": solver,
            "native": native,
            "force": force,
            "inputs": numbers_of("--input", inputs),
            # a model of changing structure is compiled again and again during its run
            **({"model": prepared.model, "parameters": prepared.parameters} if changing else {"model": compiled}),
        },
    )
    paced = paces(compiled, result, times["step"], numbers_of("--input", inputs)) if real_time_factor else {}
    if as_json:
        record({**session.content(result), **({"real_time": paced} if paced else {})})
    elif not quiet:
        session.summary(result, stats)
        say_paces(paced)


def _run(session: Session, quiet: bool, options: dict[str, Any]) -> Result:
    """Simulate and write the files; what a failed or interrupted run has computed is kept."""
    from acausal.simulate.run import simulate

    # CasADi and SUNDIALS comment on their failures; those are in the error, their words only in its traceback.
    chatter = io.StringIO()
    try:
        with ProgressBar(session.compiled.name, quiet) as bar, redirect_stderr(chatter):
            result = simulate(**options, progress=bar)
    except (AcausalError, KeyboardInterrupt) as error:
        error.add_note(chatter.getvalue())
        session.rescue(error)
        raise
    session.clock.lap("integrate")
    session.finish(result)
    return result


def seconds_of(name: str, text: str | None) -> float | None:
    """A time option in seconds."""
    from acausal.units import convert

    if text is None:
        return None
    try:
        return convert(text, "s")
    except AcausalError as error:
        flag = "--" + name.replace("_", "-")
        raise UsageError(
            error.code, f"{flag} {text}: {error.fact}", evidence=error.evidence, help=error.help
        ) from error
