"""What components say of a run when they look back on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from acausal.language.review import Reviewing
from acausal.result.result import Result


def reviews(components: Mapping[str, type[Reviewing]], result: Result, scalars: Mapping[str, int]) -> list[str]:
    """Notes of the components that look back on runs; those that do so by one method do it together.

    `scalars` are numbers of variables by path, equal for what is connected.
    """
    by_method: dict[Callable[..., Sequence[str]], list[str]] = {}
    for path, cls in components.items():
        by_method.setdefault(cls.review, []).append(path)
    return [note for method, paths in by_method.items() for note in method(result, paths, scalars)]
