"""Notes of components that examine a finished run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from acausal.language.review import Reviewing
from acausal.result.result import Result


def reviews(components: Mapping[str, type[Reviewing]], result: Result, scalars: Mapping[str, int]) -> list[str]:
    """Return the notes of all components that review runs; those that share a method are passed to it together.

    `scalars`: Numbers of variables by path, equal for connected potentials.
    """
    by_method: dict[Callable[..., Sequence[str]], list[str]] = {}
    for path, cls in components.items():
        by_method.setdefault(cls.review, []).append(path)
    return [note for method, paths in by_method.items() for note in method(result, paths, scalars)]
