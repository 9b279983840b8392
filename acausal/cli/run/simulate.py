"""`acausal simulate`: a run, with its summary and files."""

from __future__ import annotations

import io
from collections.abc import Mapping
from contextlib import redirect_stderr
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.inputs import inputs_of, numbers_of
from acausal.cli.arguments.outputs import check_picture, check_result_file
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import prepare, seconds_of
from acausal.cli.output.report import record, remark, say
from acausal.cli.run.progress import Clock, ProgressBar
from acausal.cli.run.session import Session
from acausal.errors import AcausalError, UsageError

if TYPE_CHECKING:
    from acausal.lower.compiled import CompiledModel
    from acausal.result.result import Result


OutputFileOption = Annotated[
    Path | None, options.output_file("Result: .mat, .csv, .npz or .parquet. Default: MODEL.mat.")
]
FormulationOption = Annotated[
    str,
    typer.Option(
        "--formulation",
        help="torn: solve blocks symbolically; dae: leave them to the DAE solver; projected: keep all constraints.",
    ),
]


def simulate(
    model: options.Model,
    settings: options.Set = None,
    start_time: options.StartTime = None,
    stop_time: options.StopTime = None,
    output_interval: options.OutputInterval = None,
    tolerance: options.Tolerance = None,
    accuracy: options.Accuracy = None,
    solver: options.Solver = None,
    step: options.Step = None,
    max_step: options.MaxStep = None,
    formulation: FormulationOption = "torn",
    native: options.Native = None,
    force: Annotated[
        bool, typer.Option("--force", help="Run even if the fixed step is too large to be stable.")
    ] = False,
    inputs: options.Inputs = None,
    interpolation: options.Interpolation = "linear",
    freed: options.Free = None,
    start: options.Start = None,
    output_file: OutputFileOption = None,
    units: options.Units = False,
    no_output: Annotated[bool, typer.Option("--no-output", help="Write no result file.")] = False,
    plot: options.Plot = False,
    plot_file: options.PlotFile = None,
    real_time_factor: Annotated[
        bool,
        typer.Option(
            "--real-time-factor", help="Report the speed of the run and of compiled fixed steps, relative to real time."
        ),
    ] = False,
    stats: Annotated[
        bool, typer.Option("--stats", help="Print solver counters and the time of every stage, too.")
    ] = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
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
    asked["max_step"] = max_step
    times = {name: seconds_of(name, time) for name, time in asked.items()}
    given = inputs_of(prepared.model, inputs, interpolation)
    starts = numbers_of("--start", prepared.model, start)
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
    # a model with changing structure is compiled repeatedly during its run
    run: dict[str, Any] = {"model": compiled}
    if choices:
        run = {"model": prepared.model, "parameters": prepared.parameters}
    run |= {"tolerance": tolerance, "accuracy": accuracy, "solver": solver, "native": native, "force": force}
    result = _run(session, quiet, {**run, **times, "inputs": given, "start": starts})
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
    """Paths of the result and the plot, checked to be writable; None if not requested."""
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
    """Simulate and write the files; partial results of a failed or interrupted run are kept."""
    from acausal.simulate.run import simulate

    # catch the messages of CasADi and SUNDIALS on failures, and add them to the traceback of the error
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


_METHODS = {"rk2": "rk2", "rk": "rk4", "erk": "rk4"}
_MOST_STEPS = 200_000


def paces(compiled: CompiledModel, result: Result, step: float | None, inputs: Mapping[str, float]) -> dict[str, Any]:
    """Real-time factors (simulated over computing time) of the run, and of compiled fixed steps of a similar method.

    The step size is that of the run, else of its experiment, else 1 ms. If steps cannot be compiled, "failure" has the
    reason.
    """
    import numpy as np

    from acausal.export.step.real_time import real_time
    from acausal.export.step.step import step_function

    times: Any = result.stats["time"]
    span = float(result.time[-1] - result.time[0])
    content: dict[str, Any] = {"run_factor": span / times["integrate"], "run_time": times["integrate"]}
    size = step or compiled.flat.experiment.step or min(1e-3, span / 10)
    explicit = _METHODS.get(str(result.stats["solver"]))
    count = min(round(span / size), _MOST_STEPS)
    states = [name for name in compiled.states[: compiled.n_dynamic] if name in result]
    # a Rosenbrock method is cheaper and more accurate, if it follows the run
    for method in (explicit,) if explicit else ("rosenbrock", "sdirk"):
        try:
            made = step_function(compiled, size, method, [])
            u = np.array([inputs.get(port.name, port.start) for port in made.u])
            measured, x = real_time(made, max(count, 1), u=u)
        except AcausalError as error:
            return {**content, "failure": f"{error.code}: {error.fact}"}
        content |= measured.record()
        if count != round(span / size) or not states:
            break
        ends = dict(zip(made.x.names, x, strict=True))
        differences = {name: abs(ends[name] - float(result.final(name))) for name in states}
        worst = max(differences, key=lambda name: differences[name])
        largest = float(np.max(np.abs(result[worst])))
        content |= {"largest_difference": differences[worst], "worst_state": worst, "its_largest_value": largest}
        if measured.finite and all(d <= 0.1 * float(np.max(np.abs(result[n]))) for n, d in differences.items()):
            break
    return content


def say_paces(paced: Mapping[str, Any]) -> None:
    """Print the real-time factors."""
    if not paced:
        return
    say(
        f"real time: the run took {1e3 * paced['run_time']:.3g} ms, "
        f"{paced['run_factor']:.4g} times faster than real time"
    )
    if "failure" in paced:
        remark(f"note: no compiled steps: {paced['failure']}")
        return
    say(
        f"  {paced['method']} at {paced['step']:g} s, compiled: {1e6 * paced['mean']:.3g} us a step, "
        f"{paced['factor']:.4g} times faster than real time"
    )
    say(
        f"  worst of {paced['steps']} steps {1e6 * paced['worst']:.3g} us (99.9 % below {1e6 * paced['p999']:.3g} us): "
        f"{paced['worst_factor']:.4g} times"
    )
    if not paced["finite"]:
        remark("note: these steps do not stay finite: the step is too large for this model and method")
    elif "largest_difference" in paced:
        say(
            f"  final states within {paced['largest_difference']:.2g} of the run's: {paced['worst_state']}, "
            f"whose largest value is {paced['its_largest_value']:.3g}"
        )
        if paced["largest_difference"] > 0.1 * paced["its_largest_value"]:
            remark("note: these steps do not follow the run: the step is too large for this model and method")
