"""Contacts that cannot occur in a reduced model: bounds prove which pairs of bodies can touch.

Which bodies move depends on which touch each other, and vice versa. The set of pairs is therefore extended step by
step: the model is solved without any contact, and the poses of the bodies are bounded (`acausal.reduce.motionless`).
Pairs whose bounds overlap are added to the equations, and so on until no pair is added. The last model is correct: as
long as no other pair has touched, it moves as computed, and moving so, no other pair can touch.

This applies to components with a choice of structures (`acausal.language.choices`), such as
`library/contact/scene/scene.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from acausal.analyse.blocks.solve import Solution
from acausal.errors import UsageError
from acausal.flatten.instances.instances import components
from acausal.language.choices import Choice, is_changing
from acausal.language.component import Component
from acausal.reduce.motionless import bounds
from acausal.reduce.outputs import output_scalars
from acausal.reduce.select import Dropped

CONTACT = "contact"
Solved = Callable[[Sequence[str], Mapping[str, Choice]], Solution]
"""Returns the solution that some signals need, for the model with these choices."""


def confined(model: Component, solved: Solved) -> tuple[dict[str, Choice], tuple[Dropped, ...]]:
    """Choices with the contacts that can occur, by path, and the contacts that were left out.

    Raises UsageError: AC027 if contacts are kept that change the structure during a run, such as drills that make
    several holes.
    """
    choices: dict[str, Choice] = {path: c.least(True) for path, c in components(model) if is_changing(c)}
    growing = list(choices)
    while growing:
        extended = {path: _extended(path, choices, solved) for path in choices}
        choices = {path: choice for path, (choice, _) in extended.items()}
        growing = [path for path, (_, grown) in extended.items() if grown]
    for path, choice in choices.items():
        refuse_unsteady(type(model).__name__, {path: choice}, "it cannot be reduced")
    return choices, tuple(Dropped(CONTACT, f"{path}: {n}", why) for path, c in choices.items() for n, why in c.apart())


def _extended(path: str, choices: Mapping[str, Choice], solved: Solved) -> tuple[Choice, bool]:
    """Bound the poses and extend the choice by the contacts that are possible within the bounds."""
    choice = choices[path]
    names = choice.poses()
    if not names:
        return choice.confined({})
    solution = solved([_named(path, name) for name in names], choices)
    reduced = solution.structure.reduced
    bounds_of = {}
    for name in names:
        scalars = output_scalars(reduced.flat, [_named(path, name)])
        low, high = np.array(bounds(solution, [reduced.image[s] for s in scalars.values()])).T
        bounds_of[name] = low, high
    return choice.confined(bounds_of)


def _named(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def refuse_unsteady(model: str, choices: Mapping[str, Choice], consequence: str) -> None:
    """Refuse choices that a run would change (AC027)."""
    for path, choice in choices.items():
        names = choice.unsteady()
        if names:
            raise UsageError(
                "AC027",
                f"contacts of {model} would change the equations during a run: {consequence}",
                evidence=[f"{path}: {name} may leave several holes" for name in names[:6]],
                help="declare a drill that stays in one hole: DrillBody(wanders=False, ...)",
            )
