"""Variant of a compiled model with located kinks, at which a rate that was constant for long may change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from weakref import WeakKeyDictionary

from acausal.analyse.events.located_kinks import MOST, LocatedKinks, located_kinks
from acausal.analyse.events.state_events import discrete_variables
from acausal.analyse.events.time_events import stretch_numbers
from acausal.flatten.pool import RELATIONS
from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel
from acausal.lower.subsystems.partition import system_of
from acausal.lower.subsystems.split import subsystems

_Made = tuple[CompiledModel | None, str]
_CACHE: WeakKeyDictionary[CompiledModel, dict[tuple[tuple[int, ...], bool], _Made]] = WeakKeyDictionary()
UNWATCHED_STEPS = 5000
"""No step is longer than one over this of a run in which some kinks are not located."""
_KINKS = frozenset(("min", "max", "fabs", "noevent"))
_BURSTS = frozenset(("exp", "pow"))
WAKING = _KINKS | _BURSTS | {"table"}
"""Operations (`CompiledModel.operations`) without which a model has no kinks to locate."""
_NAMED = 3
_WIDTH = 60


_BOUNDED = (
    f"no step is longer than 1/{UNWATCHED_STEPS} of the run instead, "
    "and what moves, or is steep, for less time may be missed"
)
UNWATCHED = (
    "AC414: kinks of this run (of minimum, maximum, abs, no_event) are not located as events, as one of them is passed "
    f"without end: {_BOUNDED}"
)
"""Note to a run in which no kinks are located."""


def with_watched(compiled: CompiledModel, relative: float, *, branches: bool = False) -> tuple[CompiledModel, str, str]:
    """The model with located kinks, for a solver with step-size control; the model itself where there are none.

    Also returns two notes, "" where there is nothing to say: on kinks too many to locate, whose steps are bounded
    instead, and on points of tables that are not stops.

    `relative`: tolerance of the run, which decides which points of its tables are kinks.
    `branches`: expresses kinks by modes, so that each side can be differentiated.

    Cached by model and located table points. Bursts are not located: the solution is searched for them afterwards
    (`acausal.simulate.driver.missed_events`).
    """
    variants = _CACHE.setdefault(compiled, {})
    numbers, passed = tuple[int, ...](), 0
    has_tables = "table" in compiled.operations
    if has_tables or ((), branches) not in variants:  # without tables the result does not depend on the tolerance
        solution = compiled.solution
        pool = solution.structure.reduced.pool
        roots = [*(n for v, n in solution.definitions if v in solution.needed), *solution.residuals]
        if has_tables:
            numbers, passed = stretch_numbers(pool, roots, dict(solution.definitions), relative)
        if (numbers, branches) not in variants:
            variants[numbers, branches] = _watched(compiled, roots, numbers, branches)
    model, note = variants[numbers, branches]
    return model or compiled, note, _tables_left(passed) if passed else ""


def _tables_left(count: int) -> str:
    return (
        f"no step ends at {count} points of tables of a variable, as there are very many that are about as far apart "
        "and bend about as much: a step may pass several at once; max_step bounds it"
    )


def _watched(compiled: CompiledModel, roots: Sequence[int], numbers: tuple[int, ...], branches: bool) -> _Made:
    """Locate as many kinks as allowed in each system that the model is split into, or else in the whole model."""
    partition = cache(lambda: system_of(compiled))  # lazy, because most models have no kinks to locate
    model, found = _lowered(compiled, roots, numbers, branches, lambda node: partition()(node))
    if len(found.watched) > MOST and model is not None and not subsystems(model):
        model, found = _lowered(compiled, roots, numbers, branches, lambda node: 0)
    return model, _note_on_unwatched(compiled, found) if found.left else ""


def _lowered(
    compiled: CompiledModel,
    roots: Sequence[int],
    numbers: tuple[int, ...],
    branches: bool,
    system: Callable[[int], int],
) -> tuple[CompiledModel | None, LocatedKinks]:
    solution = compiled.solution
    reduced = solution.structure.reduced
    pool = reduced.pool
    found = LocatedKinks()
    if any(pool.nodes[n][0] in _KINKS | _BURSTS for n in pool.reachable(roots)):
        split = [n for n in compiled.state_events.rewritten if pool.nodes[n][0] in RELATIONS]
        located = *compiled.state_events.relations, *compiled.time_events.relations, *split
        found = located_kinks(solution, located, discrete_variables(reduced), system)
    if not found.watched and not found.bursts and not numbers:
        return None, found
    lowered = lower(solution, compiled.driven, replace(found, numbers=numbers, branches=branches))
    lowered = replace(lowered, selection=compiled.selection, recipe=compiled.recipe, start=compiled.start)
    return replace(lowered, timings=dict(compiled.timings)), found


def _note_on_unwatched(compiled: CompiledModel, found: LocatedKinks) -> str:
    reduced = compiled.solution.structure.reduced

    def text_of(number: int) -> str:
        sides = [reduced.pool.nodes[n] for n in reduced.pool.nodes[number][1:]]
        inside = [
            node[1] if node[0] == "noevent" else n
            for node, n in zip(sides, reduced.pool.nodes[number][1:], strict=True)
        ]
        return " against ".join(reduced.text(n, _WIDTH) for n in inside)

    left = found.left
    texts = "; ".join(text_of(n) for n in left[:_NAMED])
    more = f"; and {len(left) - _NAMED} more" if len(left) > _NAMED else ""
    total = len(left) + len(found.watched)
    return (
        f"AC414: {len(left)} of {total} kinks (of minimum, maximum, abs, no_event) are too many to be located "
        f"({texts}{more}): {_BOUNDED}; write those that matter as a relation without no_event, or "
        "give a max_step shorter than the time for which they let something move"
    )
