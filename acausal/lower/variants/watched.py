"""Variant of a compiled model that locates kinks, where a rate that has long been constant may change."""

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
"""No step is longer than the duration of the run divided by this if some kinks are not located."""
_KINKS = frozenset(("min", "max", "fabs", "noevent"))
_BURSTS = frozenset(("exp", "pow"))
LOCATABLE = _KINKS | _BURSTS | {"table"}
"""Operations (`CompiledModel.operations`) that have kinks; a model without any of them has no kinks to locate."""
_MOST_NAMED = 3
_WIDTH = 60


_STEP_BOUND = (
    f"no step is longer than 1/{UNWATCHED_STEPS} of the run instead, "
    "and a motion or a burst that is shorter may be missed"
)
UNWATCHED = (
    "AC414: kinks of this run (of minimum, maximum, abs, no_event) are not located, because one of them is crossed "
    f"again and again: {_STEP_BOUND}"
)
"""Note to a run in which no kinks are located."""


def with_watched(compiled: CompiledModel, relative: float, *, branches: bool = False) -> tuple[CompiledModel, str, str]:
    """The model with located kinks, for a solver with step-size control; the model itself if it has none.

    Also returns two notes, "" if there is nothing to note: on kinks that are too many to locate, so that the steps are
    bounded instead, and on points of tables that are not stops.

    `relative` is the tolerance of the run, which decides which points of its tables are kinks. `branches` expresses
    kinks by modes, so that each side can be differentiated.

    Cached by model and located table points. Bursts are not located: the solution is searched for them afterwards
    (`acausal.simulate.driver.missed.missed_events`).
    """
    variants = _CACHE.setdefault(compiled, {})
    numbers, unlocated_ends = tuple[int, ...](), 0
    has_tables = "table" in compiled.operations
    if has_tables or ((), branches) not in variants:  # without tables the result does not depend on the tolerance
        solution = compiled.solution
        pool = solution.structure.reduced.pool
        roots = [*(n for v, n in solution.definitions if v in solution.needed), *solution.residuals]
        if has_tables:
            numbers, unlocated_ends = stretch_numbers(pool, roots, dict(solution.definitions), relative)
        if (numbers, branches) not in variants:
            variants[numbers, branches] = _watched(compiled, roots, numbers, branches)
    model, note = variants[numbers, branches]
    return model or compiled, note, _note_on_tables(unlocated_ends) if unlocated_ends else ""


def _note_on_tables(count: int) -> str:
    return (
        f"no step ends at {count} points of tables of a variable, because very many have about the same distance and "
        "the same change of slope: a step may pass several at once; max_step bounds it"
    )


def _watched(compiled: CompiledModel, roots: Sequence[int], numbers: tuple[int, ...], branches: bool) -> _Made:
    """Locate as many kinks as allowed: per system if the model is split into systems, else in the whole model."""
    partition = cache(lambda: system_of(compiled))  # lazy, because most models have no kinks to locate
    model, kinks = _lowered(compiled, roots, numbers, branches, lambda node: partition()(node))
    if len(kinks.watched) > MOST and model is not None and not subsystems(model):
        model, kinks = _lowered(compiled, roots, numbers, branches, lambda node: 0)
    return model, _note_on_unwatched(compiled, kinks) if kinks.unlocated else ""


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
    kinks = LocatedKinks()
    if any(pool.nodes[n][0] in _KINKS | _BURSTS for n in pool.reachable(roots)):
        located = {*compiled.state_events.relations, *compiled.time_events.relations}
        images = compiled.state_events.rewritten.items()
        # those below `no_event` have images, too, but no guards
        located |= {n for n, image in images if pool.nodes[n][0] in RELATIONS and located & {*pool.reachable([image])}}
        kinks = located_kinks(solution, located, discrete_variables(reduced), system, slopes=branches)
    if not kinks.watched and not kinks.bursts and not numbers:
        return None, kinks
    lowered = lower(solution, compiled.driven, replace(kinks, numbers=numbers, branches=branches))
    lowered = replace(lowered, selection=compiled.selection, recipe=compiled.recipe, start=compiled.start)
    return replace(lowered, timings=dict(compiled.timings)), kinks


def _note_on_unwatched(compiled: CompiledModel, kinks_found: LocatedKinks) -> str:
    reduced = compiled.solution.structure.reduced

    def text_of(number: int) -> str:
        sides = [reduced.pool.nodes[n] for n in reduced.pool.nodes[number][1:]]
        inside = [
            node[1] if node[0] == "noevent" else n
            for node, n in zip(sides, reduced.pool.nodes[number][1:], strict=True)
        ]
        return " against ".join(reduced.text(n, _WIDTH) for n in inside)

    unlocated = kinks_found.unlocated
    texts = "; ".join(text_of(n) for n in unlocated[:_MOST_NAMED])
    more = f"; and {len(unlocated) - _MOST_NAMED} more" if len(unlocated) > _MOST_NAMED else ""
    total = len(unlocated) + len(kinks_found.watched)
    return (
        f"AC414: {len(unlocated)} of {total} kinks (of minimum, maximum, abs, no_event) are too many to be located "
        f"({texts}{more}): {_STEP_BOUND}; write those that matter as a relation without no_event, or "
        "give a max_step shorter than the motion that they cause"
    )
