"""Components with a variable structure: the contacts of a scene depend on which bodies are close to each other.

A `Choice` is one structure that such a component can have, and is immutable. A run, or a model reduction, replaces one
choice by the next and flattens the model with it (`flatten(model, choices=...)`). The component itself never changes,
so that several runs of one model are independent, even in different threads.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import cache
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
        """The component with this structure: a view that shares everything independent of the choice."""
        ...

    def labels(self) -> Sequence[tuple[str, str]]:
        """Parts as pairs: name in this structure, name that is the same in all structures."""
        ...

    def structure(self) -> Hashable:
        """Key that is equal for choices with equal equations; data for later choices are not part of it."""
        ...

    # Used by runs: acausal/simulate/restructure/restructure.py.

    def watched(self) -> Sequence[str]:
        """Signals that `following` and `moved` need."""
        ...

    def following(self, seen: Mapping[str, Array]) -> Choice:
        """The choice for values of the watched signals at one instant."""
        ...

    def moved(self, before: Mapping[str, Array], after: Mapping[str, Array]) -> Array:
        """Fraction of the validity of the choice that is used up at n instants, shape (n,); above 1 it may be wrong.

        `before` has the values at the instant of the choice, `after` those at the n instants.
        """
        ...

    # Used by model reduction: acausal/reduce/confine.py.

    def poses(self) -> Sequence[str]:
        """Signals whose bounds `confined` needs."""
        ...

    def confined(self, bounds: Mapping[str, tuple[Array, Array]]) -> tuple[Choice, bool]:
        """(Choice extended by every contact possible within (lowest, highest) values of the signals, whether it grew).

        As long as it grows, a further extension may be necessary.
        """
        ...

    def apart(self) -> Sequence[tuple[str, str]]:
        """(Name, reason) of everything that the choice leaves out."""
        ...

    def unsteady(self) -> Sequence[str]:
        """Names of parts that keep changing the structure during a run."""
        ...


@runtime_checkable
class Changing(Protocol):
    """A component with a variable structure; without a choice it contains everything that it may need at one time."""

    def is_variable(self) -> bool:
        """Whether a run must change the structure, or becomes cheaper if it does."""
        ...

    def whole(self) -> Choice:
        """The choice with everything that is possible."""
        ...

    def least(self, steady: bool) -> Choice:
        """The smallest structure; with `steady`, parts keep their names in all structures extended from it."""
        ...


def is_changing(component: object) -> TypeGuard[Changing]:
    """Whether a component has a variable structure; decided by its class, which is cached."""
    return _has_variable_structure(type(component))


_has_variable_structure: Callable[[type], bool] = cache(lambda cls: issubclass(cls, Changing))


@runtime_checkable
class Reporting(Protocol):
    """A component that can report about itself, such as a contact scene about its pairs."""

    def report(self) -> object:
        """An object whose `repr` is the report."""
        ...


def is_reporting(component: object) -> TypeGuard[Reporting]:
    """Whether a component can report about itself; decided by its class, because Python caches that."""
    return issubclass(type(component), Reporting)
