"""One experiment as runs of the model: parameters in, residuals out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.errors import UsageError
from acausal.lower.compiled import CompiledModel
from acausal.lower.started import with_starts
from acausal.result import Result
from acausal.simulate.run import simulate
from acausal.study.fit.dataset import Dataset, Measured, columns_of, drives, measured

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trial:
    """A data set that fits the model.

    Attributes
    ----------
    signals
        What is compared.
    sigma
        Standard deviations of the noise that are known, by name, in SI.
    """

    name: str
    compiled: CompiledModel
    signals: tuple[Measured, ...]
    sigma: Mapping[str, float]
    parameters: Mapping[str, object]
    options: Mapping[str, Any]

    def run(self, values: Mapping[str, float]) -> Result:
        """The experiment with these values of the parameters that are sought."""
        return simulate(self.compiled, parameters={**self.parameters, **values}, **self.options)

    def residuals(self, values: Mapping[str, float]) -> Vector:
        """Simulated less measured values of all signals, in SI."""
        result = self.run(values)
        return np.concatenate([_at(result, s.times, s.name) - s.values for s in self.signals])


def _at(result: Result, times: Vector, name: str) -> Vector:
    """Values at times, of rows where these differ from them by rounding: to interpolate costs three runs."""
    if len(result.time) < 2:
        return np.asarray(result.at(times, name))
    tiny = 1e-9 * float(np.ptp(result.time))
    right = np.clip(np.searchsorted(result.time, times), 1, len(result.time) - 1)
    nearest = np.where(times - result.time[right - 1] < result.time[right] - times, right - 1, right)
    near = np.abs(result.time[nearest] - times) <= tiny
    # at an event two rows have one time: `at` knows which holds
    apart = np.diff(result.time, prepend=-np.inf, append=np.inf)
    alone = (apart[:-1] > 2 * tiny) & (apart[1:] > 2 * tiny)
    near &= alone[nearest]
    found = np.asarray(result[name])[nearest]
    if not near.all():
        found = found.copy()
        found[~near] = np.asarray(result.at(times[~near], name))
    return np.asarray(found)


def trial_of(
    compiled: CompiledModel,
    dataset: Dataset,
    number: int,
    common: Dataset,
    guess: Mapping[str, float],
    options: Mapping[str, Any],
) -> Trial:
    """The data set joined with the model; one run tells whether they fit.

    Raises
    ------
    UsageError
        AC055 for data that do not fit, AC011 for rows before the start of a run.
    """
    columns = columns_of(dataset)
    name = dataset.name or (str(dataset.data) if isinstance(dataset.data, str) else f"data set {number + 1}")
    begin = compiled.flat.experiment.start_time
    last = max(float(c.times[-1]) for c in columns.values())
    first = min(float(c.times[0]) for c in columns.values())
    if first < begin or last <= begin:
        raise UsageError(
            "AC011", f"{name} goes from {first:g} s to {last:g} s; a run of {compiled.name} starts at {begin:g} s"
        )
    run = dict(options)
    run |= {"inputs": {**common.inputs, **drives(columns, compiled.inputs), **dataset.inputs}, "stop_time": last}
    run["output_interval"] = _interval([c.times for n, c in columns.items() if n not in compiled.inputs], begin)
    started = with_starts(compiled, {**common.start, **dataset.start})
    trial = Trial(name, started, (), dataset.sigma, {**common.parameters, **dataset.parameters}, run)
    for path, value in dataset.sigma.items():
        if not value > 0.0:
            raise UsageError("AC055", f"sigma of {path} is {value}: a standard deviation is positive")
    signals = measured(columns, compiled.inputs, trial.run(guess))
    unknown = [n for n in dataset.sigma if n not in {s.name for s in signals}]
    if unknown:
        raise UsageError("AC055", f"sigma names {unknown[0]}, which is not measured in {name}")
    return Trial(name, started, signals, dataset.sigma, trial.parameters, run)


def _interval(times: list[Vector], begin: float) -> float | None:
    """The interval of output times that meets every row, if there is one: no value is interpolated then."""
    for t in times[:1]:
        step = float(np.diff(t).min())
        places = [(u - begin) / step for u in times] if step > 0.0 else []
        if places and all(np.abs(p - np.round(p)).max() < 1e-6 for p in places):
            return step
    return None
