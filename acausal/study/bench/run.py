"""One run of a bench with its errors and costs, and the recommendation for an accuracy."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from acausal.study.bench.accuracy.distance import Distance
from acausal.study.bench.case import Case

COUNTERS = ("steps", "rhs_evaluations", "jacobians", "factorisations", "rejected")


@dataclass(frozen=True)
class Run:
    """One case: its errors and costs, or its `failure`. Times in seconds.

    `solve_time` is the best of the repetitions, in processor time, without the construction of integrators, which
    belongs to `startup_time` with the start values. `constraint_drift` is the largest residual of stabilised
    constraints before projection; None without such constraints.
    """

    case: Case
    failure: str = ""
    distance: Distance | None = None
    solve_time: float = math.nan
    startup_time: float = math.nan
    counters: Mapping[str, float] = field(default_factory=dict)
    constraint_drift: float | None = None
    native: bool = False
    events: int = 0

    @property
    def error(self) -> float:
        """The error on the chart: the largest mixed error over the grid; nan for a failure."""
        return math.nan if self.distance is None else self.distance.series

    @property
    def cost(self) -> float:
        """Total time of a run of a compiled model [s]."""
        return self.solve_time + self.startup_time

    def record(self) -> dict[str, Any]:
        """For JSON."""
        d = self.distance
        return {
            "solver": self.case.solver,
            "formulation": self.case.formulation,
            "tolerance": self.case.tolerance,
            "step": self.case.step,
            "series": self.case.series,
            "failed": bool(self.failure),
            "failure": self.failure or None,
            "error": None if d is None else d.series,
            "end_error": None if d is None else d.end,
            "absolute_error": None if d is None else d.absolute,
            "worst": None if d is None else d.worst,
            "scd": None if d is None else d.scd,
            "mescd": None if d is None else d.mescd,
            "phase_error": None if d is None else d.phase,
            "shape_error": None if d is None else d.shape,
            "constraint_drift": self.constraint_drift,
            "solve_time": self.solve_time,
            "startup_time": self.startup_time,
            **{name: self.counters.get(name) for name in COUNTERS},
            "events": self.events,
            "native": self.native,
        }


def generic(failure: str) -> str:
    """The text of a failure without the numbers that differ from run to run."""
    text = re.sub(r"^not tried: ", "", failure)
    text = re.sub(r" at (tolerance|step) \S+( s)?$", "", text)
    text = re.sub(r": error \S+$", "", text)
    text = re.sub(r"a step of \S+ s is", "steps are", text)
    return re.sub(r" stopped at t = \S+ s", " stopped", text)


def monotone(runs: Sequence[Run], accuracy: float) -> list[Run]:
    """Runs of a series that reach an accuracy and whose tighter runs all do, too, to exclude chance."""
    found = []
    for run in reversed(runs):
        if run.distance is None:
            continue
        if not run.error <= accuracy:
            break
        found.append(run)
    return found


@dataclass(frozen=True)
class Recommendation:
    """Recommended options for `simulate`; `tolerance` is None for fixed steps, `step` for adaptive ones."""

    accuracy: float
    run: Run
    tried: int
    digits: float

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments of `simulate`."""
        case = self.run.case
        return {"solver": case.solver, "tolerance": case.tolerance, "step": case.step}

    @property
    def text(self) -> str:
        """The recommendation as one sentence."""
        case = self.run.case
        form = "" if case.formulation == "torn" else f", formulation {case.formulation}"
        return (
            f"{case.solver} with {case.knob}{form}: error {self.run.error:.1e}, "
            f"{1e3 * self.run.cost:.3g} ms, the cheapest of {self.tried} runs"
        )

    @property
    def command(self) -> str:
        """Options of `acausal simulate`."""
        case = self.run.case
        knob = f"--step {case.step:.6g}" if case.step is not None else f"--tolerance {case.tolerance:.3g}"
        form = "" if case.formulation == "torn" else f" --formulation {case.formulation}"
        native = " --native" if self.run.native else ""
        return f"--solver {case.solver} {knob}{form}{native}"

    def record(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "accuracy": self.accuracy,
            **self.options,
            "formulation": self.run.case.formulation,
            "native": self.run.native,
            "error": self.run.error,
            "solve_time": self.run.solve_time,
            "cost": self.run.cost,
            "tried": self.tried,
            "trusted_digits": self.digits,
            "command": self.command,
        }
