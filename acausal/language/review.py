"""Components that examine a finished run, for conditions that equations could only detect with additional states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeGuard, runtime_checkable


@runtime_checkable
class Reviewing(Protocol):
    """A component whose class reviews runs."""

    @staticmethod
    def review(run: Any, paths: Sequence[str], scalars: Mapping[str, int]) -> Sequence[str]:
        """Return notes on a run, an `acausal.Result` that may lack signals.

        `paths` are those of all components that share this method. `scalars` has a number for each variable, equal for
        connected potentials, in all structures of the run.
        """
        ...


def is_reviewing(cls: type) -> TypeGuard[type[Reviewing]]:
    """Whether a class of components reviews runs."""
    return issubclass(cls, Reviewing)
