"""A run whose signals can be differentiated by parameters, all at once and without differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.errors import AcausalError, RunError
from acausal.export.forms import SENSITIVITIES, check
from acausal.export.ports import Output, named_outputs
from acausal.export.sensitivity.chain import Chain
from acausal.lower.cache.cache import choices_stand_for
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.arguments import parameter_vector
from acausal.simulate.driver.run import Run
from acausal.simulate.inputs.given import given_inputs
from acausal.simulate.interrupt import interruptible
from acausal.simulate.options import options as run_options

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Flight:
    """A run, and the linear maps along it."""

    result: Result
    chain: Chain

    def derivatives(self, times: Vector) -> Vector | None:
        """Of the signals by the parameters, shape (times, signals, parameters); None where they cannot be had."""
        try:
            found = self.chain.trajectory(times, self._states)
        except (AcausalError, RuntimeError, np.linalg.LinAlgError):
            return None
        return found if np.isfinite(found).all() else None

    @property
    def is_quick(self) -> bool:
        """Whether derivatives take compiled steps, or none."""
        try:
            return self.chain.is_quick()
        except (AcausalError, RuntimeError, np.linalg.LinAlgError):
            return False

    def _states(self, times: Vector) -> Vector:
        names = self.chain.compiled.states
        return np.column_stack([np.zeros((len(times), 0)), *(at(self.result, times, name) for name in names)])


def signals_of(compiled: CompiledModel, names: Sequence[str]) -> list[Output] | None:
    """The signals, where derivatives of runs exist; None where only differences do."""
    try:
        wanted = named_outputs(compiled, names)
        check(compiled, SENSITIVITIES, wanted)
    except AcausalError:
        return None
    return list(wanted)


@interruptible
def flight_of(
    compiled: CompiledModel,
    parameters: Mapping[str, object],
    options: Mapping[str, Any],
    names: Sequence[str],
    wanted: Sequence[Output],
) -> Flight | None:
    """The run with its maps; None where an input varies, or the run does not succeed as a plain one might."""
    own = {k: v for k, v in options.items() if k != "inputs"}
    chosen = run_options(compiled.flat.experiment, **own)
    p = parameter_vector(compiled, parameters)
    if not choices_stand_for(compiled, p.tolist()):
        return None
    inputs = given_inputs(compiled, options["inputs"], chosen.start_time, chosen.stop_time, chosen.tolerances)
    if inputs.places:
        return None
    run = Run(compiled, chosen, p, inputs, None, traced=True)
    try:
        result = run.result()
    except RunError:
        return None
    places = [compiled.parameters.index(name) for name in names]
    return Flight(result, Chain(run, places, wanted, chosen.tolerance))


def at(result: Result, times: Vector, name: str) -> Vector:
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
