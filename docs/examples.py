"""The example of a component in the reference: a shipped model, its lines about the component, its picture."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import acausal
from acausal.cli.arguments.catalogue import PACKAGE, Part, library_parts, named_by, used_in
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.shipped import shipped_models
from acausal.plot.plot import figure, plot

# Models whose runs take longer than a page may.
_SLOW = frozenset({"ClutchChain", "FeketePoints", "PendulumDrift", "TransistorAmplifier", "StackedPlates", "BoxStack"})
_MOST_LINES = 6


def example(part: Part, pictures: Path) -> Iterator[str]:
    """Lines of Markdown: the model that shows the component best, and the names of others.

    Parameters
    ----------
    part
        Component of the library.
    pictures
        Folder that gets the picture, beside the page.
    """
    if part.name.startswith("Partial"):
        yield from (f"A base, which no model has by itself. {_built_on(part)}".strip(), "")
        return
    models, holder = models_with(part)
    if not models:
        return
    shown = min(models, key=_size)
    if picture := _drawn(shown, pictures):
        within = f", within `{holder}`" if holder else ""
        yield from (f"Example{within}: `acausal simulate {shown} --plot`", "")
        if lines := [] if holder else list(_statements(part, shown)):
            yield from ("```python", *lines, "```", "")
        yield from (f"![{shown}]({pictures.name}/{picture})", "")
    if others := [m for m in models if m != shown]:
        yield from (f"Used in: {', '.join(f'`{m}`' for m in others[:8])}.", "")


@cache
def models_with(part: Part) -> tuple[tuple[str, ...], str]:
    """Models that have a component; where none names it, those of a class that has it, with the name of that class."""
    around, seen = [part], {(part.module, part.name)}
    while around:
        for p in around:
            if found := tuple(m for m in used_in(p)[0] if m not in _SLOW):
                return found, "" if p is part else p.name
        inner = {(p.module, p.name) for p in around}
        outer = {key for key, named in named_by(PACKAGE).items() if inner & named} - seen
        around = [replace(part, module=module, name=name) for module, name in sorted(outer)]
        seen |= outer
    return (), ""


def _built_on(part: Part) -> str:
    """Who extends a base."""
    base = _class(part)
    users = [p.name for p in library_parts() if p != part and issubclass(_class(p), base)]
    return f"Built on it: {', '.join(f'`{name}`' for name in users[:8])}." if users else ""


@cache
def _size(model: str) -> tuple[bool, int, str]:
    """The fewer kinds of components a model has, the better it shows each; one without a declared figure comes last."""
    return not getattr(find_model(model), "figure", ()), sum(model in used_in(p)[0] for p in library_parts()), model


def _statements(part: Part, model: str) -> Iterator[str]:
    """The lines of a model's class that make the component, and connect it."""
    lines = inspect.getsource(find_model(model)).splitlines()
    tree: Any = ast.parse("\n".join(lines)).body[0]
    alias = next(iter(_aliases(part, model)), part.name)
    names: set[str] = set()
    found: list[ast.stmt] = []
    for node in (n for n in ast.walk(tree) if isinstance(n, ast.AnnAssign | ast.Assign)):
        if isinstance(node.value, ast.Call) and isinstance(node.value.func, ast.Name) and node.value.func.id == alias:
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            names.add(ast.unparse(target).removeprefix("self."))
            found.append(node)
    for node in (n for n in ast.walk(tree) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Yield)):
        if any(isinstance(n, ast.Attribute) and ast.unparse(n).removeprefix("self.") in names for n in ast.walk(node)):
            found.append(node)
    shown = [line for node in found for line in _dedented(lines[node.lineno - 1 : node.end_lineno])]
    yield from shown[:_MOST_LINES] if len(shown) <= _MOST_LINES else [*shown[: _MOST_LINES - 1], "..."]


def _aliases(part: Part, model: str) -> Iterable[str]:
    """What the module of a model calls the component."""
    module = import_module(find_model(model).__module__)
    return [name for name, value in vars(module).items() if value is _class(part)]


def _dedented(lines: list[str]) -> list[str]:
    indent = len(lines[0]) - len(lines[0].lstrip())
    return [line[indent:] for line in lines]


@cache
def _drawn(name: str, pictures: Path) -> str:
    """File name of the figure of a run; "" for a model that has none."""
    if name not in {m.name for m in shipped_models()}:
        return ""
    model = find_model(name)()
    result = acausal.simulate(model, tolerance=1e-5)
    panels = getattr(model, "figure", ())
    states = [s for s in acausal.compile(model).states if s in result][:4]
    if not panels and not states:
        return ""
    pictures.mkdir(exist_ok=True)
    file = pictures / f"{name}.png"
    figure(result, panels, file=file) if panels else plot(result, *states, file=file)
    return file.name


def _class(part: Part) -> Any:
    return getattr(import_module(f"acausal.library.{part.family}"), part.name)
