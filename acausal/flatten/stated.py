"""The equations of a component as they are stated, base classes first."""

from __future__ import annotations

from acausal.flatten.composition import compose
from acausal.language.component import Component


def stated_equations(component: Component) -> list[tuple[str, str, str]]:
    """Text of each, what it asserts (or ""), and whether it holds "at the start" only (or "").

    Raises
    ------
    AcausalError
        What stating them raises.
    """
    found = [(m, item) for m, (item, _) in compose(component).stated("equations", "initial_equations")]
    return [(str(i), getattr(i, "message", ""), "at the start" if m == "initial_equations" else "") for m, i in found]
