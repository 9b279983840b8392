"""What is given as a model is one."""

from __future__ import annotations

from typing import Any

from acausal.errors import UsageError
from acausal.language.component import Component


def check_model(model: Any) -> None:
    """Raise UsageError AC028 for what is no component, such as its class."""
    if not isinstance(model, Component):
        is_class = isinstance(model, type)
        fact = f"the class {model.__name__} is not a model yet" if is_class else f"{model!r} is not a model"
        raise UsageError("AC028", fact, help=f"make one: {model.__name__}()" if is_class else "give a component")
