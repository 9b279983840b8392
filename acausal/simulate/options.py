"""What a run is asked to do, and the grid of output times that follows from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.errors import UsageError
from acausal.language.declarations.experiment import Experiment
from acausal.simulate.tolerances import Tolerances

# Below this the rounding of sixteen digits is larger than what a step may be wrong by: no step is ever accepted.
_FINEST = 1e-14
# Solvers without step control, or whose choice depends on whether there is a step.
_FIXED = ("auto", "rk", "rk2", "collocation")
# Solvers that always choose their steps themselves.
_FREE = ("idas", "cvodes")


@dataclass(frozen=True)
class Options:
    """A run: times in seconds, relative tolerance, solver name or "auto", size of a fixed step.

    Absolute tolerances are `absolute_factor * tolerance * nominal`, per variable. `native`: True compiles the equations
    to C, False interprets them, None decides.
    """

    start_time: float
    stop_time: float
    output_interval: float
    tolerance: float
    solver: str
    step: float | None
    max_step: float | None = None
    absolute_factor: float = 1e-3
    native: bool | None = None

    @property
    def tolerances(self) -> Tolerances:
        """What end errors are to be below; solvers get a share of it."""
        return Tolerances(self.tolerance, self.absolute_factor)

    @property
    def span(self) -> float:
        """Length of the run [s]."""
        return self.stop_time - self.start_time

    def grid(self) -> NDArray[np.float64]:
        """Output times: multiples of the interval from the start, and the stop time."""
        count = math.floor((self.stop_time - self.start_time) / self.output_interval * (1 + 1e-12) + 1e-9)
        times: NDArray[np.float64] = self.start_time + self.output_interval * np.arange(count + 1, dtype=np.float64)
        if self.stop_time - times[-1] > 1e-9 * self.output_interval:
            return np.append(times, self.stop_time)
        times[-1] = self.stop_time
        return times


def options(
    experiment: Experiment,
    *,
    start_time: float | None = None,
    stop_time: float | None = None,
    output_interval: float | None = None,
    tolerance: float | None = None,
    solver: str | None = None,
    step: float | None = None,
    max_step: float | None = None,
    native: bool | None = None,
) -> Options:
    """Options from a model's experiment and what the caller overrides.

    Raises UsageError: AC030 when times, tolerance or steps make no sense, AC038 for a step given to a solver that
    chooses its own, and for a largest step beside a fixed one.
    """
    start = experiment.start_time if start_time is None else _number("start_time", start_time)
    stop = experiment.stop_time if stop_time is None else _number("stop_time", stop_time)
    # a tolerance asked of a method that controls its steps means that it shall do so, and so does a method that must
    adaptive = solver in _FREE or (tolerance is not None and solver is not None and solver not in _FIXED)
    own_step = None if adaptive else experiment.step
    interval = output_interval if output_interval is not None else experiment.output_interval
    name = experiment.solver if solver is None else solver
    steps = own_step if step is None else _number("step", step)
    rows = (stop - start) / 500 if interval is None else _number("output_interval", interval)
    if output_interval is None and name in _FIXED and steps is not None and rows < steps < math.inf:
        # these methods know the ends of their steps only: rows nobody asked for must not make the steps shorter
        rows = min(steps, max(stop - start, rows))
    chosen = Options(
        start_time=start,
        stop_time=stop,
        output_interval=rows,
        tolerance=experiment.tolerance if tolerance is None else _number("tolerance", tolerance),
        solver=name,
        step=steps,
        max_step=experiment.max_step if max_step is None else _number("max_step", max_step),
        native=native,
    )
    checks = (
        (
            math.isfinite(start) and math.isfinite(stop) and stop > start,
            f"stop_time {stop:g} s is not after start_time {start:g} s",
        ),
        (chosen.output_interval > 0, f"output_interval {chosen.output_interval:g} s is not positive"),
        (
            chosen.output_interval * 2e7 > stop - start,
            f"output_interval {chosen.output_interval:g} s gives too many rows",
        ),
        (0 < chosen.tolerance < 1, f"tolerance {chosen.tolerance:g} is not between 0 and 1"),
        (
            chosen.tolerance >= _FINEST,
            f"tolerance {chosen.tolerance:g} is finer than numbers of 16 digits allow: 1e-14",
        ),
        (chosen.step is None or chosen.step > 0, f"step {chosen.step} s is not positive"),
        (chosen.max_step is None or chosen.max_step > 0, f"max_step {chosen.max_step} s is not positive"),
    )
    for holds, fact in checks:
        if not holds:
            raise UsageError("AC030", fact)
    if chosen.solver in _FREE and chosen.step is not None:
        raise UsageError(
            "AC038",
            f"solver '{chosen.solver}' chooses its steps itself: a step of {chosen.step:g} s would change nothing",
            help="leave the step out and give a tolerance; rk2, rk, collocation, erk and rosenbrock take fixed steps",
        )
    if max_step is not None and chosen.step is not None:
        raise UsageError(
            "AC038",
            f"steps of {chosen.step:g} s are fixed: a max_step of {max_step:g} s would change nothing",
            help="leave one of them out",
        )
    return chosen


def _number(name: str, value: object) -> float:
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise UsageError(
            "AC030", f"{name} = {value!r} is not a number", help="one number, in s or without unit"
        ) from error
