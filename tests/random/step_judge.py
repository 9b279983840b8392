"""What steps of random models say about their errors, and what these are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import acausal
from acausal import AcausalError
from tests.random.step_models import built

STOP, ROW = 1.0, 0.025
# Errors by nominal values that rounding, and the reference at a tolerance of 1e-10, may leave.
_NOTHING = 1e-7


@dataclass(frozen=True)
class Told:
    """A run of steps up to the first flag: its largest error, the sum of the estimates, and the largest quotient."""

    seed: int
    method: str
    step: float
    error: float
    estimate: float
    ratio: float
    flagged: bool
    at: float
    state: str


def told(seed: int, methods: tuple[str, ...], steps: tuple[float, ...]) -> Iterator[Told]:
    """Runs of one model, compared at multiples of 25 ms with a run at 1e-10."""
    compiled = acausal.compile(built(seed))
    states = compiled.states[: compiled.n_dynamic]
    times = ROW * np.arange(1, round(STOP / ROW) + 1)
    if not states:
        return
    try:
        reference = acausal.simulate(
            compiled, stop_time=STOP, output_interval=ROW, tolerance=1e-10, solver="rosenbrock"
        )
    except AcausalError:
        return
    last = np.searchsorted(reference.time, times + 1e-9) - 1
    wanted = np.column_stack([reference[name][last] for name in states])
    for h in steps:
        for method in methods:
            yield _compared(acausal.step_function(compiled, h, method, []), seed, states, times, wanted)


def _compared(
    step: acausal.StepFunction, seed: int, states: tuple[str, ...], times: np.ndarray, wanted: np.ndarray
) -> Told:
    x, p = np.array(step.x.start), np.array(step.p.start)
    places, own = [step.x.position(name) for name in states], step.y.position("step.error")
    error = estimate = ratio = 0.0
    at, state, flagged = 0.0, "", False
    for t, row in zip(times, wanted, strict=True):
        for _ in range(round(ROW / step.step)):
            x, y = (np.asarray(v).ravel() for v in step.function(x, np.zeros(0), p))
            estimate += y[own]
            flagged = flagged or bool(np.delete(y, own).any())
        if flagged:
            break
        off = np.abs(x[places] - row)
        off[np.isnan(off)] = np.inf
        error = max(error, float(off.max()))
        if off.max() / (estimate + _NOTHING) > ratio:
            ratio, at, state = float(off.max() / (estimate + _NOTHING)), float(t), states[int(off.argmax())]
    return Told(seed, step.method, step.step, error, float(estimate), ratio, flagged, at, state)
