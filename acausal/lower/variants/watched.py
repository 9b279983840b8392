"""The same model with the kinks watched at which a rate that is constant for long may wake."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from weakref import WeakKeyDictionary

from acausal.analyse.events.bursts import may_burst
from acausal.analyse.events.sleeping import MOST, Sleeping, sleeping
from acausal.analyse.events.state_events import discrete_variables
from acausal.analyse.events.table_stops import stretch_numbers
from acausal.flatten.pool import RELATIONS
from acausal.flatten.text import to_text
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup
from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel
from acausal.lower.subsystems.partition import system_of
from acausal.lower.subsystems.split import subsystems

_Made = tuple[CompiledModel | None, str]
_MADE: WeakKeyDictionary[CompiledModel, dict[tuple[tuple[int, ...], bool], _Made]] = WeakKeyDictionary()
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


def with_watched(compiled: CompiledModel, relative: float, stops: bool = True) -> tuple[CompiledModel, tuple[str, ...]]:
    """The model for a solver that chooses its steps, at a relative tolerance, and notes; itself where nothing sleeps.

    Made once for each, and for what of its tables the tolerance can tell. Bursts are watched where something else is,
    and the solver `stops` at guards by itself; otherwise what it hands over is searched for what it has passed over
    (`acausal.simulate.driver.overlooked`).
    """
    made = _MADE.setdefault(compiled, {})
    numbers: tuple[int, ...] = ()
    if _has_tables(compiled) or ((), stops) not in made:  # without, it is the same for all tolerances
        solution = compiled.solution
        pool = solution.structure.reduced.pool
        roots = [*(n for v, n in solution.definitions if v in solution.needed), *solution.residuals]
        if _has_tables(compiled):
            numbers = stretch_numbers(pool, roots, dict(solution.definitions), relative)
        if (numbers, stops) not in made:
            made[numbers, stops] = _watched(compiled, roots, numbers, stops)
    model, note = made[numbers, stops]
    return model or compiled, (note,) if note else ()


_TABLES: WeakKeyDictionary[CompiledModel, bool] = WeakKeyDictionary()


def _has_tables(compiled: CompiledModel) -> bool:
    """Whether there is a long table in the equations."""
    if compiled not in _TABLES:
        ops = {node[0] for node in compiled.solution.structure.reduced.pool.nodes}
        _TABLES[compiled] = any(isinstance(op, Call) and isinstance(op.external, Lookup) for op in ops)
    return _TABLES[compiled]


def _watched(compiled: CompiledModel, roots: Sequence[int], numbers: tuple[int, ...], stops: bool) -> _Made:
    """As much as can be watched in each of the systems that the model is split into, or else in the whole."""
    parted = cache(lambda: system_of(compiled))  # of most models nothing is watched in any part
    model, found = _lowered(compiled, roots, numbers, stops, lambda node: parted()(node))
    if len(found.watched) > MOST and model is not None and not subsystems(model):
        model, found = _lowered(compiled, roots, numbers, stops, lambda node: 0)
    return model, _left(compiled, found) if found.left or found.more else ""


def _lowered(
    compiled: CompiledModel,
    roots: Sequence[int],
    numbers: tuple[int, ...],
    stops: bool,
    system: Callable[[int], int],
) -> tuple[CompiledModel | None, Sleeping]:
    solution = compiled.solution
    reduced = solution.structure.reduced
    pool = reduced.pool
    found = Sleeping()
    if any(pool.nodes[n][0] in _KINKS or may_burst(pool, n) for n in pool.reachable(roots)):
        split = [n for n in compiled.state_events.rewritten if pool.nodes[n][0] in RELATIONS]
        located = *compiled.state_events.relations, *compiled.time_events.relations, *split
        found = sleeping(solution, located, discrete_variables(reduced), system)
        if not stops or (compiled.state_events.are_silent and not found.watched and not numbers):
            found = found.without_bursts()
    if not found.watched and not found.bursts and not numbers:
        return None, found
    lowered = lower(solution, compiled.driven, replace(found, numbers=numbers))
    lowered = replace(lowered, selection=compiled.selection, recipe=compiled.recipe, start=compiled.start)
    return replace(lowered, timings=dict(compiled.timings)), found


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

    left = *found.left, *found.more
    texts = "; ".join(said(n) for n in left[:_NAMED])
    more = f"; and {len(left) - _NAMED} more" if len(left) > _NAMED else ""
    whole = len(left) + len(found.watched) + len(found.middles)
    return (
        f"AC414: {len(left)} of {whole} kinks and bursts where rates may wake are too many to be watched "
        f"({texts}{more}): {_bounded(UNWATCHED_STEPS)}; locate those that matter by a relation without no_event, or "
        "give a max_step that is shorter than what they are awake"
    )
