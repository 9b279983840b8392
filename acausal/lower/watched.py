"""The same model with the kinks watched at which a rate that is constant for long may wake."""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

from acausal.analyse.bursts import may_burst
from acausal.analyse.sleeping import Sleeping, sleeping
from acausal.analyse.state_events import discrete_variables
from acausal.flatten.text import to_text
from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel

_MADE: WeakKeyDictionary[CompiledModel, tuple[CompiledModel | None, str]] = WeakKeyDictionary()
UNWATCHED_STEPS = 5000
"""No step is longer than this part of a run whose kinks are not all watched."""
_KINKS = frozenset(("min", "max", "fabs", "noevent"))
_NAMED = 3
_WIDTH = 60


def unwatched(steps: int) -> str:
    """What is said of a run in which nothing is watched, and that takes so many steps at least."""
    what = "kinks and bursts of this run cannot be watched, as one of them is passed without end or too often"
    return f"AC414: {what}: {_bounded(steps)}"


def _bounded(steps: int) -> str:
    return f"no step is longer than 1/{steps} of the run instead, and what wakes for less may be passed"


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
    pool = reduced.pool
    if not any(pool.nodes[n][0] in _KINKS or may_burst(pool, n) for n in pool.reachable(roots)):
        return None, ""
    located = *compiled.state_events.relations, *compiled.time_events.relations
    found = sleeping(solution, located, discrete_variables(reduced))
    note = _left(compiled, found) if found.left else ""
    if not found.watched and not found.middles:
        return None, note
    lowered = lower(solution, compiled.driven, found)
    lowered = replace(lowered, selection=compiled.selection, recipe=compiled.recipe, start=compiled.start)
    return replace(lowered, timings=dict(compiled.timings)), note


def _left(compiled: CompiledModel, found: Sleeping) -> str:
    reduced = compiled.solution.structure.reduced

    def name_of(kind: str, k: int) -> str:
        return reduced.name(k) if kind == "var" else compiled.parameters[k]

    def said(number: int) -> str:
        sides = [reduced.pool.nodes[n] for n in reduced.pool.nodes[number][1:]]
        inside = [
            node[1] if node[0] == "noevent" else n
            for node, n in zip(sides, reduced.pool.nodes[number][1:], strict=True)
        ]
        return " against ".join(to_text(reduced.pool, n, name_of, _WIDTH) for n in inside)

    texts = "; ".join(said(n) for n in found.left[:_NAMED])
    more = f"; and {len(found.left) - _NAMED} more" if len(found.left) > _NAMED else ""
    left, whole = len(found.left), len(found.left) + len(found.watched) + len(found.middles)
    return (
        f"AC414: {left} of {whole} kinks and bursts where rates may wake are too many to be watched ({texts}{more}): "
        f"{_bounded(UNWATCHED_STEPS)}; locate those that matter by a relation without no_event, or give a max_step "
        "that is shorter than what they are awake"
    )
