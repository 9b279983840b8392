"""Public functions whose subpackages have the same name."""

from __future__ import annotations

import importlib

import pytest

import acausal


@pytest.mark.parametrize("name", ["flatten", "simulate"])
def test_a_function_is_not_replaced_by_the_subpackage_of_its_name(name: str) -> None:
    assert importlib.import_module(f"acausal.{name}").__name__ == f"acausal.{name}"
    assert not isinstance(getattr(acausal, name), type(acausal))
    assert getattr(acausal, name).__name__ == name


def test_every_lazy_name_is_there() -> None:
    """A name that `import acausal` promises must be where it is looked for."""
    for name in acausal._LAZY:
        assert callable(getattr(acausal, name)), name
