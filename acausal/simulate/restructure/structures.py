"""Equations for each structure that runs of a model have had: a run that comes to one again finds it compiled.

A model is a recipe that does not change, and a choice says which structure it has (`Choice.structure`), so the two and
the values of parameters decide the equations. Of another model with equal components nothing is known here: its
equations are flattened, and recalled as those of any model are (`acausal.lower.cache.cache`).
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable, Mapping

from acausal.language.choices import Choice
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.lower.lowered import Recipe

_MOST, _MOST_NODES = 32, 1_000_000


class _Structures:
    """Those used last, as many as fit; the models are held, so that no other can be taken for them."""

    def __init__(self) -> None:
        self.entries: OrderedDict[Hashable, tuple[Component, CompiledModel]] = OrderedDict()
        self.lock = threading.Lock()

    def get(self, key: Hashable) -> CompiledModel | None:
        with self.lock:
            found = self.entries.get(key)
            if found is None:
                return None
            self.entries.move_to_end(key)
            return found[1]

    def put(self, key: Hashable, model: Component, compiled: CompiledModel) -> None:
        with self.lock:
            self.entries[key] = model, compiled
            self.entries.move_to_end(key)
            nodes = sum(len(c.solution.structure.reduced.pool.nodes) for _, c in self.entries.values())
            while len(self.entries) > 1 and (len(self.entries) > _MOST or nodes > _MOST_NODES):
                _, (_, least) = self.entries.popitem(last=False)
                nodes -= len(least.solution.structure.reduced.pool.nodes)


_structures = _Structures()


def structure(
    recipe: Recipe, parameters: Mapping[str, object], choices: Mapping[str, Choice]
) -> tuple[CompiledModel, bool]:
    """The compiled model for these choices, and whether it had to be compiled.

    `parameters` are those that are in it, by their names there.
    """
    key = _key(recipe, parameters, choices)
    known = None if key is None else _structures.get(key)
    if known is not None:
        return known, False
    compiled = compile(
        recipe.model,
        parameters=parameters,
        formulation=recipe.formulation,
        freeze=recipe.freeze,
        quasi_static=recipe.quasi_static,
        cache=recipe.cache,
        choices=choices,
    )
    if key is not None:
        _structures.put(key, recipe.model, compiled)
    return compiled, True


def _key(recipe: Recipe, parameters: Mapping[str, object], choices: Mapping[str, Choice]) -> Hashable | None:
    """What decides the equations; None where that is not known for certain."""
    if not recipe.cache or not all(type(v) in (int, float, str) for v in parameters.values()):
        return None
    wishes = recipe.formulation, recipe.freeze, recipe.quasi_static, tuple(parameters.items())
    return id(recipe.model), wishes, tuple((path, c.structure()) for path, c in choices.items())
