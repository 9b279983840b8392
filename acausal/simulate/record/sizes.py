"""The note on states that stay so small in a run that its absolute tolerance does not resolve them.

A solver controls errors of a state down to its absolute tolerance, a thousandth of the relative one times the nominal
magnitude. An oscillation of a nanometre without a declared `nominal` is negligible for it at a tolerance of 1e-6: the
solver takes arbitrarily long steps, and results that depend on the state are wrong altogether. Only a declaration can
say which accuracy such a state needs, but the run reveals that it was not resolved.

States that symmetry keeps at zero up to rounding errors are small as well, but need no note. A state is one of them if
it begins at zero, and its rate vanishes up to rounding errors where all small states are zero. Rounding errors of a
rate are estimated by perturbing all variables on which it depends.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.diagnose.words import listed
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Tolerances

# A state is unresolved if it never exceeds this many absolute tolerances: less than three of its digits are accurate.
_DIGITS = 1000.0
# In nominal magnitudes: values that count as zero, for given start values and for those that are solved for.
_ZERO, _SOLVED = 1e-14, 1e-9
# Perturbation of states by rounding, the factor by which a rate must exceed the resulting noise to be nonzero, and the
# perturbation of algebraic variables, by the accuracy of Newton's method.
_ROUNDING, _MOST_ROUNDINGS, _NEWTON = 4e-16, 30.0, 1e-10
Rows = tuple[Vector, Vector, Vector, Vector]
_INDICES = re.compile(r"\[\d+\]")
# With more steps per row than this, rows do not show how large states become between them.
_MOST_STEPS_PER_ROW = 5.0
# Rows miss a state that changes between rows, by its rate at the start, more than this many times its recorded size.
_MOST_HIDDEN_CHANGE = 100.0
# Number of rows that are examined, and of perturbations at each.
_ROWS, _PERTURBATIONS = 6, 4


def unresolved(recorder: Recorder, p: Vector, u: Vector, tolerances: Tolerances) -> tuple[str, ...]:
    """The note on states that are not resolved by the tolerances of the run; empty if there are none."""
    compiled = recorder.compiled
    n, nominal = compiled.n_dynamic, compiled.nominal_x
    if n == 0:
        return ()
    if recorder.counters.get("steps", 0.0) > _MOST_STEPS_PER_ROW * recorder.count:
        return ()
    largest, least = recorder.magnitudes(n), tolerances.absolute * nominal[:n]
    if not (largest < _DIGITS * least).any():
        return ()
    largest = _of_vectors(compiled, largest)
    small = np.flatnonzero((largest > _ZERO * nominal[:n]) & (largest < _DIGITS * least))
    if not small.size:
        return ()
    rows = recorder.rows()
    solved = bool(compiled.algebraic) or compiled.solution.structure.rate is not None
    begins_nonzero = np.abs(rows[1][small, 0]) > (_SOLVED if solved else _ZERO) * nominal[small]
    unresolved_states = small[
        (begins_nonzero | _driven(recorder, small, p, u, rows)) & _shown(recorder, small, p, u, rows)
    ]
    if not unresolved_states.size:
        return ()
    k = int(unresolved_states[np.argmin(largest[unresolved_states] / nominal[unresolved_states])])
    names = [compiled.states[j] for j in unresolved_states.tolist()]
    stay = "stays" if len(names) == 1 else "stay"
    return (
        f"{listed(names, 4)} {stay} so small that a tolerance of {tolerances.relative:g} does not resolve "
        f"{'it' if len(names) == 1 else 'them'}: {compiled.states[k]} is {largest[k]:.1g} at most, and errors of "
        f"{least[k]:.1g} are allowed, a thousandth of the tolerance times its nominal magnitude; declare "
        f"variable(nominal={largest[k]:.0e}), or tighten the tolerance",
    )


def _of_vectors(compiled: CompiledModel, largest: Vector) -> Vector:
    """For each state, the largest magnitude in its vector or list: a cell ahead of a front is accurate enough."""
    vectors = _vectors(compiled)[: len(largest)]
    most = np.zeros(int(vectors.max()) + 1)
    np.maximum.at(most, vectors, largest)
    return np.asarray(most[vectors])


@once_per_owner
def _vectors(compiled: CompiledModel) -> NDArray[np.int64]:
    """For each state, the number of its vector or list."""
    numbers: dict[str, int] = {}
    names = (_INDICES.sub("", name) for name in compiled.states)
    return np.array([numbers.setdefault(name, len(numbers)) for name in names], dtype=np.int64)


def _shown(recorder: Recorder, small: NDArray[np.intp], p: Vector, u: Vector, rows: Rows) -> NDArray[np.bool_]:
    """Whether rows show each small state, shape (small,): not if it has a transient between the first two rows."""
    times, x, z, m = rows
    rate = np.asarray(functions_of(recorder.compiled).rhs(times[0], x[:, 0], z[:, 0], u, p, m[:, 0])[0])[small]
    longest = float(np.diff(times).max(initial=0.0))
    shown = np.abs(rate) * longest <= _MOST_HIDDEN_CHANGE * np.abs(x[small]).max(axis=1)
    return np.asarray(shown)


def _driven(recorder: Recorder, small: NDArray[np.intp], p: Vector, u: Vector, rows: Rows) -> NDArray[np.bool_]:
    """Whether each small state leaves zero, by more than rounding, where all of them are zero; shape (small,)."""
    compiled, (times, x, z, m) = recorder.compiled, rows
    rhs, random = functions_of(compiled).rhs, np.random.default_rng(0)
    is_driven = np.zeros(len(small), dtype=bool)
    for row in np.unique(np.linspace(0, len(times) - 1, _ROWS).astype(int)).tolist():
        states = x[:, row].copy()
        states[small] = 0.0
        arguments = u, p, m[:, row]
        rate = np.asarray(rhs(times[row], states, z[:, row], *arguments)[0])[small]
        noise = np.zeros(len(small))
        for _ in range(_PERTURBATIONS):
            perturbed = states * (1.0 + _ROUNDING * random.uniform(-1.0, 1.0, len(states)))
            perturbed_z = z[:, row] + _NEWTON * compiled.nominal_z * random.uniform(-1.0, 1.0, len(z))
            perturbed_rate = np.asarray(rhs(times[row], perturbed, perturbed_z, *arguments)[0])[small]
            noise = np.maximum(noise, np.abs(perturbed_rate - rate))
        is_driven |= np.isfinite(rate) & (np.abs(rate) > _MOST_ROUNDINGS * noise) & (np.abs(rate) > 0.0)
    return is_driven
