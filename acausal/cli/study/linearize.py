"""`acausal linearize`: the linear state space of a model, at its start or at a time of a run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

from acausal.cli.arguments import options
from acausal.cli.arguments.inputs import declarations, declared_as, numbers_of
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import listed, prepare, seconds_of
from acausal.cli.output.report import quantity, record, remark, say, table
from acausal.errors import UsageError, counted

if TYPE_CHECKING:
    from acausal.export.linearize import Linearization
    from acausal.language.component import Component

_MOST_COLUMNS = 12


def linearize(
    model: options.Model,
    settings: options.Set = None,
    at: Annotated[str | None, options.option("--at", "Time of a run, in s or with a unit.", metavar="TIME")] = None,
    states: Annotated[
        list[str] | None,
        options.option("--state", "Value of a state, with or without unit; repeatable.", metavar="NAME=VALUE"),
    ] = None,
    inputs: options.Inputs = None,
    freed: options.Free = None,
    outputs: options.Outputs = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Linearise a model: x' = A x + B u, y = C x + D u, in deviations from a point, with the eigenvalues of A.

    Without --at the point is the start; with it the model is simulated up to that time first.

    Example: acausal linearize Pendulum --at 0.5
    """
    prepared = prepare(find_model(model), settings or (), freed or ())
    time = seconds_of("at", at)
    x, u = (numbers_of(f, prepared.model, texts) for f, texts in (("--state", states), ("--input", inputs)))
    from acausal.export.linearize import linearize as linearized
    from acausal.lower.compile import compile
    from acausal.simulate.run import simulate

    compiled = compile(prepared.model, parameters=prepared.parameters)
    start = compiled.flat.experiment.start_time
    if time is not None and time < start:
        raise UsageError("AC011", f"--at {time:g} s is before the start of the run at {start:g} s")
    result = None
    if time is not None and time > start:
        result = simulate(compiled, stop_time=time, inputs=u)
    found = linearized(compiled, time, x, result=result, inputs=u, outputs=listed(outputs) or None)
    if as_json:
        record(_content(found))
    else:
        _print(found, prepared.model)
    for note in () if quiet or as_json else found.notes:
        remark(f"note: {note}")


def _content(found: Linearization) -> dict[str, Any]:
    return {
        "model": found.name,
        "time": found.t,
        **{name: getattr(found, name) for name in ("states", "inputs", "outputs", *"ABCDxuy", "rates")},
        "eigenvalues": [_mode(complex(e)) for e in found.eigenvalues],
        "notes": list(found.notes),
    }


def _mode(e: complex) -> dict[str, float]:
    """An eigenvalue with its frequency [Hz] and damping ratio, which is 1 for an eigenvalue of zero."""
    size = abs(e)
    return {
        "real": e.real,
        "imag": e.imag,
        "frequency": size / (2.0 * math.pi),
        "damping": 0.0 - e.real / size if size else 1.0,  # no "-0"
    }


def _print(found: Linearization, model: Component) -> None:
    sizes = (counted(len(found.states), "state"), counted(len(found.inputs), "input"))
    say(f"{found.name}: {', '.join(sizes)}, {counted(len(found.outputs), 'output')} at t = {found.t:g} s")
    if found.states:
        say("point")
        declared = declarations(model)
        units = [d.unit if (d := declared_as(declared, name)) is not None else "" for name in found.states]
        rows = [
            (n, quantity(v + 0.0, unit), quantity(r + 0.0, _per_second(unit)))  # no "-0"
            for n, v, r, unit in zip(found.states, found.x.tolist(), found.rates.tolist(), units, strict=True)
        ]
        table(rows, ("state", "value", "rate"), indent="  ")
        say("eigenvalues of A")
        modes = [_mode(complex(e)) for e in found.eigenvalues]
        table([_mode_row(m) for m in modes if m["imag"] >= 0.0], ("1/s", "frequency", "damping"), indent="  ")
    for name in "ABCD":
        matrix = getattr(found, name)
        if matrix.size and matrix.shape[1] <= _MOST_COLUMNS:
            say(name)
            table([[f"{v + 0.0:.6g}" for v in row] for row in matrix.tolist()], indent="  ")
        elif matrix.size:
            say(f"{name}   {matrix.shape[0]} x {matrix.shape[1]}: --json prints it")


def _per_second(unit: str) -> str:
    """The unit of a rate."""
    if unit.endswith("/s"):
        return f"{unit}2"
    return f"({unit})/s" if "/" in unit else f"{unit or '1'}/s"


def _mode_row(m: dict[str, float]) -> tuple[str, str, str]:
    number = f"{m['real']:.6g}" + (f" +- {m['imag']:.6g}i" if m["imag"] else "")
    return number, f"{m['frequency']:.6g} Hz", f"{m['damping']:.4g}"
