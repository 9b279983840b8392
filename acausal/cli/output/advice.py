"""What to do about the commonest Python errors in the code of a model."""

from __future__ import annotations

import re
import sys
from types import FrameType, ModuleType

from acausal.cli.arguments.catalogue import families, library_parts, near_parts
from acausal.errors import nearest
from acausal.language.component import Component
from acausal.language.expressions.expression import Expr


def advice(error: Exception, frame: FrameType) -> str | None:
    """A line of help, or None when nothing better than the error itself can be said."""
    if isinstance(error, NameError):
        return _unknown_name(str(getattr(error, "name", "")), frame)
    if isinstance(error, AttributeError):
        return _unknown_attribute(str(getattr(error, "name", "")), getattr(error, "obj", None))
    if isinstance(error, ModuleNotFoundError):
        return _library(error.name or "")
    if isinstance(error, ImportError):
        wanted = re.search(r"cannot import name '(\w+)'", str(error))
        if wanted is None:
            return None
        return _unknown_attribute(wanted[1], sys.modules.get(error.name or "")) or _elsewhere(wanted[1])
    return _operation(str(error)) if isinstance(error, TypeError) else None


def _unknown_name(name: str, frame: FrameType) -> str | None:
    owner = frame.f_locals.get("self")
    if isinstance(owner, Component) and (name in owner._declarations or hasattr(type(owner), name)):
        return f"write self.{name}"
    if name in _public():
        return f"from acausal import {name}"
    known = [*frame.f_locals, *frame.f_globals, *_public()]
    return _did_you_mean(name, known) or _elsewhere(name)


def _public() -> list[str]:
    """What `from acausal import ...` gives."""
    return [name for name in dir(sys.modules["acausal"]) if not name.startswith("_")]


def _unknown_attribute(name: str, owner: object) -> str | None:
    if isinstance(owner, Expr) and name == "der":
        return "write der(self.x)"
    if isinstance(owner, ModuleType):
        return _did_you_mean(name, [n for n in dir(owner) if not n.startswith("_")])
    return None


def _library(module: str) -> str | None:
    """Which libraries there are, for one that is not."""
    if not module.startswith("acausal.library."):
        return None
    return _did_you_mean(module.split(".")[2], list(families())) or f"there are {', '.join(families())}"


def _operation(text: str) -> str | None:
    """Help for what Python allows between numbers and expressions do not, and the other way round."""
    if "for ^:" in text:
        return "a power is written x**2"
    if re.match(r"'(Symbol|Operation|Constant|Expr)' object is not callable", text):
        return "an expression is no function: write time or self.x without brackets"
    return None


def _elsewhere(name: str) -> str | None:
    """Which libraries have a component of this name, or nearly so."""
    exact = [f"from acausal.library.{p.family} import {name}" for p in library_parts() if p.name == name]
    if exact:
        return ", or ".join(exact)
    # Components are written with a capital; a word that is not has other relatives.
    close = near_parts(name) if name[:1].isupper() else []
    return f"did you mean {', '.join(close)} of acausal.library?" if close else None


def _did_you_mean(name: str, names: list[str]) -> str | None:
    close = nearest(name, names)
    return f"did you mean {', '.join(close)}?" if close else None
