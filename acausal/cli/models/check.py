"""`acausal check`: whether a model is well posed, and its start values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from acausal.cli.arguments import options
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import prepare
from acausal.cli.models.names import unit_of
from acausal.cli.output.report import place, quantity, record, say, table
from acausal.errors import counted

if TYPE_CHECKING:
    from acausal.lower.compiled import CompiledModel
    from acausal.simulate.start.initialize import Start


def check(
    model: options.Model, settings: options.Set = None, as_json: options.Json = False, quiet: options.Quiet = False
) -> None:
    """Compile a model and solve for its start values without a run; with --quiet only the exit code reports the result.

    Example: acausal check oscillator.py
    """
    from acausal.lower.compile import compile

    prepared = prepare(find_model(model), settings or ())
    compiled = compile(prepared.model, parameters=prepared.parameters)
    start = start_values(compiled)
    structure = compiled.solution.structure
    flat = compiled.flat
    content: dict[str, Any] = {
        "model": compiled.name,
        "equations": len(flat.equations),
        "unknowns": flat.n_scalars - len(flat.inputs),
        "redundant": len(structure.reduced.redundant),
        "differentiated": len(structure.integral),
        "stabilised": len(structure.invariants),
        "states": len(compiled.continuous),
        "discrete": compiled.discretes,
        "algebraic": len(compiled.algebraic),
        "inputs": list(compiled.inputs),
        "start": _conditions(compiled, start),
        "notes": [*flat.notes, *start.notes, *_input_notes(compiled)],
    }
    if as_json:
        record(content)
    elif not quiet:
        _print(content, compiled.algebraic)


def _print(content: dict[str, Any], iterated: Sequence[str]) -> None:
    say(
        f"{content['model']}: {counted(content['equations'], 'equation')}, {counted(content['unknowns'], 'unknown')}, "
        f"{counted(content['states'], 'state')}"
        + (f", {counted(content['discrete'], 'discrete variable')}" if content["discrete"] else "")
    )
    if content["redundant"]:
        say(f"  {counted(content['redundant'], 'equation')} following from others")
    if content["differentiated"]:
        say(f"  {counted(content['differentiated'], 'equation')} differentiated: constraints among the states")
    if content["stabilised"]:
        say(f"  {counted(content['stabilised'], 'constraint')} stabilised: no fixed choice of states is valid")
    if content["algebraic"]:
        say(f"  {counted(content['algebraic'], 'unknown')} iterated: {', '.join(iterated[:6])}")
    if content["start"]:
        say("start")
        table([(s["path"], quantity(s["value"], s["unit"]), s["why"]) for s in content["start"]], indent="  ")
    for note in content["notes"]:
        say(f"note: {note}")
    say("ok")


def start_values(compiled: CompiledModel) -> Start:
    """Consistent values at the start of the model's experiment; its inputs have their defaults."""
    import numpy as np

    from acausal.simulate.options import declared_input, parameter_vector
    from acausal.simulate.start.initialize import initialize

    experiment = compiled.flat.experiment
    t = experiment.start_time
    p = parameter_vector(compiled, {})
    later = [x for x in np.array(compiled.instants(p)).ravel().tolist() if x > t]
    # time events exactly at the start have already happened
    modes = np.array(compiled.modes(0.5 * (t + min([*later, experiment.stop_time])), p)).ravel()
    u = np.array([declared_input(compiled, scalar) for scalar in compiled.flat.inputs])
    return initialize(compiled, t, p, u, modes)


def _conditions(compiled: CompiledModel, start: Start) -> list[dict[str, Any]]:
    """The value of each state at the start, and the reason for it."""
    reduced = compiled.solution.structure.reduced
    found = []
    for k, v in enumerate(compiled.state_variables):
        declared = [s for a in reduced.aliases.get(v, ()) if (s := reduced.flat.starts.get(a)) is not None]
        where = next((s.origin for s in declared if s.origin is not None), None)
        if v in compiled.start.direct:
            why = "given" + (f" at {place(where.span())}" if where is not None else "")
        elif v in compiled.start.defaulted:
            why = "its guess: no condition determines it" if declared else "0: no condition determines it"
        else:
            why = "solved from " + ("; ".join(c.text for c in compiled.start.conditions[:3]) or "the other conditions")
        found.append({"path": reduced.name(v), "value": float(start.x[k]), "unit": unit_of(reduced, v), "why": why})
    return found


def _input_notes(compiled: CompiledModel) -> list[str]:
    if not compiled.inputs:
        return []
    return [f"{counted(len(compiled.inputs), 'input')} with the default here, or 0: {', '.join(compiled.inputs[:6])}"]
