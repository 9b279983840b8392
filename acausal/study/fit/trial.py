"""One experiment as runs of the model: residuals, and their derivatives, as functions of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real as Number
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, RunError, UsageError
from acausal.export.forms import SENSITIVITIES, check
from acausal.export.ports import Output, named_outputs
from acausal.export.sensitivity.chain import Chain
from acausal.export.sensitivity.two_sided import refuse_two_sided
from acausal.flatten.flat import suffixes
from acausal.lower.compiled import CompiledModel
from acausal.lower.variants.started import with_starts
from acausal.result.result import Result
from acausal.simulate.driver.run import Run
from acausal.simulate.inputs.given import given_inputs
from acausal.simulate.interrupt import interruptible
from acausal.simulate.options import options as run_options
from acausal.simulate.options import parameter_vector
from acausal.simulate.run import simulate
from acausal.study.fit.dataset import Dataset, Measured, columns_of, measured

# A signal jumps at an event if it changes by more than this fraction of its range.
_JUMP = 1e-6
# Two times coincide if they differ by less than this fraction of the run.
_CLOSE = 1e-9


@dataclass(frozen=True, eq=False)
class Trial:
    """A data set prepared for runs of the model."""

    name: str
    compiled: CompiledModel
    signals: tuple[Measured, ...]  # signals to compare
    sigma: Mapping[str, float]  # known standard deviations of the noise, by name, in SI
    parameters: Mapping[str, object]
    options: Mapping[str, Any]
    first: tuple[Mapping[str, float], TrialRun]  # guessed values, and the run with them
    wanted: tuple[Output, ...] | None  # the signals, if runs are differentiated
    rows: Vector | None  # times of the rows [s] of differentiated runs, if no grid contains those of the data
    notes: tuple[str, ...] = ()

    def run(self, values: Mapping[str, float]) -> Result:
        """Simulate the experiment with these values of the free parameters."""
        return simulate(self.compiled, parameters={**self.parameters, **values}, **self.options)

    def trial_run(self, values: Mapping[str, float]) -> TrialRun:
        """Run with derivatives if available; the run with the guessed values is reused."""
        guess, first = self.first
        return (
            first
            if values == guess
            else _run_trial(self.compiled, self.parameters, values, self.options, self.wanted, self.rows)
        )

    def residuals(self, trial_run: TrialRun) -> Vector:
        """Simulated minus measured values of all signals in SI, shape (rows,)."""
        return np.concatenate([compared(trial_run.result, s.times, s.name) - s.values for s in self.signals])

    def derivatives(self, trial_run: TrialRun) -> Vector | None:
        """Derivatives of the residuals by the free parameters, shape (rows, n); None if the run has none."""
        if trial_run.differentiated is None:
            return None
        # the time of a jump moves with parameters, which derivatives at fixed times do not include
        if any(jumps(trial_run.result, s.times, s.name) for s in self.signals):
            return None
        times = np.unique(np.concatenate([s.times for s in self.signals]))
        found = trial_run.differentiated.derivatives(times)
        if found is None:
            return None
        return np.concatenate([found[np.searchsorted(times, s.times), k] for k, s in enumerate(self.signals)])


@dataclass(frozen=True, eq=False)
class TrialRun:
    """A run, and its linear maps if it can be differentiated."""

    result: Result
    differentiated: DifferentiatedRun | None


def _run_trial(
    compiled: CompiledModel,
    parameters: Mapping[str, object],
    values: Mapping[str, float],
    options: Mapping[str, Any],
    wanted: tuple[Output, ...] | None,
    rows: Vector | None,
) -> TrialRun:
    every = {**parameters, **values}
    names = tuple(values)
    differentiated = None if wanted is None else differentiated_run(compiled, every, options, names, wanted, rows)
    result = simulate(compiled, parameters=every, **options) if differentiated is None else differentiated.result
    stop = options["stop_time"]
    if result.time[-1] < stop - 1e-9 * np.ptp(result.time):
        raise RunError(
            "AC011",
            f"the model {compiled.name} terminates its run at {result.time[-1]:g} s, but the data end at {stop:g} s",
            evidence=[f"{name} = {value:.6g}" for name, value in values.items()],
            help="start with other values, or leave out the later data",
        )
    return TrialRun(result, differentiated)


def trial_of(
    compiled: CompiledModel,
    dataset: Dataset,
    number: int,
    common: Dataset,
    guess: Mapping[str, float],
    options: Mapping[str, Any],
) -> Trial:
    """Prepare a data set for a model, with a first run that checks that they fit.

    Raises UsageError: AC055 for data that do not fit, AC011 for rows before the start of a run.
    """
    given = columns_of(dataset)
    # a file of a run has columns of its parameters, by which a free one would be given away
    settings = {p.path + s for p in compiled.flat.parameters for s in suffixes(p.declaration.shape)}
    columns = {n: c for n, c in given.items() if n not in settings}
    left_out = [n for n in given if n in settings]
    name = dataset.name or (str(dataset.data) if isinstance(dataset.data, str) else f"data set {number + 1}")
    if not columns:
        raise UsageError("AC055", f"{name} contains no measurement", help="give {'mass.s': (times, values)}")
    measurements = {n: c for n, c in columns.items() if n not in compiled.inputs}
    begin = compiled.flat.experiment.start_time
    last = max(float(c.times[-1]) for c in columns.values())
    first = min(float(c.times[0]) for c in columns.values())
    if first < begin or last <= begin:
        raise UsageError(
            "AC011", f"{name} goes from {first:g} s to {last:g} s; a run of {compiled.name} starts at {begin:g} s"
        )
    driving = {n: c for n, c in columns.items() if n in compiled.inputs}
    run = {**options, "inputs": {**common.inputs, **driving, **dataset.inputs}, "stop_time": last}
    run["output_interval"] = _interval([c.times for c in measurements.values()], begin)
    rows = None if run["output_interval"] is not None else _rows([c.times for c in measurements.values()], begin, last)
    started = with_starts(compiled, {**common.start, **dataset.start})
    own = {**common.parameters, **dataset.parameters}
    for path, value in dataset.sigma.items():
        if not isinstance(value, Number) or not value > 0.0:
            raise UsageError("AC055", f"sigma of {path} is {value}: a standard deviation is positive")
    wanted = signals_of(started, list(measurements))
    trial_run = _run_trial(started, own, guess, run, None if wanted is None else tuple(wanted), rows)
    signals = measured(columns, compiled.inputs, trial_run.result)
    unknown = [n for n in dataset.sigma if n not in {s.name for s in signals}]
    if unknown:
        raise UsageError("AC055", f"sigma names {unknown[0]}, which is not measured in {name}")
    is_fast = trial_run.differentiated is not None and trial_run.differentiated.is_fast
    first_run = trial_run if is_fast else TrialRun(trial_run.result, None)
    return Trial(
        name,
        started,
        signals,
        dataset.sigma,
        own,
        run,
        (guess, first_run),
        tuple(wanted or ()) if is_fast else None,
        rows,
        (f"{', '.join(left_out[:4])} of {name}: columns of parameters are not compared",) if left_out else (),
    )


def _interval(times: list[Vector], begin: float) -> float | None:
    """Output interval [s] of a grid that contains all times, so that nothing is interpolated; None if there is none."""
    for t in times[:1]:
        step = float(np.diff(t).min())
        positions = [(u - begin) / step for u in times] if step > 0.0 else []
        if positions and all(np.abs(p - np.round(p)).max() < 1e-6 for p in positions):
            return step
    return None


def _rows(times: list[Vector], begin: float, last: float) -> Vector:
    """Times of rows [s] that include those of the data, if no grid does: integrating up to each would cost ten runs."""
    found = np.unique(np.concatenate([[begin], *times, [last]]))
    return np.asarray(found[np.diff(found, prepend=-np.inf) > _CLOSE * (last - begin)])


@dataclass(frozen=True, eq=False)
class DifferentiatedRun:
    """A run with the linear maps along it."""

    result: Result
    chain: Chain

    def derivatives(self, times: Vector) -> Vector | None:
        """Derivatives of the signals by the parameters, shape (times, signals, parameters); None if not available."""
        try:
            refuse_two_sided(self.chain)  # at such a point, finite differences are better
            found = self.chain.trajectory(times, self._states)
        except (AcausalError, RuntimeError, np.linalg.LinAlgError):
            return None
        return found if np.isfinite(found).all() else None

    @property
    def is_fast(self) -> bool:
        """Whether the derivatives need compiled steps only, or none."""
        try:
            return self.chain.is_fast()
        except (AcausalError, RuntimeError, np.linalg.LinAlgError):
            return False

    def _states(self, times: Vector) -> Vector:
        names = self.chain.compiled.states
        return np.column_stack([np.zeros((len(times), 0)), *(at(self.result, times, name) for name in names)])


def signals_of(compiled: CompiledModel, names: Sequence[str]) -> list[Output] | None:
    """The signals, if runs can be differentiated, else None."""
    try:
        wanted = named_outputs(compiled, names)
        check(compiled, SENSITIVITIES, wanted)
    except AcausalError:
        return None
    return list(wanted)


@interruptible
def differentiated_run(
    compiled: CompiledModel,
    parameters: Mapping[str, object],
    options: Mapping[str, Any],
    names: Sequence[str],
    wanted: Sequence[Output],
    rows: Vector | None = None,
) -> DifferentiatedRun | None:
    """The run with its linear maps; None for varying inputs, or if this run fails (a plain one may still succeed).

    Its output times are `rows` [s], if given, instead of those of a grid.
    """
    without_inputs = {k: v for k, v in options.items() if k != "inputs"}
    chosen = run_options(compiled.flat.experiment, **without_inputs)
    try:
        p = parameter_vector(compiled, parameters)
    except UsageError:  # a plain run says why
        return None
    inputs = given_inputs(compiled, options["inputs"], chosen.start_time, chosen.stop_time, chosen.tolerances)
    if inputs.places:
        return None
    run = Run(compiled, chosen, p, inputs, None, outputs=rows, traced=True)
    try:
        result = run.result()
    except RunError:
        return None
    indices = [compiled.parameters.index(name) for name in names]
    return DifferentiatedRun(result, Chain(run, indices, wanted, chosen.tolerance))


def jumps(result: Result, times: Vector, name: str) -> dict[int, Vector]:
    """(Value before, value after) of the jump of the run for each jump of the data, by the index of its first row.

    A jump of the data, times of shape (k,), is two rows with equal times. The corresponding jump of the run is the
    nearest event between the neighbouring rows at which the signal jumps; its time differs if it depends on parameters.
    """
    found: dict[int, Vector] = {}
    doubles = np.flatnonzero(np.diff(times) == 0.0).tolist()
    if not doubles:
        return found
    values = result[name]
    steps = np.abs(np.diff(values))
    pairs = np.flatnonzero((np.diff(result.time) == 0.0) & (steps > _JUMP * np.ptp(values)))
    for k in doubles:
        low = times[k - 1] if k > 0 else -np.inf
        high = times[k + 2] if k + 2 < len(times) else np.inf
        near = pairs[(result.time[pairs] > low) & (result.time[pairs] < high)]
        if len(near):
            event = result.time[near[np.abs(result.time[near] - times[k]).argmin()]]
            found[k] = values[np.flatnonzero(result.time == event)[[0, -1]]]
    return found


def compared(result: Result, times: Vector, name: str) -> Vector:
    """Values of a signal to compare with data at `times`, shape (k,); jumps are compared with jumps of the data."""
    found = at(result, times, name).copy()
    for k, jump in jumps(result, times, name).items():
        found[[k, k + 1]] = jump
    return found


def at(result: Result, times: Vector, name: str) -> Vector:
    """Values of a signal at `times`, shape (k,), from rows up to rounding, because interpolation costs three runs."""
    if len(result.time) < 2:
        return np.asarray(result.at(times, name))
    tiny = _CLOSE * float(np.ptp(result.time))
    right = np.clip(np.searchsorted(result.time, times), 1, len(result.time) - 1)
    nearest = np.where(times - result.time[right - 1] < result.time[right] - times, right - 1, right)
    near = np.abs(result.time[nearest] - times) <= tiny
    # at an event two rows have equal times: `result.at` chooses the one after it
    gaps = np.diff(result.time, prepend=-np.inf, append=np.inf)
    is_single = (gaps[:-1] > 2 * tiny) & (gaps[1:] > 2 * tiny)
    near &= is_single[nearest]
    found = np.asarray(result[name])[nearest]
    if not near.all():
        found = found.copy()
        found[~near] = np.asarray(result.at(times[~near], name))
    return np.asarray(found)
