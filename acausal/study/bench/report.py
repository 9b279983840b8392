"""Result of a bench: all runs with their errors and costs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

from acausal.errors import IntegrationError
from acausal.providers import provided
from acausal.study.bench.accuracy.reference import Reference
from acausal.study.bench.run import Recommendation, Run, generic, monotone

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Bench:
    """Work and precision of one model.

    `times` in seconds: "build" (creating the components), "compile" (per formulation: "compile torn", ...), "native"
    (per series: compiling the C library, or finding it), "start" (start values and integrators, median over the runs).
    """

    model: str
    runs: tuple[Run, ...]
    reference: Reference
    components: tuple[str, ...]
    start_time: float
    stop_time: float
    repeat: int
    times: Mapping[str, float]
    machine: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        failed = sum(bool(run.failure) for run in self.runs)
        return (
            f"Bench({self.model}: {len(self.runs)} runs, {failed} failed, {self.reference.trusted_digits:.1f} digits)"
        )

    @property
    def series(self) -> dict[str, tuple[Run, ...]]:
        """Runs of each line of the chart, the loosest first, by name."""
        found: dict[str, list[Run]] = {}
        for run in self.runs:
            found.setdefault(run.case.series, []).append(run)
        return {name: tuple(runs) for name, runs in found.items()}

    @property
    def orders(self) -> dict[str, tuple[float, int]]:
        """(Observed, classical) order of each series of fixed steps that has two suitable errors.

        It is observed between the last two errors above that of the reference. Stiffness, kinks and events reduce it.
        """
        found = {}
        for name, runs in self.series.items():
            floor = 10 * max(self.reference.trusted_error, 1e-14)
            suitable = [run for run in runs if run.case.step is not None and floor < run.error < _ASTRAY]
            if len(suitable) < 2:
                continue
            # count the steps actually taken: some methods subdivide every output interval
            (a, few), (b, many) = ((run.error, run.counters.get("steps", math.nan)) for run in suitable[-2:])
            if many > few:
                found[name] = math.log(a / b) / math.log(many / few), _ORDERS[suitable[0].case.solver]
        return found

    def record(self) -> dict[str, Any]:
        """All results as a dictionary, for JSON."""
        return {
            "model": self.model,
            "orders": {name: {"observed": a, "classical": b} for name, (a, b) in self.orders.items()},
            "start_time": self.start_time,
            "stop_time": self.stop_time,
            "components": list(self.components),
            "reference": {
                "source": self.reference.source,
                "solvers": list(self.reference.solvers),
                "trusted_digits": self.reference.trusted_digits,
                "trusted_error": self.reference.trusted_error,
                "notes": list(self.reference.notes),
                "growth": None if self.reference.growth is None else self.reference.growth.content(),
            },
            "repeat": self.repeat,
            "times": dict(self.times),
            "runs": [run.record() for run in self.runs],
            "machine": dict(self.machine),
            "notes": list(self.notes),
        }

    def recommend(self, accuracy: float) -> Recommendation:
        """The cheapest run with an error of at most `accuracy`, which every tighter run of its series reaches, too.

        Raises
        ------
        IntegrationError
            AC411 if no run reaches it, or the reference is not accurate enough.
        """
        digits = self.reference.trusted_digits
        if self.reference.trusted_error > accuracy:
            raise IntegrationError(
                "AC411",
                f"an accuracy of {accuracy:g} cannot be judged for {self.model}: "
                + (
                    f"its reference is trusted to {digits:.1f} digits only"
                    if digits > 0
                    else "its reference has no correct digit"
                ),
                evidence=[self.reference.source, *self.reference.notes],
                cause="the model amplifies rounding errors (chaos), or has jumps at which solvers differ in time",
                help="shorten the run (--stop-time), or request less accuracy",
            )
        good = [run for runs in self.series.values() for run in monotone(runs, accuracy)]
        if not good:
            best_runs = sorted((run for run in self.runs if run.distance is not None), key=lambda run: run.error)
            raise IntegrationError(
                "AC411",
                f"no run of {self.model} reached an accuracy of {accuracy:g}",
                evidence=[f"{run.case.series}, {run.case.knob}: error {run.error:.1e}" for run in best_runs[:3]],
                help="try tighter tolerances (--tolerance), or request less accuracy",
            )
        best = min(good, key=lambda run: run.cost)
        return Recommendation(accuracy, best, len(self.runs), self.reference.trusted_digits)

    def plot(self, file: str | Path | None = None) -> Figure:
        """Draw the chart, to a file if one is given: .png, .svg or .pdf."""
        drawn: Figure = provided("bench_chart")(self, file)
        return drawn

    def failures(self) -> dict[str, tuple[Run, ...]]:
        """Failed runs by reason."""
        found: dict[str, list[Run]] = {}
        for run in self.runs:
            if run.failure:
                found.setdefault(generic(run.failure), []).append(run)
        return {reason: tuple(runs) for reason, runs in found.items()}

    def lines(self) -> Iterator[str]:
        """The report as text: the cheapest run for three accuracies, the reference, and failures."""
        best = {accuracy: _cheapest(self, accuracy) for accuracy in _LEVELS}
        middle = _LEVELS[len(_LEVELS) // 2]
        yield f"verdict: {best[middle]} for an error of {middle:g}; {self.model}, {self.start_time:g} ... " + (
            f"{self.stop_time:g} s"
        )
        yield from (f"  for {level:g}  {text}" for level, text in best.items() if level != middle)
        yield f"  reference  {self.reference.source}: {self.reference.trusted_digits:.1f} digits trusted"
        if self.reference.growth is not None:
            yield f"  errors     {self.reference.growth.text}"
        failed = self.failures()
        if failed:
            count = sum(map(len, failed.values()))
            yield f"  failed     {count} of {len(self.runs)} runs:"
            most = sorted(failed.items(), key=lambda pair: -len(pair[1]))
            for reason, runs in most[:_MOST_REASONS]:
                who = ", ".join(dict.fromkeys(run.case.series for run in runs))
                yield f"             {len(runs)} of {who}: {shorten(reason, _LONGEST, placeholder=' ...')}"

    def rows(self) -> list[tuple[str, ...]]:
        """Table for the command line: header and one row per run; with drift if there are constraints."""
        drifts = any(run.constraint_drift is not None for run in self.runs)
        head = (*_HEAD, *(("drift",) if drifts else ()), *_COUNTS)
        return [head, *(_row(run, drifts) for run in self.runs)]


_LEVELS = (1e-3, 1e-6, 1e-9)
# Limits of the failures in the short report.
_MOST_REASONS, _LONGEST = 3, 90
# Largest mixed error at which an order can be observed.
_ASTRAY = 0.1
_HEAD = ("series", "tolerance or step", "error", "end error", "mescd", "phase s", "solve ms")
_COUNTS = {"steps": "steps", "rhs": "rhs_evaluations", "jac": "jacobians", "fact": "factorisations"}
# The classical order of each method with fixed steps.
_ORDERS = {"rk2": 2, "rk": 4, "erk": 5, "rosenbrock": 5, "collocation": 5}


def _cheapest(bench: Bench, accuracy: float) -> str:
    if bench.reference.trusted_error > accuracy:
        return "the reference is not accurate enough"
    good = [run for runs in bench.series.values() for run in monotone(runs, accuracy)]
    if not good:
        return "no run reaches it"
    best = min(good, key=lambda run: run.cost)
    return f"{best.case.series} with {best.case.knob} ({1e3 * best.cost:.3g} ms, error {best.error:.1e})"


def _row(run: Run, drifts: bool) -> tuple[str, ...]:
    if run.distance is None:
        return run.case.series, run.case.knob, f"failed: {run.failure}"
    d = run.distance
    drift = () if not drifts else ("-" if run.constraint_drift is None else f"{run.constraint_drift:.1e}",)
    return (
        run.case.series,
        run.case.knob,
        f"{d.series:.1e}",
        f"{d.end:.1e}",
        f"{d.mescd:.2f}",
        "-" if d.phase is None else f"{d.phase:.1e}",
        f"{1e3 * run.solve_time:.3g}",
        *drift,
        *(f"{run.counters[c]:.0f}" if c in run.counters else "-" for c in _COUNTS.values()),
    )
