"""`acausal fit`: parameters of a model from measurements."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.inputs import declarations, declared_as, inputs_of, numbers_of
from acausal.cli.arguments.outputs import check_picture
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import difference_in, number_in, prepare, values_of
from acausal.cli.output.report import record, remark, say, table
from acausal.errors import UsageError, counted
from acausal.language.declarations.declaration import Declaration

if TYPE_CHECKING:
    from acausal.study.fit.fit import Fit

# Attributes of a fit that the JSON output has unchanged.
_ATTRIBUTES = ("correlation", "covariance", "rms", "noise", "rows", "runs", "gradients", "notes")


def fit(
    model: options.Model,
    data: Annotated[
        list[Path],
        typer.Argument(
            metavar="DATA...", help="Measurements: .csv with units in its first row, .mat, .npz or .parquet."
        ),
    ],
    free: Annotated[
        list[str],
        typer.Option(
            "--free",
            metavar="PATH,...",
            help="Parameters to find; PATH=LOW:HIGH limits one, with units. Repeatable.",
        ),
    ],
    settings: options.Set = None,
    inputs: options.Inputs = None,
    interpolation: options.Interpolation = "linear",
    start: options.Start = None,
    sigma: Annotated[
        list[str] | None,
        typer.Option(
            "--sigma",
            metavar="SIGNAL=VALUE",
            help="Standard deviation of the noise of a signal, units allowed. Default: estimated.",
        ),
    ] = None,
    tolerance: options.Tolerance = None,
    solver: options.Solver = None,
    native: options.Native = None,
    plot: options.Plot = False,
    plot_file: options.PlotFile = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Fit parameters to measurements, with 95 % confidence intervals.

    A column of DATA with the name of an input drives the model; one with the name of a variable is compared with it.
    Each file is an experiment. The search begins at the model's values, or those of --set.

    Example: acausal fit Oscillator swing.csv --free c,d --plot-file fit.png
    """
    twice = next((file for k, file in enumerate(data) if file in data[:k]), None)
    if twice is not None:
        raise UsageError(
            "AC009", f"{twice} is given twice", help="it would count as two experiments, with intervals too narrow"
        )
    cls = find_model(model)
    picture = plot_file or (Path(f"{cls.__name__}.png") if plot else None)
    if picture is not None:
        check_picture(picture)
    prepared = prepare(cls, settings or ())
    from acausal.study.fit.dataset import Dataset
    from acausal.study.fit.fit import fit as fitted

    declared = declarations(prepared.model)
    noise = _noise(sigma, declared)
    found = fitted(
        prepared.model,
        [Dataset(str(file), sigma=noise, name=file.name) for file in data],
        _limits(free, declared),
        parameters=prepared.parameters,
        inputs=inputs_of(prepared.model, inputs, interpolation),
        start=numbers_of("--start", prepared.model, start),
        tolerance=tolerance,
        solver=solver,
        native=native,
        progress=None if quiet or as_json else remark,
    )
    if picture is not None:
        found.plot(str(picture))
    if as_json:
        record({**_content(found), "files": [] if picture is None else [str(picture)]})
        return
    _print(found)
    if not quiet:
        kept = [text for text in settings or () if text.partition("=")[0].strip() not in found.names]
        _remark(found, model, {"--set": kept, "--input": inputs or (), "--start": start or ()})
        if picture is not None:
            remark(f"wrote {picture}")


def _noise(texts: Sequence[str] | None, declared: Mapping[str, Declaration]) -> dict[str, float]:
    return {
        name: difference_in("--sigma", f"{name}={value}", value, declared_as(declared, name))
        for name, value in values_of("--sigma", texts).items()
    }


def _limits(texts: Sequence[str], declared: Mapping[str, Declaration]) -> dict[str, tuple[float, float]]:
    found: dict[str, tuple[float, float]] = {}
    for part in (p.strip() for text in texts for p in text.split(",")):
        name, sign, limits = (p.strip() for p in part.partition("="))
        low, colon, high = limits.partition(":")
        if not name or bool(sign) != bool(colon) or ":" in high:
            raise UsageError("AC009", f"--free {part}: write PATH or PATH=LOW:HIGH, with commas between")
        if name in found:
            raise UsageError("AC009", f"--free names {name} twice")
        own = declared_as(declared, name)
        found[name] = (_limit(part, low or "-inf", own), _limit(part, high or "inf", own))
    return found


def _limit(part: str, text: str, declared: Declaration | None) -> float:
    return float(text) if text in {"-inf", "inf"} else number_in("--free", part, text, declared)


def _content(found: Fit) -> dict[str, Any]:
    return {
        "model": found.model,
        "parameters": [
            {"name": n, "unit": u, "guess": g, "value": v, "std": s, "low": low, "high": high}
            for n, u, g, v, s, (low, high) in zip(
                found.names, found.units, found.guess, found.value, found.std, found.interval, strict=True
            )
        ],
        **{name: getattr(found, name) for name in _ATTRIBUTES},
    }


def _remark(found: Fit, model: str, flags: Mapping[str, Sequence[str]]) -> None:
    """Print the notes, and the command of a run of the model with these flags and the estimates."""
    for note in found.notes:
        remark(f"note: {note}")
    words = [model, *(word for flag, texts in flags.items() for text in texts for word in (flag, text))]
    words += [word for n, v in found.parameters.items() for word in ("--set", f"{n}={v:.9g}")]
    remark(f"run it: acausal simulate {shlex.join(words)}")


def _print(found: Fit) -> None:
    sizes = (
        counted(len(found.names), "parameter"),
        f"{counted(found.rows, 'value')} of {counted(len(found.rms), 'signal')}",
        f"{counted(found.runs, 'run')}, {found.gradients} differentiated",
    )
    say(f"{found.model}: {', '.join(sizes)}")
    rows = [
        (n, f"{g:.6g}", f"{v:.6g}", f"{low:.6g} ... {high:.6g}", u)
        for n, g, v, (low, high), u in zip(
            found.names, found.guess, found.value, found.interval.tolist(), found.units, strict=True
        )
    ]
    table(rows, ("parameter", "guess", "found", "95 % interval", "unit"), indent="  ")
    units = {n: found.results[0].unit(n) for n in found.rms}
    residuals = [(n, f"{r:.4g}", units[n]) for n, r in found.rms.items()]
    table(residuals, ("signal", "rms residual", "unit"), indent="  ")
    if len(found.names) > 1:
        entries = [
            (f"{a} ~ {b}", f"{found.correlation[i, k]:.3f}")
            for i, a in enumerate(found.names)
            for k, b in enumerate(found.names)
            if i < k
        ]
        table(entries, ("correlation",), indent="  ")
