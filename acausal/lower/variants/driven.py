"""The same model with some of its inputs as functions of time.

An input over time is data, not part of the model: over each stretch of a run it is a polynomial, whose coefficients are
numbers among the modes, as those of delayed signals are. Other data are other numbers, and nothing is compiled again.
"""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel

_MADE: WeakKeyDictionary[CompiledModel, dict[tuple[int, ...], CompiledModel]] = WeakKeyDictionary()


def with_driven(compiled: CompiledModel, places: tuple[int, ...]) -> CompiledModel:
    """The model whose inputs at these places of u are functions of time; made once for each model and choice."""
    if not places:
        return compiled
    made = _MADE.setdefault(compiled, {})
    if places not in made:
        lowered = lower(compiled.solution, places)
        made[places] = replace(lowered, selection=compiled.selection, timings=dict(compiled.timings))
    return made[places]
