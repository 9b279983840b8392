"""The same model with the kinks watched at which a rate that is constant for long may wake."""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

from acausal.analyse.sleeping import MOST, sleeping
from acausal.analyse.state_events import discrete_variables
from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel

_MADE: WeakKeyDictionary[CompiledModel, tuple[CompiledModel | None, str]] = WeakKeyDictionary()
UNWATCHED_STEPS = 5000
"""No step is longer than this part of a run whose kinks are not watched."""
_BOUNDED = f"no step is longer than 1/{UNWATCHED_STEPS} of the run instead, and what wakes for less may be passed"
UNWATCHED = f"its kinks cannot be watched in this run: {_BOUNDED}"
_KINKS = frozenset(("min", "max", "fabs", "noevent"))


def with_watched(compiled: CompiledModel) -> tuple[CompiledModel, tuple[str, ...]]:
    """The model for a solver that chooses its steps, and notes; itself where nothing sleeps. Made once for each."""
    if compiled not in _MADE:
        _MADE[compiled] = _watched(compiled)
    model, note = _MADE[compiled]
    return model or compiled, (note,) if note else ()


def _watched(compiled: CompiledModel) -> tuple[CompiledModel | None, str]:
    solution = compiled.solution
    reduced = solution.structure.reduced
    roots = [*(n for v, n in solution.definitions if v in solution.needed), *solution.residuals]
    if not any(reduced.pool.nodes[n][0] in _KINKS for n in reduced.pool.reachable(roots)):
        return None, ""
    located = *compiled.state_events.relations, *compiled.time_events.relations
    found = sleeping(solution, located, discrete_variables(reduced))
    if found is None:
        return None, f"more than {MOST} kinks at which rates may wake: {_BOUNDED}"
    if not found:
        return None, ""
    lowered = lower(solution, compiled.driven, found)
    lowered = replace(lowered, selection=compiled.selection, recipe=compiled.recipe, start=compiled.start)
    return replace(lowered, timings=dict(compiled.timings)), ""
