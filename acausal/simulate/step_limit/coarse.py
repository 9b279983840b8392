"""The note on fixed steps that are too long for what happens within a few of them.

Eigenvalues at rows (`limit.py`) do not show a contact that lasts one step: a drill that a step carries into a stiff
plate is thrown out of it by the next one. The intervals between rows at which a state bends most are integrated again
with a quarter of the step.
"""

from __future__ import annotations

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.meeting.between import Again
from acausal.simulate.record.record import Recorder

# The most intervals that are integrated again, the most steps in one of them, and the least bend that counts, relative
# to the largest magnitude of a state so far.
_INTERVALS, _STEPS, _BEND = 6, 2000, 1e-2
# The least difference that is noted, on the same scale.
_DIFFERENCE = 0.1
# The number of rows after which states are compared, and the fraction of the run within which rows are one instant.
_ROWS, _SAME_INSTANT = 6, 1e-9
# A state is not judged below this fraction of its nominal value.
_SMALL = 1e-2


def coarse_steps(problem: Problem, recorder: Recorder, again: Again, step: float) -> tuple[str, ...]:
    """A note if a quarter of the step [s] leads to another state some rows later; else nothing.

    Some rows later, because an implicit method forgets what it has made of a fast transient.

    `again`: Integrates from one of the rows on.
    """
    n = problem.n_dynamic
    times, x, _, m = recorder.rows()
    if not n or len(times) < 3:
        return ()
    x, wide = x[:n], np.diff(times) > _SAME_INSTANT * (times[-1] - times[0])
    size = np.maximum.accumulate(np.abs(x), axis=1) + _SMALL * problem.scale_x[:, None]
    goes_on = wide & (m[:, 1:] == m[:, :-1]).all(axis=0)
    for k in _bends(times, x, size, goes_on):
        last = k + int(np.argmin([*goes_on[k : k + _ROWS], False]))
        count = int(np.ceil((times[k + 1 : last + 1] - times[k:last]).max(initial=0.0) / step - 1e-9))
        if not 0 < (last - k) * count <= _STEPS:
            continue
        parts = np.arange(1, 4 * count + 1) / (4 * count)
        quarters = (times[k:last, None] + parts * np.diff(times[k : last + 1])[:, None]).ravel()
        try:
            found = again(k, quarters)[1][:n, -1]
        except RuntimeError:
            continue
        difference = np.abs(found - x[:, last]) / np.maximum(size[:, last], np.abs(found))
        worst = int(np.argmax(difference))
        if not difference[worst] <= _DIFFERENCE:
            return (
                f"steps of {step:.4g} s are too long at t = {times[k]:.6g} s: with a quarter of that "
                f"{problem.compiled.states[worst]} is {found[worst]:.4g} at t = {times[last]:.6g} s, not "
                f"{x[worst, last]:.4g}; take shorter ones, or a solver that chooses them",
            )
    return ()


def _bends(times: Vector, x: Vector, size: Vector, goes_on: Truth) -> list[int]:
    """The rows before intervals in which the mean rate of a state differs most from those beside it.

    `goes_on`: Whether nothing happens between a row and the next, and time passes.
    """
    gaps = np.where(goes_on, np.diff(times), np.inf)
    change = np.abs(np.diff(np.diff(x) / gaps)) * (goes_on[1:] & goes_on[:-1])
    none = np.zeros((len(x), 1))
    bend = np.maximum(np.hstack([none, change]), np.hstack([change, none]))
    worst = (bend * np.where(goes_on, gaps, 0.0) / size[:, 1:]).max(axis=0)
    worst[~np.isfinite(worst)] = 0.0
    return [k for k in np.argsort(-worst, kind="stable")[:_INTERVALS].tolist() if worst[k] > _BEND]
