"""Components that look back on a finished run, for what equations cannot tell without states of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeGuard, runtime_checkable


@runtime_checkable
class Reviewing(Protocol):
    """A component whose class looks back on runs."""

    @staticmethod
    def review(run: Any, paths: Sequence[str], scalars: Mapping[str, int]) -> Sequence[str]:
        """Notes on a run, an `acausal.Result` that may lack signals.

        `paths` are those of all components that share this method. `scalars` has a number for each variable, the same
        one for connected potentials; it is empty where the structure changes during the run.
        """
        ...


def is_reviewing(cls: type) -> TypeGuard[type[Reviewing]]:
    """Whether a class of components looks back on runs."""
    return issubclass(cls, Reviewing)
