"""The models that come with acausal, found by reading their source: importing all of them would take a second."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path

PACKAGE = "acausal.models"


@dataclass(frozen=True)
class ShippedModel:
    """A class of `acausal.models` that says how it is meant to be run."""

    name: str
    module: str
    summary: str

    @property
    def reference(self) -> str:
        """What identifies it on the command line, and in an import."""
        return f"{self.module}:{self.name}"


@cache
def shipped_models() -> tuple[ShippedModel, ...]:
    """All of them, by name."""
    folder = Path(__file__).resolve().parents[2] / "models"
    found = []
    for path in sorted(folder.rglob("*.py")):
        module = ".".join((PACKAGE, *path.relative_to(folder).with_suffix("").parts))
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and _is_runnable(node):
                summary = (ast.get_docstring(node) or "").split("\n")[0]
                found.append(ShippedModel(node.name, module.removesuffix(".__init__"), summary))
    return tuple(sorted(found, key=lambda m: m.name.lower()))


def _is_runnable(node: ast.ClassDef) -> bool:
    """A model, unlike a component in the same file, carries its experiment."""
    for item in node.body:
        targets = (
            item.targets if isinstance(item, ast.Assign) else [item.target] if isinstance(item, ast.AnnAssign) else []
        )
        if any(isinstance(t, ast.Name) and t.id == "experiment" for t in targets):
            return True
    return False
