"""Broken models and what is said about them: the frame of the corpus.

Every case is a class or a function that is wrong in one way, decorated with the class of error, the thing that the
first line has to name, and the places in the source that are marked, in their order. A dozen cases have the whole
message too, with file names without their folders and N for line numbers.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import pytest

import acausal
from acausal import AcausalError, Component

Model = TypeVar("Model", bound=type[Component])
Function = TypeVar("Function", bound=Callable[[], object])


@dataclass(frozen=True)
class Case:
    """One thing that is wrong."""

    name: str
    run: Callable[[], object]
    code: str
    named: str
    places: tuple[str, ...]
    text: str

    def __str__(self) -> str:
        return self.name

    def check(self) -> None:
        """The class of error and the name in the first line, a file in the second, the places; perhaps every letter."""
        with pytest.raises(AcausalError) as caught:
            self.run()
        text = normalised(caught.value)
        first, second, *_ = text.splitlines()
        assert first.startswith(f"error[{self.code}]: "), text
        assert self.named in first, text
        assert second.startswith("  at      "), text
        assert second.endswith(".py:N"), text
        assert marked(text) == self.places, text
        if self.text:
            assert text == self.text.strip("\n")


@dataclass
class Corpus:
    """The cases of one file."""

    cases: list[Case] = field(default_factory=list)

    def broken(self, code: str, named: str, *places: str, text: str = "") -> Callable[[Model], Model]:
        """A model that cannot be compiled."""
        return self._model((code, named, places, text), lambda cls: acausal.compile(cls()))

    def bad_start(self, code: str, named: str, *places: str, text: str = "") -> Callable[[Model], Model]:
        """A model that is sound but cannot start."""
        return self._model((code, named, places, text), lambda cls: acausal.simulate(cls(), stop_time=0.1))

    def wrong(self, code: str, named: str, *places: str, text: str = "") -> Callable[[Function], Function]:
        """Python code that cannot run."""

        def add(function: Function) -> Function:
            self.cases.append(Case(function.__name__, function, code, named, places, text))
            return function

        return add

    def _model(
        self, expected: tuple[str, str, tuple[str, ...], str], run: Callable[[type[Component]], object]
    ) -> Callable[[Model], Model]:
        def add(cls: Model) -> Model:
            self.cases.append(Case(cls.__name__, lambda: run(cls), *expected))
            return cls

        return add


def normalised(error: AcausalError) -> str:
    """The message without folders and line numbers."""
    text = re.sub(r"/\S*/library/(\w+/)+?(\w+/)?(\w+\.py:)", r"\1\3", str(error))
    text = re.sub(r"/\S*/(\w+\.py:)", r"\1", text)
    return re.sub(r"(\w\.py:)\d+", r"\1N", text)


def marked(text: str) -> tuple[str, ...]:
    """The source that a message shows for each of its places, each once: what is marked, or the whole line."""
    lines, found = [*text.splitlines(), ""], []
    for place, source, carets in zip(lines, lines[1:], lines[2:], strict=False):
        if re.match(r" +at +\S", place) and source.startswith(14 * " "):
            is_marked = set(carets.strip()) == {"^"}
            first = carets.index("^") if is_marked else 0
            found.append(source[first : first + carets.count("^")] if is_marked else source.strip())
    return tuple(dict.fromkeys(found))
