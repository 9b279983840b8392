"""`acausal info`: description of a model, its parameters, and the outcome of its compilation."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.outputs import check_picture
from acausal.cli.arguments.reference import find_component
from acausal.cli.arguments.settings import prepare
from acausal.cli.models.component import show_part
from acausal.cli.models.names import flat_names, unit_of
from acausal.cli.output.failure import exit_code
from acausal.cli.output.report import place, quantity, record, remark, say, seconds, table
from acausal.errors import AcausalError, Span, UsageError, counted
from acausal.flatten.instances.instances import instances
from acausal.language.component import Component
from acausal.language.declarations.declaration import Declaration, Kind

if TYPE_CHECKING:
    from acausal.flatten.flat import FlatParameter, FlatSystem
    from acausal.flatten.reduced import ReducedSystem
    from acausal.lower.compiled import CompiledModel
    from acausal.lower.report import StructureReport

_MOST_BLOCKS = 12


def info(
    model: options.Component,
    settings: options.Set = None,
    stats: Annotated[
        bool, typer.Option("--stats", help="Print the counts and the time of each compiler stage.")
    ] = False,
    spy: Annotated[
        Path | None,
        typer.Option(
            "--spy",
            metavar="FILE",
            help="Draw the incidence matrix before and after block ordering (.png, .svg, .pdf).",
        ),
    ] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Describe a model (parameters, states, signals) or a library component (connectors, equations, uses).

    Examples: acausal info ThickBlock; acausal info Resistor; acausal info Modelica.Electrical.Analog.Basic.Resistor
    """
    from acausal.flatten.flatten import flatten
    from acausal.lower.compile import compile

    if spy is not None:
        check_picture(spy)
    cls, part = find_component(model)
    if part is not None:
        _refuse_for_part(part.name, {"--set": settings, "--stats": stats, "--spy": spy})
        show_part(part, cls, as_json)
        return
    prepared = prepare(cls, settings or ())
    compiled, flat, failure = None, None, None
    try:
        compiled = compile(prepared.model, parameters=prepared.parameters)
        flat = compiled.flat
    except AcausalError as error:
        failure = error
        # list the parameters nevertheless: one without a value may be the reason
        try:
            flat = flatten(prepared.model, prepared.parameters)
        except AcausalError:
            flat = None
    content: dict[str, Any] = {
        "model": cls.__name__,
        "reference": model,
        "source": place(_source(cls)),
        "doc": inspect.cleandoc(cls.__doc__ or ""),
        "experiment": dict(vars(cls.experiment)),
        "structural": _structural(prepared.model),
        "parameters": _parameters(flat) if flat else _declared_parameters(prepared.model),
        "states": _states(compiled) if compiled else [],
        "inputs": _signals(prepared.model, Kind.INPUT),
        "outputs": _signals(prepared.model, Kind.OUTPUT),
    }
    if failure is not None:
        content["error"] = {"code": failure.code, "fact": failure.fact}
    if stats and compiled:
        from acausal.lower.report import stage_counts, structure_report

        content["stats"] = stage_counts(compiled)
        content["timings"] = dict(compiled.timings)
        content["structure"] = _structure(structure_report(compiled))
    files = []
    if spy is not None and compiled:
        from acausal.plot import structure as plot_structure

        plot_structure.spy(compiled, spy)
        files.append(str(spy))
    if as_json:
        record({**content, "files": files})
    else:
        _print(content)
    for file in () if quiet or as_json else files:
        remark(f"wrote {file}")
    if failure is not None:
        remark(f"this model does not compile: error[{failure.code}] {failure.fact}; see: acausal check {model}")
        raise typer.Exit(exit_code(failure))


def _refuse_for_part(name: str, options: dict[str, object]) -> None:
    """Raise UsageError (AC009) if an option is given that a component of the library has no answer to."""
    for flag, given in options.items():
        if given:
            fact = f"{flag} needs a model, and {name} is a component of the library"
            raise UsageError("AC009", fact, help=f"put it into a model, or leave {flag} out")


def _source(cls: type[Component]) -> Span | None:
    try:
        return Span(inspect.getsourcefile(cls) or "", inspect.getsourcelines(cls)[1])
    except (OSError, TypeError):
        return None


def _structural(model: Component) -> list[dict[str, Any]]:
    return [
        {"name": name, "value": getattr(model, name), "doc": d.doc}
        for name, d in model._declarations.items()
        if d.kind is Kind.STRUCTURAL
    ]


def _described(path: str, d: Declaration) -> dict[str, Any]:
    return {"path": path, "unit": d.unit, "min": d.min, "max": d.max, "doc": d.doc}


def _parameters(flat: FlatSystem) -> list[dict[str, Any]]:
    return [{**_described(p.path, p.declaration), **_value(flat, p)} for p in flat.parameters]


def _value(flat: FlatSystem, p: FlatParameter) -> dict[str, Any]:
    """Values of all entries, and the expression if the model computes the parameter from others."""
    from acausal.flatten.flat import suffixes
    from acausal.flatten.text import to_text
    from acausal.numeric.evaluate import values

    leaves = {"par": flat.parameter_values.__getitem__, "time": lambda _: 0.0}
    known = values(flat.pool, p.nodes, leaves)
    # adding zero turns -0.0 into 0.0
    numbers = [float(known[n]) + 0.0 for n in p.nodes]
    texts = [to_text(flat.pool, n, flat_names(flat), 60) for n in p.nodes]
    names = [p.path + s for s in suffixes(p.declaration.shape)]
    bound = "" if texts == names else texts[0] if len(texts) == 1 else f"({', '.join(texts)})"
    return {"value": numbers[0] if not p.declaration.shape else numbers, "bound_to": bound}


def _declared_parameters(model: Component) -> list[dict[str, Any]]:
    """Parameters from the declarations alone, for a model that cannot be flattened."""
    found = []
    for instance in instances(model):
        for name, d in instance.component._declarations.items():
            if d.kind is Kind.PARAMETER:
                value = instance.component.__dict__["_values"].get(name)
                number = None if value is None or value.op != "const" else value.payload
                bound = str(value) if value is not None and value.op != "const" else ""
                found.append({**_described(instance.prefix + name, d), "value": number, "bound_to": bound})
    return found


def _states(compiled: CompiledModel) -> list[dict[str, Any]]:
    reduced = compiled.solution.structure.reduced
    return [
        {"path": reduced.name(v), "unit": unit_of(reduced, v), "doc": _doc(reduced, v)}
        for v in compiled.state_variables
    ]


def _doc(reduced: ReducedSystem, variable: int) -> str:
    return reduced.flat.declaration(reduced.scalar[variable]).doc if variable < len(reduced.scalar) else ""


def _signals(model: Component, kind: Kind) -> list[dict[str, Any]]:
    return [{"path": n, "unit": d.unit, "doc": d.doc} for n, d in model._declarations.items() if d.kind is kind]


def _structure(report: StructureReport) -> dict[str, Any]:
    """The content of a report besides the counts of the stages."""
    return {
        "blocks": [vars(b) for b in report.blocks],
        "states": [vars(s) for s in report.states],
        "eliminated": dict(report.eliminated),
        "differentiated": dict(report.differentiated),
    }


def _print(content: Mapping[str, Any]) -> None:
    say(f"{content['model']}   {content['source']}")
    if content["doc"]:
        say()
        for line in content["doc"].split("\n"):
            say(f"    {line}".rstrip())
    run = content["experiment"]
    interval = run["output_interval"] or (run["stop_time"] - run["start_time"]) / 500
    step = f", step {run['step']:g} s" if run["step"] else ""
    _head("Run")
    say(
        f"  {run['start_time']:g} ... {run['stop_time']:g} s, output every {interval:g} s, "
        f"tolerance {run['tolerance']:g}, solver {run['solver']}{step}"
    )
    if content["structural"]:
        _head("Structural arguments")
        table([(s["name"], _shortened(repr(s["value"])), s["doc"]) for s in content["structural"]], indent="  ")
    if content["parameters"]:
        _head("Parameters")
        table([_row(p) for p in content["parameters"]], ("path", "value", "unit", "limits", "meaning"), indent="  ")
    for title in ("states", "inputs", "outputs"):
        if content[title]:
            _head(f"{title.capitalize()} ({len(content[title])})")
            table([(s["path"], s["unit"] or "1", s["doc"]) for s in content[title]], indent="  ")
    if "stats" in content:
        _head("Stages")
        for stage, counts in content["stats"].items():
            shown = ", ".join(f"{v} {k}" for k, v in counts.items())
            say(f"  {stage:8} {seconds(content['timings'].get(stage, 0.0)):>9}   {shown}")
        _print_structure(content["structure"])


def _print_structure(structure: Mapping[str, Any]) -> None:
    _head("Eliminated")
    say("  " + ", ".join(f"{n} as {how}" for how, n in structure["eliminated"].items()))
    if structure["differentiated"]:
        _head("Differentiated")
        for order, n in structure["differentiated"].items():
            say(f"  {counted(n, 'equation')} {counted(order, 'time')}")
    _head("Blocks")
    table([_block_row(b) for b in structure["blocks"][:_MOST_BLOCKS]], indent="  ")
    if len(structure["blocks"]) > _MOST_BLOCKS:
        say(f"  and {len(structure['blocks']) - _MOST_BLOCKS} more sizes")
    _head("States, and the reasons for their choice")
    reasons: dict[str, list[str]] = {}
    for state in structure["states"]:
        reasons.setdefault(state["why"], []).append(state["name"])
    for why, names in reasons.items():
        say(f"  {len(names)} {why}: {_shortened(', '.join(names), 100)}")


def _block_row(b: Mapping[str, Any]) -> tuple[str, ...]:
    unknowns = counted(b["size"], "unknown")
    left = f"{b['iterated']} left to the solver" if b["iterated"] else ""
    return str(b["count"]), f"{b['kind']} of {unknowns}", left


def _head(title: str) -> None:
    say()
    say(title)


def _row(p: Mapping[str, Any]) -> tuple[str, ...]:
    value = p["value"]
    if value is None:
        shown = "missing" if not p["bound_to"] else ""
    elif isinstance(value, list | tuple):
        shown = f"({', '.join(f'{v:.6g}' for v in value)})"
    else:
        shown = quantity(value, "")
    bound = f"= {_shortened(p['bound_to'])}" if p["bound_to"] else ""
    return p["path"], f"{shown} {bound}".strip(), p["unit"] or "1", _limits(p["min"], p["max"]), p["doc"]


def _limits(low: float, high: float) -> str:
    if math.isinf(low) and math.isinf(high):
        return ""
    if math.isinf(high):
        return f">= {low:g}"
    return f"<= {high:g}" if math.isinf(low) else f"{low:g} ... {high:g}"


def _shortened(text: str, limit: int = 60) -> str:
    return text if len(text) <= limit else text[: limit - 4] + " ..."
