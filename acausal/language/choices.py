"""Components whose structure is chosen: what a contact scene holds depends on who is near whom.

The component is a recipe and stays as it is. A `Choice` is one structure it can have, frozen; whoever runs a model, or
makes it smaller, goes from one choice to the next and flattens the model with it (`flatten(model, choices=...)`). So
two runs of one model, in two threads too, know nothing of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol, TypeGuard, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from acausal.language.component import Component

    Array = NDArray[np.float64]


class Choice(Protocol):
    """One structure of a component.

    Names of signals are relative to the component. Values of a signal at one instant have its shape; at n instants the
    first axis is n.
    """

    def applied(self) -> Component:
        """The component with this structure: a view, which shares all that does not depend on the choice."""
        ...

    def labels(self) -> Sequence[tuple[str, str]]:
        """Parts by their names in this structure, and by names that are the same in all structures."""
        ...

    def structure(self) -> Hashable:
        """What decides the equations: equal where these are. What is remembered for later choices may differ."""
        ...

    # While a model runs: acausal/simulate/restructure/restructure.py.

    def watched(self) -> Sequence[str]:
        """Signals that `following` and `moved` look at."""
        ...

    def following(self, seen: Mapping[str, Array]) -> Choice:
        """The choice for these values."""
        ...

    def moved(self, before: Mapping[str, Array], after: Mapping[str, Array]) -> Array:
        """How far the choice is used up at n instants [1], shape (n,): at 1 it may begin to be wrong.

        `before` holds values at the instant of the choice, `after` at the n instants.
        """
        ...

    def remarks(self, largest: Callable[[str], float]) -> Sequence[str]:
        """What to note after the run; `largest` gives the largest value of a signal, by a lasting name."""
        ...

    # Where a model is made smaller: acausal/reduce/confine.py.

    def poses(self) -> Sequence[str]:
        """Signals by whose bounds `confined` decides."""
        ...

    def confined(self, bounds: Mapping[str, tuple[Array, Array]]) -> tuple[Choice, bool]:
        """The choice that also holds what can play a part within lowest and highest values of the signals.

        True beside it when it holds more than this one, and more may follow.
        """
        ...

    def apart(self) -> Sequence[tuple[str, str]]:
        """Names and reasons of what was left out."""
        ...

    def unsteady(self) -> Sequence[str]:
        """What would go on changing the structure during a run."""
        ...


@runtime_checkable
class Changing(Protocol):
    """A component whose structure can be chosen; on its own it holds all that it may ever need at one time."""

    def is_variable(self) -> bool:
        """Whether a run has to change the structure, or becomes cheaper by it."""
        ...

    def whole(self) -> Choice:
        """The component as it is."""
        ...

    def least(self, steady: bool) -> Choice:
        """The smallest structure; `steady`: parts keep their names in all structures that are confined from it."""
        ...


def is_changing(component: object) -> TypeGuard[Changing]:
    """Whether a component is of this kind; asked of its class, which is remembered."""
    return issubclass(type(component), Changing)


@runtime_checkable
class Reporting(Protocol):
    """A component that has something to say about itself, such as the pairs of a contact scene."""

    def report(self) -> object:
        """What it has to say, in its `repr`."""
        ...


def is_reporting(component: object) -> TypeGuard[Reporting]:
    """Whether a component is of this kind; asked of its class, which is remembered."""
    return issubclass(type(component), Reporting)
