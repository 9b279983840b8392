"""`acausal export`: models for other programs."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.outputs import check_writable
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import Prepared, listed, prepare, seconds_of
from acausal.cli.output.report import quantity, record, remark, say, table

if TYPE_CHECKING:
    from acausal.export.step.source import StepFunction
    from acausal.lower.casadi_model import CasadiModel

ParametersOption = Annotated[list[str] | None, options.option("--parameters", "Parameters that p holds. Default: all.")]
MinimalOption = Annotated[bool, typer.Option("--minimal", help="Write the equations in minimal coordinates.")]
EventsOption = Annotated[bool, typer.Option("--events", help="Include discrete equations, `when` clauses and samples.")]

export = typer.Typer(help="Write a model in another form.", no_args_is_help=True)


@export.callback()
def forms() -> None:
    """Write a model in another form."""


@export.command()
def casadi(
    model: options.Model,
    output_file: Annotated[Path | None, options.output_file("File to write. Default: MODEL.casadi.")] = None,
    outputs: options.Outputs = None,
    settings: options.Set = None,
    freed: options.Free = None,
    parameters: ParametersOption = None,
    minimal: MinimalOption = False,
    events: EventsOption = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write the functions of a model for CasADi: dae, ode, implicit, outputs, init, step, invariants, instants.

    The file holds them with names, units, start, nominal, min and max of every entry; CasADi alone reads it, as
    docs/casadi.md shows.

    Example: acausal export casadi Pendulum -o pendulum.casadi
    """
    cls = find_model(model)
    target = output_file or Path(f"{cls.__name__}.casadi")
    from acausal.export.casadi.casadi_file import SUFFIXES
    from acausal.result.files import check_suffix

    check_suffix(target, SUFFIXES, "suffix of CasADi files")
    check_writable(target)
    made = _functions(prepare(cls, settings or (), freed or ()), outputs, parameters, minimal, events)
    made.save(target)
    _show(made, [target], as_json, quiet)


def _functions(
    prepared: Prepared, outputs: list[str] | None, parameters: list[str] | None, minimal: bool, events: bool
) -> CasadiModel:
    """The functions that `casadi` and `c` write."""
    from acausal.lower.compile import compile

    compiled = compile(prepared.model, parameters=prepared.parameters)
    return compiled.casadi(
        listed(outputs) or None, parameters=listed(parameters) or None, minimal=minimal, events=events
    )


def _show(made: CasadiModel, files: list[Path], as_json: bool, quiet: bool) -> None:
    functions = {name: str(f) for name, f in made.functions.items()}
    _report(made, "xzupy", list(functions.values()), {"functions": functions}, files, as_json, quiet)


def _operations(function: Any) -> int:
    """Number of operations of a call with all passes of its event iteration; called functions are included."""
    return int((function if function.is_a("SXFunction") else function.expand()).n_instructions())


def _report(
    made: CasadiModel | StepFunction,
    vectors: str,
    heads: list[str],
    content: dict[str, Any],
    files: list[Path],
    as_json: bool,
    quiet: bool,
) -> None:
    """Print `heads`, a row for each entry of the vectors, notes and files, or everything as JSON."""
    ports = {name: [vars(port) for port in getattr(made, name)] for name in vectors}
    if as_json:
        record({"model": made.name, **content, **ports, "notes": made.notes, "files": [*map(str, files)]})
        return
    if quiet:
        return
    for text in heads:
        say(text)
    rows = [
        (name if k == 0 else "", port["name"], quantity(port["start"], port["unit"]), port["doc"])
        for name, entries in ports.items()
        for k, port in enumerate(entries)
    ]
    table(rows, ("", "name", "start", "meaning"))
    for note in made.notes:
        remark(f"note: {note}")
    for file in files:
        remark(f"wrote {file}")


@export.command()
def c(
    model: options.Model,
    folder: Annotated[
        Path | None,
        typer.Option("--output-folder", "-o", help="Folder for the files. Default: here.", show_default=False),
    ] = None,
    outputs: options.Outputs = None,
    settings: options.Set = None,
    freed: options.Free = None,
    parameters: ParametersOption = None,
    minimal: MinimalOption = False,
    events: EventsOption = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write the same functions as C: MODEL.c, MODEL.h and MODEL_main.c, which prints their values at the start.

    Example: acausal export c Pendulum -o build
    """
    from acausal.result.files import atomic

    made = _functions(prepare(find_model(model), settings or (), freed or ()), outputs, parameters, minimal, events)
    target = folder or Path()
    texts = made.source()
    with suppress(OSError):  # reported below, with the name of the file
        target.mkdir(exist_ok=True)
    files = [target / name for name in texts]
    for file in files:
        check_writable(file)
    for file, text in zip(files, texts.values(), strict=True):
        with atomic(file) as opened:
            opened.write(text.encode())
    _show(made, files, as_json, quiet)


@export.command()
def step(
    model: options.Model,
    size: Annotated[str, typer.Option("--step", metavar="TIME", help="Length of a step, in s or with a unit.")] = "1ms",
    method: Annotated[str, typer.Option("--method", help="rk2, rk4, rosenbrock or sdirk.")] = "rk4",
    output_file: Annotated[Path | None, options.output_file("C file to write. Default: MODEL_step.c.")] = None,
    outputs: options.Outputs = None,
    settings: options.Set = None,
    freed: options.Free = None,
    error: Annotated[
        bool, typer.Option("--error/--no-error", help="End y with step.error, an estimate of the error of the step.")
    ] = True,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write step(x, u, p) -> x, y as C for real time: no allocation, bounded work per call.

    Example: acausal export step Pendulum --step 1ms
    """
    cls = find_model(model)
    prepared = prepare(cls, settings or (), freed or ())
    seconds = seconds_of("step", size) or 0.0
    target = output_file or Path(f"{cls.__name__}_step.c")
    from acausal.export.step.source import check_source_file
    from acausal.export.step.step import step_function
    from acausal.lower.compile import compile

    check_source_file(target)
    check_writable(target)
    compiled = compile(prepared.model, parameters=prepared.parameters)
    made = step_function(compiled, seconds, method, listed(outputs) or None, error=error)
    made.save(target)
    operations = _operations(made.function)
    head = f"{made.function}  {made.method}, {made.step:g} s, at most {operations} operations"
    content = {"method": made.method, "step": made.step, "operations": operations}
    _report(made, "xupy", [head], content, [target], as_json, quiet)
