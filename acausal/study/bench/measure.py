"""Measurement of one case in a child process: a warm-up run, then several timed runs."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.clock import CLOCK
from acausal.simulate.run import simulate
from acausal.study.bench.accuracy.trajectory import POINTS, Trajectory, sampled
from acausal.study.bench.case import ONLY_FIXED, Case
from acausal.study.bench.isolated import Outcome, isolated
from acausal.study.bench.run import COUNTERS

FINE = 10
"""Points of the reference per grid interval, because phases are searched between grid points."""


@dataclass(frozen=True)
class Task:
    """A model, and the options of `simulate` that are common to all cases."""

    compiled: CompiledModel
    names: tuple[str, ...]
    span: float
    options: Mapping[str, Any] = field(default_factory=dict)

    def run(self, case: Case, points: int = POINTS) -> Result:
        """Simulate once."""
        return simulate(
            self.compiled,
            solver=case.solver,
            tolerance=case.tolerance,
            step=case.step,
            output_interval=self.span / points,
            **self.options,
        )

    def points(self, case: Case) -> int:
        """Number of grid intervals for a case: fewer than the others if these would shorten its steps.

        Methods without dense output take at least one step per output.
        """
        if case.step is None or case.solver not in ONLY_FIXED:
            return POINTS
        most = self.span / case.step * (1 + 1e-9)
        return max((n for n in range(1, POINTS + 1) if POINTS % n == 0 and n <= most), default=1)


@dataclass(frozen=True)
class Measured:
    """Times [s], counters, and trajectory of one case."""

    trajectory: Trajectory
    solve_time: float
    startup_time: float
    first_time: float
    counters: dict[str, float]
    drift: float | None
    native: bool
    events: int

    @property
    def finite(self) -> bool:
        """Whether its trajectory is finite."""
        return math.isfinite(float(abs(self.trajectory.values).max()))


def measured(task: Task, case: Case, repeat: int, limit: float) -> Outcome[Measured]:
    """Best of `repeat` runs after a warm-up run; a single run may take at most `limit` [s].

    Repetitions stop early when they have taken `limit` seconds in total.
    """

    def work() -> Iterator[Measured]:
        processor_clock()
        began = time.process_time()
        points = task.points(case)
        best = _measured(task, case, task.run(case, points), points, 0.0)
        took = time.process_time() - began
        best = replace(best, first_time=took)
        yield best
        stop = time.process_time() + 0.8 * limit - took
        for k in range(repeat):
            if time.process_time() > stop:
                break
            again = _measured(task, case, task.run(case, points), points, took)
            # the warm-up run counts only if there is no other
            best = again if k == 0 or again.solve_time < best.solve_time else best
        yield best

    return isolated(work, limit)


def fine(task: Task, case: Case, limit: float) -> Outcome[Trajectory]:
    """Trajectory of one case on the fine grid."""

    def work() -> Iterator[Trajectory]:
        yield sampled(task.run(case, POINTS * FINE), task.names, POINTS * FINE, task.span)

    return isolated(work, limit)


def processor_clock() -> None:
    """Make runs of this process measure processor time instead of elapsed time.

    Solvers run in one thread and wait for nothing else, so this is the elapsed time on an idle machine.
    """
    CLOCK.set(time.process_time)


def _measured(task: Task, case: Case, result: Result, points: int, first_time: float) -> Measured:
    stats = dict(result.stats)
    times: Any = stats["time"]
    making = float(str(stats.get("making", 0.0)))
    counters = {name: float(str(stats[name])) for name in COUNTERS if name in stats}
    if result.stats["solver"] == "rosenbrock":
        # one Jacobian and one factorisation per attempted step
        counters["factorisations"] = counters.get("steps", 0.0) + counters.get("rejected", 0.0)
    if case.step is not None and not counters.get("rhs_evaluations"):
        # CasADi's rk and collocation have no counters: a whole number of steps per output interval
        interval = task.span / points
        counters = {"steps": points * max(1.0, math.ceil(interval / case.step - 1e-9))}
    drift = stats.get("drift")
    return Measured(
        trajectory=sampled(result, task.names, points, task.span),
        solve_time=times["integrate"] - making,
        startup_time=times["initialize"] + making,
        first_time=first_time,
        counters=counters,
        drift=None if drift is None else float(str(drift)),
        native=bool(stats.get("native")),
        events=len(result.events),
    )
