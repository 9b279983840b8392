"""Claim: a reader who follows a run meets few files, one meaning in one place, and no circular imports.

    python benchmarks/walks.py

Walks are recorded while the program runs: each call from a function in one file to a function in another is a hop. Code
that runs when a module is loaded does not count. A bounce is the second one of a ball that falls on a floor: how the
driver integrates up to the event and passes it. Read from the source: where a tolerance is multiplied or divided,
modules that depend on each other, counting imports inside functions and under TYPE_CHECKING, and folders with more than
ten modules.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from measure import report
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

import acausal
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.oscillator import Oscillator

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = tuple(f"{ROOT / name}/" for name in ("acausal", "library", "models"))
# The function that integrates up to an event and passes it.
BOUNCE = "Hybrid.advance"
# Goals: files and hops of the Oscillator, files of a bounce, modules of a folder.
FILES, HOPS, BOUNCE_FILES, MODULES = 45, 600, 9, 10


@dataclass
class Walk:
    """The functions and files that a program has visited."""

    files: set[str] = field(default_factory=set)
    functions: set[tuple[str, str]] = field(default_factory=set)
    hops: int = 0

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Note a call; what `sys.setprofile` wants."""
        code = frame.f_code
        if event != "call" or not _is_ours(code.co_filename) or _is_loading(frame):
            return
        self.files.add(code.co_filename)
        self.functions.add((code.co_filename, code.co_qualname))
        before = frame.f_back
        while before is not None and not _is_ours(before.f_code.co_filename):
            before = before.f_back
        self.hops += before is not None and before.f_code.co_filename != code.co_filename

    def figures(self) -> dict[str, int]:
        """The counts."""
        return {"files": len(self.files), "functions": len(self.functions), "hops": self.hops}


def _is_ours(file: str) -> bool:
    return file.startswith(FOLDERS)


def _is_loading(frame: FrameType | None) -> bool:
    """Whether a module is being loaded."""
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_globals["__name__"] != "__main__":
            return True
        frame = frame.f_back
    return False


def walk(run: Callable[[], object]) -> Walk:
    """The walk of `run`."""
    found = Walk()
    sys.setprofile(found)
    try:
        run()
    finally:
        sys.setprofile(None)
    return found


class Bounces:
    """The walks of every call of one function."""

    def __init__(self) -> None:
        self.walks: list[Walk] = []
        self._inside: FrameType | None = None

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        """Note a call inside the function; what `sys.setprofile` wants."""
        if self._inside is None and event == "call" and frame.f_code.co_qualname == BOUNCE:
            self._inside = frame
            self.walks.append(Walk())
        if self._inside is not None:
            self.walks[-1](frame, event, argument)
            if event == "return" and frame is self._inside:
                self._inside = None


def bounces(solver: str) -> list[Walk]:
    """The walks of the bounces of a ball, interpreted."""
    compiled = acausal.compile(BouncingBall())
    found = Bounces()
    sys.setprofile(found)
    try:
        acausal.simulate(compiled, solver=solver, stop_time=1.5, native=False)
    finally:
        sys.setprofile(None)
    return found.walks


def trees() -> Iterator[tuple[str, Path, ast.Module]]:
    """Name, file and syntax of each module."""
    for folder, prefix in (("acausal", ""), ("library", "acausal."), ("models", "acausal.")):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            if parts[:2] not in (("acausal", "library"), ("acausal", "models")):
                name = prefix + ".".join(p for p in parts if p != "__init__")
                yield name, path, ast.parse(path.read_text(encoding="utf-8"))


def scalings() -> list[str]:
    """Modules of `simulate/` in which a tolerance is multiplied or divided by something."""
    found: set[str] = set()
    for name, path, tree in trees():
        for node in ast.walk(tree) if name.startswith("acausal.simulate") else ():
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
                sides = (node.left,) if isinstance(node.op, ast.Div) else (node.left, node.right)
                if any(_last(side) in ("tolerance", "relative") for side in sides):
                    found.add(str(path.relative_to(ROOT)))
    return sorted(found)


def _last(node: ast.expr) -> str:
    """The last name of `a.b.c`."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def circles() -> list[list[str]]:
    """Modules that depend on each other, the largest cycle first."""
    modules = {name: tree for name, _, tree in trees()}
    place = {name: k for k, name in enumerate(modules)}
    edges = {
        (place[name], place[target])
        for name, tree in modules.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
        for target in (f"{node.module}.{alias.name}", node.module)
        if target in place and target != name
    }
    rows, columns = np.array(sorted(edges)).T
    graph = csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(place), len(place)))
    _, labels = connected_components(graph, connection="strong")
    groups = [[m for m in modules if labels[place[m]] == k] for k in np.flatnonzero(np.bincount(labels) > 1)]
    return sorted(groups, key=len, reverse=True)


def crowded() -> dict[str, int]:
    """Folders of the package with more than ten modules, without the libraries and models, which are families."""
    counts: dict[str, int] = {}
    for name, path, _ in trees():
        if path.name != "__init__.py" and not name.startswith(("acausal.library", "acausal.models")):
            folder = str(path.parent.relative_to(ROOT))
            counts[folder] = counts.get(folder, 0) + 1
    return {folder: n for folder, n in counts.items() if n > MODULES}


def main() -> None:
    if Path(acausal.__file__).resolve().parents[1] != ROOT:
        sys.exit(f"acausal is imported from {Path(acausal.__file__).parent}, the walks are those of {ROOT}: install it")
    first = walk(lambda: acausal.simulate(Oscillator())).figures()
    passed = {solver: bounces(solver)[1].figures() for solver in ("idas", "rosenbrock")}
    scaled, rings, full = scalings(), circles(), crowded()
    record = {
        "oscillator": first,
        "bounce": passed,
        "tolerance_scaled": scaled,
        "circles": rings,
        "folders_above_ten": full,
    }
    goals = (
        first["files"] <= FILES and first["hops"] <= HOPS,
        max(p["files"] for p in passed.values()) <= BOUNCE_FILES,
        len(scaled) <= 1,
        not rings,
        not full,
    )
    line = (
        f"Oscillator: {first['files']} files, {first['hops']} hops; one bounce: "
        + ", ".join(f"{p['files']} files and {p['hops']} hops ({solver})" for solver, p in passed.items())
        + f"; tolerance scaled in {len(scaled)} modules; circles of {[len(r) for r in rings]} modules; "
        + f"{len(full)} folders above ten: {sum(goals)} of {len(goals)} goals"
    )
    report((__doc__ or "").split("\n")[0], line, record)


if __name__ == "__main__":
    main()
