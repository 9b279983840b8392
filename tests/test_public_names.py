"""Public functions whose subpackages have the same name."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

import pytest

import acausal
from acausal import library


@pytest.mark.parametrize("name", ["flatten", "simulate"])
def test_a_function_is_not_replaced_by_the_subpackage_of_its_name(name: str) -> None:
    assert importlib.import_module(f"acausal.{name}").__name__ == f"acausal.{name}"
    assert not isinstance(getattr(acausal, name), type(acausal))
    assert getattr(acausal, name).__name__ == name


def test_every_lazy_name_is_there() -> None:
    """The public names of `acausal` must be available after `import acausal`."""
    for name in acausal._LAZY:
        assert callable(getattr(acausal, name)), name


@pytest.mark.parametrize("package", sorted(p.name for p in pkgutil.iter_modules(library.__path__) if p.ispkg))
def test_a_star_import_of_a_library_hides_no_function_of_the_language(package: str) -> None:
    """`from acausal.library.blocks import *` after that of `acausal` must not replace a function by a module."""
    names = vars(importlib.import_module(f"acausal.library.{package}"))
    ours = set(vars(acausal)) | set(acausal._LAZY)
    hidden = [
        name for name, value in names.items() if isinstance(value, ModuleType) and name in ours and name[0] != "_"
    ]
    assert [name for name in hidden if not isinstance(getattr(acausal, name), ModuleType)] == []
