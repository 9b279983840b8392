"""Parameters that are set and that nothing in the model depends on: a value given to them changes nothing."""

from __future__ import annotations

from collections.abc import Iterable

from acausal.flatten.flat import FlatSystem


def unheard_parameters(flat: FlatSystem, names: Iterable[str]) -> tuple[str, ...]:
    """Notes on those of the free parameters `names`, or entries of them, that no equation, start or event depends on.

    The strength of a gravity whose vector has a value of its own, the time constant of a part of a controller that is
    left out: no error, as studies set one parameter of many variants, but runs that are equal would pass for a result.
    """
    asked = {part for name in names for part in (name, name.rpartition("[")[0])}
    return tuple(
        f"{p.path} is set, and nothing in the model depends on it"
        for p in flat.parameters
        if p.path in asked and p.free and flat.heard.isdisjoint(p.nodes)
    )
