"""Modules of the library and of the shipped models, as parsed source: importing all of them would take a second."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path

PACKAGE = "acausal.models"


@dataclass(frozen=True)
class Module:
    """The classes of a module, and what it imports: (module, name) by the name under which it is known there."""

    classes: dict[str, ast.ClassDef]
    imports: dict[str, tuple[str, str]]


@cache
def modules(package: str) -> dict[str, Module]:
    """All modules of `acausal.library` or `acausal.models` by dotted name."""
    folder = Path(__file__).resolve().parents[2] / package.rpartition(".")[2]
    found = {}
    for path in sorted(folder.rglob("*.py")):
        name = ".".join((package, *path.relative_to(folder).with_suffix("").parts)).removesuffix(".__init__")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imports = {
            alias.asname or alias.name: (node.module or "", alias.name)
            for node in tree.body
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        found[name] = Module({n.name: n for n in tree.body if isinstance(n, ast.ClassDef)}, imports)
    return found


@dataclass(frozen=True)
class ShippedModel:
    """A class of `acausal.models` with an experiment."""

    name: str
    module: str
    summary: str

    @property
    def reference(self) -> str:
        """Unambiguous reference for the command line and imports."""
        return f"{self.module}:{self.name}"


@cache
def shipped_models() -> tuple[ShippedModel, ...]:
    """All shipped models, sorted by name: classes with an experiment, unlike components in the same file."""
    found = [
        ShippedModel(name, module, (ast.get_docstring(node) or "").split("\n")[0])
        for module, content in modules(PACKAGE).items()
        for name, node in content.classes.items()
        if not name.startswith("_") and any(_declares(item, "experiment") for item in node.body)
    ]
    return tuple(sorted(found, key=lambda m: m.name.lower()))


def _declares(item: ast.stmt, name: str) -> bool:
    targets = item.targets if isinstance(item, ast.Assign) else [getattr(item, "target", None)]
    return any(isinstance(target, ast.Name) and target.id == name for target in targets)
