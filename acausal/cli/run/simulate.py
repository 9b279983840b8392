"""`acausal simulate`: one run, its summary, its files."""

from __future__ import annotations

import io
from contextlib import redirect_stderr
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.arguments.inputs import inputs_of, starts_of
from acausal.cli.arguments.options import (
    AccuracyOption,
    FreeOption,
    InputsOption,
    InterpolationOption,
    JsonOption,
    ModelArgument,
    NativeOption,
    OutputIntervalOption,
    PlotFileOption,
    PlotOption,
    QuietOption,
    SetOption,
    SolverOption,
    StartOption,
    StartTimeOption,
    StepOption,
    StopTimeOption,
    ToleranceOption,
    UnitsOption,
    output_file_option,
)
from acausal.cli.arguments.outputs import check_picture, check_result_file
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import prepare, seconds_of
from acausal.cli.output.report import record
from acausal.cli.run.clock import Clock
from acausal.cli.run.progress import ProgressBar
from acausal.cli.run.real_time import paces, say_paces
from acausal.cli.run.session import Session
from acausal.errors import AcausalError, UsageError

if TYPE_CHECKING:
    from acausal.result.result import Result

OutputFileOption = Annotated[
    Path | None, output_file_option("Result: .mat, .csv, .npz or .parquet. Default: MODEL.mat.")
]
FormulationOption = Annotated[
    str,
    typer.Option(
        "--formulation",
        help="torn: solve blocks symbolically; dae: leave them to the DAE solver; projected: keep all constraints.",
    ),
]


def simulate(
    model: ModelArgument,
    settings: SetOption = None,
    start_time: StartTimeOption = None,
    stop_time: StopTimeOption = None,
    output_interval: OutputIntervalOption = None,
    tolerance: ToleranceOption = None,
    accuracy: AccuracyOption = None,
    solver: SolverOption = None,
    step: StepOption = None,
    formulation: FormulationOption = "torn",
    native: NativeOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Run even where the fixed step is too large to be stable.")
    ] = False,
    inputs: InputsOption = None,
    interpolation: InterpolationOption = "linear",
    freed: FreeOption = None,
    start: StartOption = None,
    output_file: OutputFileOption = None,
    units: UnitsOption = False,
    no_output: Annotated[bool, typer.Option("--no-output", help="Write no result file.")] = False,
    plot: PlotOption = False,
    plot_file: PlotFileOption = None,
    real_time_factor: Annotated[
        bool,
        typer.Option("--real-time-factor", help="Report how fast the run and compiled fixed steps are."),
    ] = False,
    stats: Annotated[
        bool, typer.Option("--stats", help="Print solver counters and the time of every stage, too.")
    ] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Simulate a model.

    The defaults of times, tolerance, solver and step are those of the model's experiment: see acausal info MODEL.

    Example: acausal simulate ThickBlock --set m=8kg --stop-time 20 --plot
    """
    clock = Clock()
    cls = find_model(model)
    prepared = prepare(cls, settings or (), freed or ())
    result_file, picture = _files(cls.__name__, no_output, output_file, plot, plot_file)
    asked = {"start_time": start_time, "stop_time": stop_time, "output_interval": output_interval, "step": step}
    times = {name: seconds_of(name, time) for name, time in asked.items()}
    given = inputs_of(prepared.model, inputs, interpolation)
    starts = starts_of(prepared.model, start)
    if real_time_factor and any(not isinstance(v, float) for v in given.values()):
        raise UsageError("AC009", "--real-time-factor takes constant inputs only")
    from acausal.lower.compile import compile
    from acausal.simulate.restructure.restructure import opening
    from acausal.simulate.run import simulate as _  # noqa: F401  (its import belongs to the first stage)

    clock.lap("import")
    choices = opening(prepared.model)
    compiled = compile(prepared.model, parameters=prepared.parameters, formulation=formulation, choices=choices or None)
    clock.lap("compile")
    session = Session(model, prepared.model, compiled, result_file, picture, clock, units)
    result = _run(
        session,
        quiet,
        {
            **times,
            # a model of changing structure is compiled again and again during its run
            **({"model": prepared.model, "parameters": prepared.parameters} if choices else {"model": compiled}),
            **{"tolerance": tolerance, "accuracy": accuracy, "solver": solver, "native": native, "force": force},
            **{"inputs": given, "start": starts},
        },
    )
    if choices and real_time_factor:
        whole = compile(prepared.model, parameters=prepared.parameters, formulation=formulation)
        compiled = whole.unchanging("a compiled fixed step")
    paced = paces(compiled, result, times["step"], given) if real_time_factor else {}
    if as_json:
        record({**session.content(result), **({"real_time": paced} if paced else {})})
    elif not quiet:
        session.summary(result, stats)
        say_paces(paced)


def _files(
    name: str, no_output: bool, output_file: Path | None, plot: bool, plot_file: Path | None
) -> tuple[Path | None, Path | None]:
    """Where result and picture go, both writable; None for what is not wanted."""
    if no_output and output_file is not None:
        raise UsageError("AC009", "--output-file and --no-output exclude each other")
    result_file = None if no_output else output_file or Path(f"{name}.mat")
    picture = plot_file or (Path(f"{name}.png") if plot else None)
    if result_file is not None:
        check_result_file(result_file)
    if picture is not None:
        check_picture(picture)
    return result_file, picture


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
