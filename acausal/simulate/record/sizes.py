"""States that stay so small in a run that its absolute tolerance knows little of them, and what is said of these.

A solver asks for no more of a state than its absolute tolerance, a thousandth of the relative one times the nominal
magnitude. An oscillation of a nanometre without a declared `nominal` is nothing to it at 1e-6: it takes steps as long
as it likes, and what follows from the state is wrong altogether. What is wanted of such a state, only its declaration
says; that little is known of it, the run does.

Small are also states that symmetry keeps at zero, but for rounding: these are no news. A state is one of them if it
begins at zero and its rate vanishes, to rounding, where all the small states are zero. Rounding is what becomes of the
rate when everything it is made of moves by that much.
"""

from __future__ import annotations

import re
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.diagnose.words import listed
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Tolerances

# A state is noted that never becomes as large as so many absolute tolerances: less than three digits of it are known.
_DIGITS = 1000.0
# In nominal magnitudes: what is rounding in any case, and what a start is known to that is solved for.
_GIVEN, _SOLVED = 1e-14, 1e-9
# Roundings by which states move, and so many times as large a rate must be to be none. Algebraic variables move by what
# Newton's method leaves of them.
_ROUNDING, _CLEAR, _NEWTON = 4e-16, 30.0, 1e-10
Rows = tuple[Vector, Vector, Vector, Vector]
_INDICES = re.compile(r"\[\d+\]")
# Steps for each row beyond which rows do not tell how large a state becomes between them.
_STEPS = 5.0
# So many times as far as rows show a state may go from one to the next by its rate, or they do not show it.
_FARTHER = 100.0
# Rows that are looked at, and how often everything moves at each.
_ROWS, _MOVES = 6, 4


def unresolved(recorder: Recorder, p: Vector, u: Vector, tolerances: Tolerances) -> tuple[str, ...]:
    """The note on states that are not resolved by the tolerances of the run; nothing where there are none."""
    compiled = recorder.compiled
    n, nominal = compiled.n_dynamic, compiled.nominal_x
    if n == 0:
        return ()
    if recorder.counters.get("steps", 0.0) > _STEPS * recorder.count:
        return ()
    largest, least = recorder.magnitudes(n), tolerances.absolute * nominal[:n]
    if not (largest < _DIGITS * least).any():
        return ()
    largest = _of_vectors(compiled, largest)
    small = np.flatnonzero((largest > _GIVEN * nominal[:n]) & (largest < _DIGITS * least))
    if not small.size:
        return ()
    rows = recorder.rows()
    solved = bool(compiled.algebraic) or compiled.solution.structure.rate is not None
    begun = np.abs(rows[1][small, 0]) > (_SOLVED if solved else _GIVEN) * nominal[small]
    told = small[(begun | _driven(recorder, small, p, u, rows)) & _shown(recorder, small, p, u, rows)]
    if not told.size:
        return ()
    k = int(told[np.argmin(largest[told] / nominal[told])])
    names = [compiled.states[j] for j in told.tolist()]
    stay = "stays" if len(names) == 1 else "stay"
    return (
        f"{listed(names, 4)} {stay} so small that a tolerance of {tolerances.relative:g} knows little of it: "
        f"{compiled.states[k]} is {largest[k]:.1g} at most, and errors of {least[k]:.1g} are allowed, a thousandth of "
        f"the tolerance times its nominal magnitude; declare variable(nominal={largest[k]:.0e}), or tighten the "
        "tolerance",
    )


# The same for all runs of a model.
_VECTORS: WeakKeyDictionary[CompiledModel, NDArray[np.int64]] = WeakKeyDictionary()


def _of_vectors(compiled: CompiledModel, largest: Vector) -> Vector:
    """Of each state the largest magnitude in its vector or list: a cell ahead of a front is known well enough."""
    if compiled not in _VECTORS:
        numbers: dict[str, int] = {}
        names = (_INDICES.sub("", name) for name in compiled.states)
        _VECTORS[compiled] = np.array([numbers.setdefault(name, len(numbers)) for name in names], dtype=np.int64)
    vectors = _VECTORS[compiled][: len(largest)]
    most = np.zeros(int(vectors.max()) + 1)
    np.maximum.at(most, vectors, largest)
    return np.asarray(most[vectors])


def _shown(recorder: Recorder, small: NDArray[np.intp], p: Vector, u: Vector, rows: Rows) -> NDArray[np.bool_]:
    """Of each small state whether rows show it: not what begins with a transient between the first two of them."""
    times, x, z, m = rows
    rate = np.asarray(functions_of(recorder.compiled).rhs(times[0], x[:, 0], z[:, 0], u, p, m[:, 0])[0])[small]
    longest = float(np.diff(times).max(initial=0.0))
    shown = np.abs(rate) * longest <= _FARTHER * np.abs(x[small]).max(axis=1)
    return np.asarray(shown)


def _driven(recorder: Recorder, small: NDArray[np.intp], p: Vector, u: Vector, rows: Rows) -> NDArray[np.bool_]:
    """Of each small state whether it leaves zero where all of them are zero, by more than rounding."""
    compiled, (times, x, z, m) = recorder.compiled, rows
    rhs, random = functions_of(compiled).rhs, np.random.default_rng(0)
    found = np.zeros(len(small), dtype=bool)
    for row in np.unique(np.linspace(0, len(times) - 1, _ROWS).astype(int)).tolist():
        states = x[:, row].copy()
        states[small] = 0.0
        given = u, p, m[:, row]
        rate = np.asarray(rhs(times[row], states, z[:, row], *given)[0])[small]
        noise = np.zeros(len(small))
        for _ in range(_MOVES):
            moved = states * (1.0 + _ROUNDING * random.uniform(-1.0, 1.0, len(states)))
            guess = z[:, row] + _NEWTON * compiled.nominal_z * random.uniform(-1.0, 1.0, len(z))
            other = np.asarray(rhs(times[row], moved, guess, *given)[0])[small]
            noise = np.maximum(noise, np.abs(other - rate))
        found |= np.isfinite(rate) & (np.abs(rate) > _CLEAR * noise) & (np.abs(rate) > 0.0)
    return found
