"""`acausal compare`: the differences of two results, signal by signal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.outputs import check_picture
from acausal.cli.arguments.settings import listed
from acausal.cli.output.failure import OUT_OF_TOLERANCE
from acausal.cli.output.report import record, remark, say, table
from acausal.errors import UnitError, UsageError, counted

if TYPE_CHECKING:
    from acausal.plot.scale import Scale
    from acausal.result.result import Result
    from acausal.result.signals import Array


# Maximum number of signals in the plot.
_MOST_DRAWN = 5


@dataclass(frozen=True)
class Deviation:
    """The difference of one signal, in the unit of the first result."""

    name: str
    # `absolute`, `relative`, `time`: the largest difference, the same as a fraction of the range of the signal in the
    # first result, and its time [s].
    absolute: float
    relative: float
    time: float
    rms: float = 0.0  # root of the mean square of the differences
    unit: str = ""


def compare(
    first: Annotated[
        Path, typer.Argument(metavar="A", help="The reference, or measurements: a .mat, .csv, .npz or .parquet file.")
    ],
    second: Annotated[Path, typer.Argument(metavar="B", help="The result to compare with it.")],
    tolerance: Annotated[
        float, typer.Option("--tolerance", help="Accepted deviation relative to the range of a signal.")
    ] = 1e-4,
    floor: Annotated[
        float,
        typer.Option(
            "--floor", help="Smallest range to divide by, so that rounding errors of a constant do not count."
        ),
    ] = 1e-9,
    signals: options.Signals = None,
    count: Annotated[
        int, typer.Option("--count", help="Number of signals to list, the largest differences first.")
    ] = 10,
    plot: Annotated[bool, typer.Option("--plot", help="Draw the signals that differ most, to B.png.")] = False,
    plot_file: options.PlotFile = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Compare two result files, or a result with measurements; exits with 3 if out of tolerance.

    Values are compared at the times of the file with fewer rows. At an event of one of them, where a rounding error in
    time would show as a jump, the value before it counts as well as the one after it. Units are converted. A result
    that covers less than the reference, or lacks one of its signals, is out of tolerance; one that has more is not.

    Examples: acausal compare old.mat new.mat --signals "mass.*" --tolerance 1e-6; acausal compare measured.csv run.mat
    --plot
    """
    from acausal.result.result import load

    _check_positive("--tolerance", tolerance)
    _check_positive("--floor", floor)
    a, b = load(first), load(second)
    picture = plot_file or (second.with_suffix(".png") if plot else None)
    if picture is not None:
        check_picture(picture)
    found = deviations(a, b, listed(signals), floor)
    if picture is not None:
        from acausal.plot.compare import compared

        compared(a, b, [d.name for d in found[: min(count, _MOST_DRAWN)]], picture)
    bad = [d for d in found if not d.relative <= tolerance]
    low, high = _overlap(a, b)
    short, instants = is_shorter(a, b), len(_times(a, b))
    missing = [] if signals else [name for name in a.names if name not in b.signals]
    is_within = not (bad or short or missing)
    if as_json:
        record(
            {
                "first": str(first),
                "second": str(second),
                "tolerance": tolerance,
                "from": low,
                "to": high,
                "instants": instants,
                "covers_first": not short,
                "common": len(found),
                "only_in_first": sorted(set(a.names) - set(b.names)),
                "only_in_second": sorted(set(b.names) - set(a.names)),
                "deviations": [vars(d) for d in found],
                "within_tolerance": is_within,
                "files": [str(picture)] if picture is not None else [],
            }
        )
    elif not quiet:
        _listed(found[:count])
        verdict = f"{counted(len(bad), 'signal')} out of tolerance" if bad else "all within"
        say(
            f"{counted(len(found), 'common signal')}, {len(set(a.names) ^ set(b.names))} in one file only, compared at "
            f"{counted(instants, 'instant')} of {low:g} ... {high:g} s: {verdict} {tolerance:g}"
        )
        _say_lacks(a, b, first.name, second.name, missing)
        if picture is not None:
            remark(f"wrote {picture}")
    if not is_within:
        raise typer.Exit(OUT_OF_TOLERANCE)


def _say_lacks(a: Result, b: Result, first: str, second: str, missing: list[str]) -> None:
    """Say which times and which signals of the first result the second one lacks."""
    if is_shorter(a, b):
        covered, required = (f"{r.time[0]:g} ... {r.time[-1]:g} s of" for r in (b, a))
        say(f"{second} covers {covered} the {required} {first}: out of tolerance")
    if missing:
        from acausal.diagnose import words

        say(f"{second} lacks {words.listed(missing)} of {first}: out of tolerance; choose by --signals")


def _check_positive(flag: str, number: float) -> None:
    if not 0.0 < number < math.inf:
        raise UsageError("AC009", f"{flag} {number:g}: not a positive number", help=f"{flag} 1e-9")


def _listed(found: list[Deviation]) -> None:
    rows = [
        (d.name, f"{d.relative:.3g}", f"{d.absolute:.3g}", f"{d.time:.6g} s", f"{d.rms:.3g}", d.unit) for d in found
    ]
    table(rows, ("signal", "of its range", "absolute", "at", "rms", "unit"))
    for d in found:
        if d.absolute == math.inf:
            say(f"{d.name} is not a number in one of the files at {d.time:.6g} s; leave out rows without a value")


def deviations(a: Result, b: Result, wanted: list[str], floor: float) -> list[Deviation]:
    """Deviations of the common (or the `wanted`) signals, the largest first.

    Raises UsageError: AC007 if the results have no signal or no time in common, AC010 for an unknown wanted signal.
    Raises UnitError: AC151 for units that do not fit.
    """
    import numpy as np

    from acausal.reduce.outputs import fitting

    names = [fit for name in wanted for fit in fitting(name, a.names) or [name]]
    elements = [s.name for name in names for r in (b, a) for s in r.elements(name)[1] if r is a]
    common = elements or [n for n in a.names if n in b.signals]
    times = _times(a, b)
    if not common or not times.size:
        what = "signal" if not common else "time"
        raise UsageError("AC007", f"the results have no {what} in common", help="are they results of the same model?")
    found = []
    either = _own_jumps(a, b)
    for name in common:
        convert = _conversion(name, a, b)
        x, (low, high) = np.asarray(a.at(times, name)), _between(a, times, name, either)
        other_low, other_high = map(convert, _between(b, times, name, either))
        difference = np.maximum(np.maximum(low - other_high, other_low - high), 0.0)
        # nan in one result is an infinite deviation, nan in both is none
        difference[np.isnan(difference)] = np.inf
        difference[np.isnan(low + high) & np.isnan(other_low + other_high)] = 0.0
        k = int(np.argmax(difference))
        finite = x[np.isfinite(x)]
        span = float(np.ptp(finite)) if finite.size else 0.0
        # a constant has no range: use its magnitude
        scale = max(span or (float(np.abs(finite).max()) if finite.size else 0.0), floor)
        rms = float(np.sqrt(np.mean(difference**2)))
        found.append(
            Deviation(name, float(difference[k]), float(difference[k]) / scale, float(times[k]), rms, a.unit(name))
        )
    return sorted(found, key=lambda d: -d.relative)


def _conversion(name: str, a: Result, b: Result) -> Scale:
    from acausal.plot.scale import same_unit

    try:
        return same_unit(a.unit(name), b.unit(name))
    except UnitError as error:
        fact = f"{name}: {a.unit(name)} in {a.model}, {b.unit(name)} in {b.model}"
        help = "correct the unit in the first row of the file"
        raise UsageError(error.code, fact, evidence=error.evidence, help=help) from error


def is_shorter(a: Result, b: Result) -> bool:
    """Whether `b` starts later or ends earlier than `a` by more than the distance of two rows, as an aborted run."""
    import numpy as np

    low, high = _overlap(a, b)
    spacing = max(float(np.diff(r.time).max(initial=0.0)) for r in (a, b))
    return bool(max(low - a.time[0], a.time[-1] - high) > spacing)


def _overlap(a: Result, b: Result) -> tuple[float, float]:
    """The first and the last time that both results cover."""
    return max(float(a.time[0]), float(b.time[0])), min(float(a.time[-1]), float(b.time[-1]))


def _times(a: Result, b: Result) -> Array:
    """The times of the result with fewer rows that both cover, each once."""
    import numpy as np

    coarse = a if len(a.time) <= len(b.time) else b
    low, high = _overlap(a, b)
    times = np.unique(coarse.time)
    return np.asarray(times[(times >= low) & (times <= high)], dtype=float)


def _repeated(result: Result) -> Array:
    """Times with several rows, before and after an event."""
    import numpy as np

    return np.unique(result.time[1:][np.diff(result.time) == 0])


def _own_jumps(a: Result, b: Result) -> Array:
    """The repeated times of each result at which the other one may be before or after the event, shape (n,).

    Times that both results repeat exactly are left out: their events (samples, switches of sources) coincide.
    """
    import numpy as np

    return np.setxor1d(_repeated(a), _repeated(b))


def _between(result: Result, times: Array, name: str, either: Array) -> tuple[Array, Array]:
    """(Smallest, largest) value of a signal at `times`, shape (n,) each, of those before and after an event.

    Only events at the times `either` count, for times within rounding errors of them; elsewhere both are equal.
    """
    import numpy as np

    value = np.asarray(result.at(times, name), dtype=float)
    low, high = value.copy(), value.copy()
    events = np.intersect1d(_repeated(result), either)
    if events.size:
        rounding = 1e-9 * max(abs(times[0]), abs(times[-1]))
        event = events[np.minimum(np.searchsorted(events, times - rounding), len(events) - 1)]
        is_near = np.abs(times - event) <= rounding
        values, here = result[name], event[is_near]
        before = np.searchsorted(result.time, here, side="left")
        after = np.searchsorted(result.time, here, side="right") - 1
        for rows in (before, after):
            low[is_near] = np.minimum(low[is_near], values[rows])
            high[is_near] = np.maximum(high[is_near], values[rows])
    return low, high
