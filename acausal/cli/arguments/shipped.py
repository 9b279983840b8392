"""The shipped models, found by parsing their source: importing all of them would take a second."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path

PACKAGE = "acausal.models"


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
    """All shipped models, sorted by name."""
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
    """Whether a class has an experiment, as models have, unlike components in the same file."""
    for item in node.body:
        targets = (
            item.targets if isinstance(item, ast.Assign) else [item.target] if isinstance(item, ast.AnnAssign) else []
        )
        if any(isinstance(t, ast.Name) and t.id == "experiment" for t in targets):
            return True
    return False
