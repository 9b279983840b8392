"""The direction of imports: language <- flatten <- lower, and nothing sideways.

Every import statement counts, also those inside functions and under TYPE_CHECKING: needing a name is a dependency at
whatever moment it is satisfied.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import acausal
from acausal.providers import provided

ROOT = Path(__file__).resolve().parents[1]

COMPILER = ("language", "flatten", "structure", "numeric", "diagnose", "analyse", "reduce", "lower")
# Which groups may import which; all may import `errors`, `units` and themselves.
ALLOWED: dict[str, set[str]] = {
    "errors": set(),
    "units": set(),
    # types of arrays
    "arrays": set(),
    # providers for the packages below
    "providers": set(),
    # the description of a figure, which a model carries, without the drawing
    "panel": set(),
    # files that are trusted later
    "private": set(),
    # Python's own collector
    "collector": set(),
    # values that were used last
    "recent": set(),
    "language": {"panel"},
    "flatten": {"language"},
    "structure": set(),
    # values of expressions, external functions among them
    "numeric": {"language", "flatten"},
    "diagnose": {"language", "flatten", "structure", "numeric"},
    "analyse": {"language", "flatten", "structure", "numeric", "diagnose"},
    "reduce": {"language", "flatten", "structure", "numeric", "analyse"},
    "lower": {"language", "flatten", "structure", "numeric", "diagnose", "analyse", "reduce"},
    "result": set(),
    # the equations of components are composed where they are flattened
    "notebook": {"result", "language", "flatten"},
    # `simulate` takes a component, and its defaults from the component's experiment.
    "simulate": {*COMPILER, "result"},
    "plot": {"simulate", "result", "lower", "analyse", "panel"},
    "export": {*COMPILER, "simulate", "result"},
    # optimal control is based on exported functions and on runs
    "optimal_control": {*COMPILER, "simulate", "result", "export", "plot", "panel"},
    # studies of whole models: speed and accuracy, stability, reduction
    "study": {*COMPILER, "simulate", "result", "plot", "export", "panel"},
    # pages for a browser, without a model
    "browser": set(),
    "animate": {"language", "flatten", "simulate", "result", "plot", "panel", "browser"},
    "diagram": {"language", "flatten", "result", "browser"},
    "explore": {"result", "plot", "browser"},
    # the same command as the installed one, which stands outside of the package
    "__main__": set(),
    "cli": {*COMPILER, "export", "panel", "plot", "result", "simulate", "study", "animate", "diagram", "explore"},
    "library": {"public"},
    # models may define an optimal-control problem
    "models": {"public", "library", "optimal_control"},
    # acausal/__init__.py provides the names of every stage.
    "public": {*COMPILER, "animate", "diagram", "explore", "export", "panel", "plot", "result", "simulate", "study"},
}
EVERYBODY_MAY = {"errors", "units", "arrays", "providers", "private", "collector", "recent"}
# An edge outside the table, by module, with its reason.
EXCEPTIONS = {
    **{
        (
            f"acausal.library.{name}.looks",
            "animate",
        ): "looks stand beside the physics, which does not know them"
        for name in ("multibody", "contact", "drilling")
    },
}

HEAVY = {"casadi", "matplotlib", "scipy", "pandas", "xarray", "pint"}
# Packages that must not import CasADi, not even inside a function.
WITHOUT_CASADI = {
    *("errors", "units", "language", "flatten", "structure", "diagnose", "analyse", "reduce"),
    *("result", "plot", "library", "models"),
}


class Import(NamedTuple):
    module: str
    target: str
    name: str | None
    line: int
    package: str = ""
    """The package of a module that is imported from it like a name."""


def sources() -> dict[str, Path]:
    """All modules by dotted name; the links acausal/library and acausal/models are followed by their real folders."""
    found: dict[str, Path] = {}
    for folder, prefix in (("acausal", ""), ("library", "acausal."), ("models", "acausal.")):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            if parts[:2] in (("acausal", "library"), ("acausal", "models")):
                continue
            found[prefix + ".".join(p for p in parts if p != "__init__")] = path
    return found


SOURCES = sources()


def group(module: str) -> str:
    """The row of the table a module belongs to."""
    if module == "acausal":
        return "public"
    return module.split(".")[1]


@cache
def imports(module: str) -> tuple[Import, ...]:
    """Every import of an `acausal` module or of a foreign package in `module`."""
    return tuple(_imports(module))


def _imports(module: str) -> Iterator[Import]:
    path = SOURCES[module]
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(module, alias.name, None, node.lineno)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                parents = package.split(".")[: len(package.split(".")) - node.level + 1]
                origin = ".".join([*parents, *([node.module] if node.module else [])])
            for alias in node.names:
                full = f"{origin}.{alias.name}"
                submodule = full in SOURCES
                yield Import(
                    module, full if submodule else origin, alias.name, node.lineno, origin if submodule else ""
                )


def own(edge: Import) -> bool:
    return edge.target.split(".")[0] == "acausal"


def describe(edge: Import) -> str:
    return f"{SOURCES[edge.module].relative_to(ROOT)}:{edge.line}: {group(edge.module)} -> {edge.target}"


def test_every_import_follows_the_table() -> None:
    wrong = []
    for module in SOURCES:
        here = group(module)
        for edge in filter(own, imports(module)):
            there = group(edge.target)
            allowed = {here, *EVERYBODY_MAY, *ALLOWED.get(here, set())}
            if there not in allowed and (module, there) not in EXCEPTIONS:
                wrong.append(f"{describe(edge)}; allowed: {', '.join(sorted(allowed))}")
    assert not wrong, "\n" + "\n".join(wrong)


def test_every_module_has_a_row() -> None:
    """A new module under acausal/ is placed in the table on purpose."""
    assert {module for module in SOURCES if group(module) not in ALLOWED} == set()


def test_the_table_has_no_cycle() -> None:
    try:
        order = list(TopologicalSorter(ALLOWED).static_order())
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None
    assert set(order) == {*ALLOWED, *(name for needed in ALLOWED.values() for name in needed)}


def test_no_modules_need_each_other() -> None:
    """There are no import cycles, counting imports inside functions and under TYPE_CHECKING, the packages of imported
    modules, and the names that the root package provides to others."""
    graph = {m: {t for e in imports(m) for t in (e.target, e.package) if t in SOURCES} - {m} for m in SOURCES}
    graph["acausal"] |= {*acausal._LAZY.values(), *acausal._METHODS.values()}
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None


def test_what_is_asked_for_is_provided() -> None:
    """`provided("name")` refers to a function of the module that the root package registers for it."""
    asked = {n for path in SOURCES.values() for n in re.findall(r'provided\("(\w+)"\)', path.read_text("utf-8"))}
    assert asked >= {"plot", "diagram", "casadi_model"}
    assert not [name for name in asked if not callable(provided(name))]


def test_imported_modules_exist() -> None:
    missing = [describe(e) for m in SOURCES for e in imports(m) if own(e) and e.target not in SOURCES]
    assert not missing, "\n" + "\n".join(missing)


def test_library_and_models_use_public_names_only() -> None:
    """The library uses only the public language, so that everything it needs is available to every user."""
    public = {e.name for e in imports("acausal") if own(e)}
    wrong = [
        describe(e) + f".{e.name}"
        for m in SOURCES
        if group(m) in ("library", "models")
        for e in imports(m)
        if e.target == "acausal" and e.name not in public
    ]
    assert not wrong, "\n" + "\n".join(wrong)


def test_casadi_stays_behind_the_lowering() -> None:
    """Exception: the collision kernel of library/contact uses CasADi."""
    wrong = [
        describe(e)
        for m in SOURCES
        if group(m) in WITHOUT_CASADI and not m.startswith("acausal.library.contact")
        for e in imports(m)
        if e.target.split(".")[0] == "casadi"
    ]
    assert not wrong, "\n" + "\n".join(wrong)


# The beginning of a statement at module level that may name something; a name in two of them is looked at more closely.
_NAMES = re.compile(r"^(?:(?:async )?def |class )?(\w+(?:, ?\w+)*)(?: ?: ?[^=\n]+)? ?[=(\[]", re.MULTILINE)


def named(body: list[ast.stmt]) -> Iterator[str]:
    """What the statements of one module or class define, once for each; properties and overloads share a name."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            if not node.decorator_list or isinstance(node, ast.ClassDef):
                yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                yield from (n.id for n in ast.walk(target) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store))


def test_no_module_defines_a_name_twice() -> None:
    """Two people each added a constant of one name to a module, and git merged both without a conflict."""
    twice = []
    for path in (p for folder in ("acausal", "library", "models", "tests") for p in (ROOT / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        counted = Counter(name for found in _NAMES.findall(text) for name in found.replace(" ", "").split(","))
        if max(counted.values(), default=0) > 1:
            names = Counter(named(ast.parse(text).body))
            twice += [f"{path.relative_to(ROOT)}: {name}" for name, count in names.items() if count > 1]
    assert not twice


def loaded_by(statement: str) -> set[str]:
    """Heavy packages that are loaded after `statement` in a fresh interpreter."""
    program = f"import sys\n{statement}\nprint(*[m for m in {sorted(HEAVY)!r} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=False)
    assert run.returncode == 0, run.stderr
    return set(run.stdout.split())


def test_libraries_are_light() -> None:
    """The package itself too, which they import; that of the command line is in `tests/cli/test_process.py`."""
    names = [m for m in SOURCES if group(m) == "library" and not m.startswith("acausal.library.contact")]
    assert loaded_by("\n".join(f"import {name}" for name in names)) == set()


def test_a_small_model_runs_without_scipy() -> None:
    """Loading it takes a quarter of a second, a third of a short command."""
    run = "from acausal.models.rc_circuit import RCCircuit\nimport acausal\nacausal.simulate(RCCircuit())"
    assert loaded_by(run) == {"casadi"}
