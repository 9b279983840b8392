"""Check of the argument `model` of public functions."""

from __future__ import annotations

from typing import Any

from acausal.errors import UsageError
from acausal.language.component import Component


def check_model(model: Any) -> None:
    """Raise UsageError AC028 if `model` is not a component, but for example its class."""
    if not isinstance(model, Component):
        is_class = isinstance(model, type)
        fact = f"the class {model.__name__} is not a model yet" if is_class else f"{model!r} is not a model"
        raise UsageError("AC028", fact, help=f"make one: {model.__name__}()" if is_class else "give a component")
