"""Benchmarks are not run by the tests, so mistakes that argparse hides from type checkers are found in their source."""

from __future__ import annotations

import ast
import importlib
from importlib.util import find_spec
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def called(node: ast.AST, name: str) -> bool:
    """Whether a node is a call of a method of this name."""
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == name


@pytest.mark.parametrize("file", sorted(BENCHMARKS.glob("*.py")), ids=lambda file: file.stem)
def test_options_that_are_read_are_declared(file: Path) -> None:
    """For a type checker a namespace of argparse has any attribute: a rename once broke two benchmarks unnoticed."""
    nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    declared = {
        call.args[0].value.lstrip("-").replace("-", "_")
        for call in nodes
        if called(call, "add_argument")
        and isinstance(call, ast.Call)
        and isinstance(call.args[0], ast.Constant)
        and isinstance(call.args[0].value, str)
    }
    namespaces = {
        target.id
        for node in nodes
        if isinstance(node, ast.Assign) and called(node.value, "parse_args")
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    main = next((n for n in nodes if isinstance(n, ast.FunctionDef) and n.name == "main"), None)
    read = {
        node.attr
        for node in (ast.walk(main) if main else ())
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in namespaces
    }
    assert read <= declared


@pytest.mark.parametrize("file", sorted(BENCHMARKS.glob("*.py")), ids=lambda file: file.stem)
def test_what_is_imported_from_the_package_is_there(file: Path) -> None:
    """A function that nothing else called was deleted, and two benchmarks no longer started."""
    imports = [n for n in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(n, ast.ImportFrom)]
    wanted = {(n.module or "", name.name) for n in imports for name in n.names}
    own = {(module, name) for module, name in wanted if module.partition(".")[0] == "acausal"}
    there = {(module, name) for module, name in own if hasattr(importlib.import_module(module), name)}
    assert {f"{module}.{name}" for module, name in own - there if find_spec(f"{module}.{name}") is None} == set()
