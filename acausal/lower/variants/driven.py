"""Variant of a compiled model with some inputs as functions of time.

An input over time is data, not part of the model: over each stretch of a run it is a polynomial whose coefficients are
modes, like those of delayed signals. Other data are other coefficients, and nothing is compiled again.
"""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel

_CACHE: WeakKeyDictionary[CompiledModel, dict[tuple[int, ...], CompiledModel]] = WeakKeyDictionary()


def with_driven(compiled: CompiledModel, places: tuple[int, ...]) -> CompiledModel:
    """The model whose inputs at these indices of u are functions of time; cached by model and indices."""
    if not places:
        return compiled
    variants = _CACHE.setdefault(compiled, {})
    if places not in variants:
        lowered = lower(compiled.solution, places)
        variants[places] = replace(lowered, selection=compiled.selection, timings=dict(compiled.timings))
    return variants[places]
