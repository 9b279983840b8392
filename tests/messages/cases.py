"""Broken models and what is said about them: the frame of the corpus.

Every case is wrong in one way. It is a block of a table (see `Corpus.table`), or a class or a function decorated with
the class of error, the thing that the first line has to name, and the places in the source that are marked, in their
order. A dozen cases have the whole message too, with file names without their folders and N for line numbers.
"""

from __future__ import annotations

import linecache
import math
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
import pytest

import acausal
from acausal import AcausalError, Component
from acausal.library import blocks, contact, electrical, multibody, rotational, thermal, translational

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
    text: str = ""
    remedy: str = ""

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
        assert self.remedy in (caught.value.help or ""), text
        assert len(text) < 3000
        if self.text:
            assert text == self.text.strip("\n")


@dataclass
class Corpus:
    """The cases of one file."""

    cases: list[Case] = field(default_factory=list)

    def __getitem__(self, name: str) -> Case:
        return next(case for case in self.cases if case.name == name)

    def broken(self, code: str, named: str, *places: str, text: str = "") -> Callable[[Model], Model]:
        """A model that cannot be compiled, or cannot start."""

        def add(cls: Model) -> Model:
            self.cases.append(Case(cls.__name__, lambda: _run(cls(), code), code, named, places, text))
            return cls

        return add

    def wrong(self, code: str, named: str, *places: str, text: str = "") -> Callable[[Function], Function]:
        """Python code that cannot run."""

        def add(function: Function) -> Function:
            self.cases.append(Case(function.__name__, function, code, named, places, text))
            return function

        return add

    def table(self, text: str, names: Mapping[str, Any] = {}) -> None:
        """Cases as blocks of text, in whose lines `names` and those of acausal and its libraries can be used.

        A line `code named -- statement` is a case of one statement, which the message shows as a whole. Otherwise the
        first line of a block is `case code named`. If the case has a capital, it is a model, perhaps with a base class
        in brackets, and the following lines are its fields, its equations, which begin with `yield` or `eq: `, those
        at its start, with `start: `, and lines of its `build`, with `build: `. Otherwise they are statements. The
        message shows lines after `> `, or what is between `<<` and `>>`. What is named may be followed by ` => ` and a
        part of the remedy.
        """
        rows = r"^(AC\d{3}) (.*) -- (.*)$"
        for code, named, line in re.findall(rows, text, flags=re.MULTILINE):
            run = partial(_executed, "model", line, names, code)
            self._add(line, run, code, named, (line,))
        for block in filter(None, re.split(r"\n\n+", re.sub(rows, "", text, flags=re.MULTILINE).strip())):
            head, *lines = block.splitlines()
            name, base, code, named = re.fullmatch(r"(\w+)(\([\w.]+\))? (AC\d{3}) (.*)", head).groups()  # type: ignore[union-attr]
            places = re.findall(r"^> (?:(?:build|eq|start): )?\s*(.*)|<<(.*?)>>", "\n".join(lines), flags=re.MULTILINE)
            plain = [re.sub("^> |<<|>>", "", line) for line in lines]
            source = "\n".join(plain)
            if name[0].isupper():
                source = f"class {name}{base or '(Component)'}:\n{model(plain)}\nmade = {name}()"
            run = partial(_executed, name, source, names, code)
            self._add(name, run, code, named, tuple(whole or part for whole, part in places))

    def _add(self, name: str, run: Callable[[], object], code: str, named: str, places: tuple[str, ...]) -> None:
        named, _, remedy = named.partition(" => ")
        self.cases.append(Case(name, run, code, named, places, remedy=remedy))


def model(lines: list[str]) -> str:
    """The body of a class: comments and fields, `build`, equations, equations at the start."""
    parts: dict[str, list[str]] = {"build": [], "equations": [], "initial_equations": []}
    fields = []
    for line in lines:
        if line.startswith("yield "):
            parts["equations"].append(line)
        elif line.startswith(("build: ", "eq: ", "start: ")):
            prefix, _, statement = line.partition(": ")
            parts[{"eq": "equations", "start": "initial_equations"}.get(prefix, prefix)].append(statement)
        elif not line.startswith("def "):  # stands for the line of its equations, which the message shows
            fields.append(f"    {line}")
    for method, own in parts.items():
        fields += [f"    def {method}(self):", *(f"        {line}" for line in own)] if own else []
    return "\n".join([*fields, "    pass"])


_LIBRARIES = blocks, contact, electrical, multibody, rotational, thermal, translational
_NAMES = {**vars(acausal), "acausal": acausal, "math": math, "np": np}
_NAMES |= {library.__name__.rpartition(".")[2]: library for library in _LIBRARIES}


def _run(made: Component, code: str) -> object:
    """Compile a model, and for the codes of a start start it."""
    is_start = code.startswith("AC30") or code == "AC505"
    return acausal.simulate(made, stop_time=0.1) if is_start else acausal.compile(made)


def _executed(name: str, source: str, names: Mapping[str, Any], code: str) -> object:
    """Execute Python as a file of its own, so that messages can show its lines, and compile or run its model."""
    module, file = ModuleType(name), f"{name}.py"
    module.__file__ = file
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file
    sys.modules[name] = module
    try:
        vars(module).update({**_NAMES, **names, "__name__": name, "__file__": file})
        exec(compile(source, file, "exec"), vars(module))
        return _run(module.made, code) if name[0].isupper() else None
    finally:
        del sys.modules[name]


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
