"""`acausal sweep`: many runs of one model, one table, families of curves."""

from __future__ import annotations

import io
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import redirect_stderr
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.inputs import declarations, declared_as, inputs_of, numbers_of
from acausal.cli.arguments.outputs import check_picture, check_writable
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import as_usage, difference_in, listed, number_in, prepare, refuse_mixed, seconds_of
from acausal.cli.output.report import quantity, record, remark, say, seconds, table
from acausal.cli.run.progress import ProgressBar
from acausal.errors import UsageError, counted
from acausal.language.component import Component
from acausal.language.declarations.declaration import Declaration

if TYPE_CHECKING:
    from acausal.study.sweep.family import Progress, Sweep


# Seconds between two lines of progress without a terminal.
_PAUSE = 10.0
_MOST_LINES = 12


VaryOption = Annotated[
    list[str] | None,
    options.option(
        "--vary",
        "LOW:HIGH:COUNT, log:LOW:HIGH:COUNT, A,B,C or normal:MEAN:DEVIATION, units allowed; repeatable.",
        metavar="PATH=VALUES",
    ),
]
SampleOption = Annotated[
    str | None,
    options.option(
        "--sample", "N draws instead of the grid of all combinations: sobol, halton, lhs, random.", metavar="KIND:N"
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", help="Seed of the random draws.")]
WorkersOption = Annotated[
    int | None, options.option("--workers", "Number of workers. Default: one for each core.", metavar="N")
]
ExecutorOption = Annotated[
    str, typer.Option("--executor", help="processes, threads, dask://HOST:PORT, or dask:// for a local cluster.")
]
ResumeOption = Annotated[
    bool, typer.Option("--resume", help="Run only the members that are missing in the .sweep file.")
]
MembersOption = Annotated[Path | None, options.output_file("File of the finished members. Default: MODEL.sweep.")]
TableOption = Annotated[Path | None, options.option("--table", "One table: .parquet, .nc or .csv.")]


def sweep(
    model: options.Model,
    vary: VaryOption = None,
    sample: SampleOption = None,
    seed: SeedOption = 0,
    signals: options.Signals = None,
    settings: options.Set = None,
    start_time: options.StartTime = None,
    stop_time: options.StopTime = None,
    output_interval: options.OutputInterval = None,
    tolerance: options.Tolerance = None,
    solver: options.Solver = None,
    step: options.Step = None,
    native: options.Native = None,
    inputs: options.Inputs = None,
    interpolation: options.Interpolation = "linear",
    freed: options.Free = None,
    start: options.Start = None,
    workers: WorkersOption = None,
    executor: ExecutorOption = "processes",
    resume: ResumeOption = False,
    output_file: MembersOption = None,
    table_file: TableOption = None,
    plot: options.Plot = False,
    plot_file: options.PlotFile = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Run a model with many values of its parameters.

    Each member goes to the .sweep file when it is done, with its error if it failed; --resume continues after a kill.

    Example: acausal sweep ThinPlate --vary v=1mm/s:2mm/s:20 --signals drill.F_f --plot
    """
    cls = find_model(model)
    prepared = prepare(cls, settings or (), freed or ())
    file = output_file or Path(f"{cls.__name__}.sweep")
    picture = plot_file or (Path(f"{cls.__name__}.png") if plot else None)
    _check_files(file, table_file, picture)
    from acausal.study.sweep.sweep import sweep as made_by

    chatter, shown = io.StringIO(), _ShownProgress(cls.__name__, quiet)
    try:
        with shown.bar, redirect_stderr(chatter):
            found = made_by(
                prepared.model,
                variations_of(prepared.model, vary),
                sample=sample,
                seed=seed,
                signals=listed(signals) or None,
                parameters=prepared.parameters,
                workers=workers,
                executor=executor,
                file=file,
                resume=resume,
                progress=shown,
                start_time=seconds_of("start_time", start_time),
                stop_time=seconds_of("stop_time", stop_time),
                output_interval=seconds_of("output_interval", output_interval),
                step=seconds_of("step", step),
                tolerance=tolerance,
                solver=solver,
                native=native,
                inputs=inputs_of(prepared.model, inputs, interpolation),
                start=numbers_of("--start", prepared.model, start),
            )
    except KeyboardInterrupt:
        if (last := shown.last) is not None:
            remark(f"saved {last.done} of {counted(last.total, 'member')} in {file}: --resume continues it")
        raise
    written = [file]
    if table_file is not None:
        found.save(table_file)
        written.append(table_file)
    if picture is not None and "ok" in found.status:
        found.plot(file=picture)
        written.append(picture)
    _tell(found, shown.last, written, as_json, quiet)
    if "ok" not in found.status:
        raise typer.Exit(1)


def _tell(found: Sweep, last: Progress | None, written: Sequence[Path], as_json: bool, quiet: bool) -> None:
    if as_json:
        record({**_content(found), "files": [str(path) for path in written]})
        return
    if not quiet:
        _summary(found, last)
    for code, count in Counter(found.codes[k] for k in found.failed).most_common(_MOST_LINES):
        first = found.codes.index(code)
        remark(f"failed: {counted(count, 'member')} with {code}, the first is {first}: {found.messages[first]}")
    if not quiet:
        for note, count in Counter(n for notes in found.notes for n in notes).most_common(_MOST_LINES):
            remark(f"note: {note} ({counted(count, 'member')})")
        for path in written:
            remark(f"wrote {path}")


def _check_files(file: Path, table_file: Path | None, picture: Path | None) -> None:
    from acausal.study.sweep.tables import check_table

    if file.suffix != ".sweep":
        raise UsageError("AC013", f"the suffix of {file} is not .sweep", help="--table writes .parquet, .nc and .csv")
    if not file.exists():
        check_writable(file)
    if table_file is not None:
        check_table(table_file)
        check_writable(table_file)
    if picture is not None:
        check_picture(picture)


class _ShownProgress:
    """Progress: a bar on a terminal, otherwise a line from time to time."""

    def __init__(self, label: str, quiet: bool) -> None:
        self.bar = ProgressBar(label, quiet)
        self.last: Progress | None = None
        self._lines = not quiet and not sys.stderr.isatty()
        self._stream, self._last_line = sys.stderr, time.perf_counter()

    def __call__(self, progress: Progress) -> None:
        self.last = progress
        failed = f", {progress.failed} failed" if progress.failed else ""
        text = f"{progress.done} of {progress.total}{failed}"
        self.bar.show(progress.done / progress.total, text)
        if self._lines and time.perf_counter() - self._last_line > _PAUSE:
            self._last_line = time.perf_counter()
            print(f"{text}, {seconds(progress.remaining)} to go", file=self._stream, flush=True)


def _summary(found: Sweep, last: Progress | None) -> None:
    import numpy as np

    ok = np.array([status == "ok" for status in found.status])
    say(f"{found.model}: {counted(len(found), 'member')}, {int(ok.sum())} finished")
    for k, varied in enumerate(found.parameters):
        low, high = found.values[:, k].min(), found.values[:, k].max()
        say(f"  varied   {varied.name}: {quantity(low, varied.unit)} ... {quantity(high, varied.unit)}")
    if last is not None and ok.any():
        say(f"  time     {seconds(last.elapsed)}, {seconds(float(np.nanmedian(found.seconds[ok])))} a run")
    if ok.any():
        say("final values")
        rows = []
        for s in found.signals[:_MOST_LINES]:
            values = found.final(s.name)[ok]
            rows.append((s.name, *(quantity(float(v), s.unit) for v in np.quantile(values, [0.0, 0.5, 1.0]))))
        table(rows, ("", "smallest", "median", "largest"), indent="  ")


def _content(found: Sweep) -> dict[str, object]:
    """Everything but the rows over time, for JSON."""
    return {
        "model": found.model,
        "parameters": {s.name: {"unit": s.unit, "values": found.values[:, k]} for k, s in enumerate(found.parameters)},
        "status": found.status,
        "codes": found.codes,
        "messages": found.messages,
        "final": {s.name: {"unit": s.unit, "values": found.finals[:, k]} for k, s in enumerate(found.signals)},
        "stop_times": found.stop_times,
        "seconds": found.seconds,
    }


_FORMS = "PATH=LOW:HIGH:COUNT, PATH=log:LOW:HIGH:COUNT, PATH=A,B,C or PATH=normal:MEAN:DEVIATION"


def variations_of(model: Component, texts: Sequence[str] | None) -> dict[str, Any]:
    """Variations by path in SI, for `acausal.sweep`, from texts PATH=VALUES.

    Raises UsageError: AC009 for invalid texts, AC060 for invalid ranges, AC150 to AC152 for units.
    """
    declared = declarations(model)
    found: dict[str, Any] = {}
    for text in texts or ():
        name, sign, values = (part.strip() for part in text.partition("="))
        if not sign or not name or not values:
            raise _unreadable(text)
        if name in found:
            raise UsageError("AC009", f"--vary {name} is given twice")
        found[name] = _variation(text, values, declared_as(declared, name))
    if not found:
        raise UsageError("AC060", "nothing is varied", help=f"--vary {_FORMS}")
    return found


def _variation(text: str, values: str, declared: Declaration | None) -> Any:
    from acausal.study.sweep.vary import Range  # loads NumPy

    def numbers(parts: Sequence[str]) -> list[float]:
        found = [number_in("--vary", text, part.strip(), declared) for part in parts]
        refuse_mixed(f"--vary {text}", parts, declared.unit if declared is not None else "")
        return found

    kind, _, rest = values.partition(":")
    if kind == "normal":
        from scipy.stats import norm

        parts = rest.split(":")
        if len(parts) != 2:
            raise _unreadable(text)
        mean, _ = numbers(parts)
        return norm(mean, difference_in("--vary", text, parts[1].strip(), declared))
    is_log = kind == "log"
    parts = (rest if is_log else values).split(":")
    if len(parts) in (2, 3):
        if len(parts) == 3 and not parts[2].strip().isdecimal():
            raise _unreadable(text)
        count = int(parts[2]) if len(parts) == 3 else None
        ends = numbers(parts[:2])
        return as_usage(f"--vary {text}", Range, *ends, count, is_log)
    if len(parts) > 3 or is_log:
        raise _unreadable(text)
    return numbers(values.split(","))


def _unreadable(text: str) -> UsageError:
    return UsageError("AC009", f"--vary {text}: invalid variation", help=f"write {_FORMS}")
